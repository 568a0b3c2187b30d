//! Compares simultaneous color with one color after another in the page of a comparison.

use super::page::{self, figure, row, table};
use super::pictures::{columns, decibels, img, in_decibels};
use super::plot::{Axis, Plot};
use super::plots::counts;
use crate::comparison::{JointFigures, Results};
use maud::{Markup, html};

/// Returns one plot per scene with its name.
pub fn figures(results: &Results) -> Vec<(String, Plot)> {
    scenes(results).into_iter().map(|scene| (format!("joint color {scene}"), plot(results, scene, true))).collect()
}

fn scenes(results: &Results) -> Vec<&str> {
    let mut scenes: Vec<&str> = results.joint.iter().map(|j| &j.scene[..]).collect();
    scenes.dedup();
    scenes
}

/// Returns the measurements of one scene.
fn of<'a>(results: &'a Results, scene: &'a str) -> impl Iterator<Item = &'a JointFigures> {
    results.joint.iter().filter(move |j| j.scene == scene)
}

/// Lists the ways of lighting sub-frames in the order of the measurements.
fn ways(results: &Results) -> Vec<&str> {
    let mut ways: Vec<&str> = Vec::new();
    for joint in &results.joint {
        if !ways.contains(&&joint.way[..]) {
            ways.push(&joint.way);
        }
    }
    ways
}

/// Plots the mean PSNR against the number of sub-frames in all, with one line per way.
fn plot(results: &Results, scene: &str, legend: bool) -> Plot {
    let mut frames: Vec<usize> = of(results, scene).map(|j| j.frames).collect();
    frames.dedup();
    let title = format!("PSNR of {scene} against sub-frames in all, by their lighting");
    let mut plot = Plot::new(&title, Axis::log("sub-frames in all").ticks(counts(frames)), Axis::linear("dB"));
    for (i, way) in ways(results).into_iter().enumerate() {
        let points: Vec<[f64; 2]> =
            of(results, scene).filter(|j| j.way == way).filter_map(|j| Some([j.frames as f64, j.mean_db?])).collect();
        plot.series(&format!("m{i}"), way, &points);
        if legend {
            plot.legend(&format!("m{i}"), way);
        }
    }
    plot
}

/// Returns the section, which is empty without a comparison of ways.
pub fn section(results: &Results) -> Markup {
    if results.joint.is_empty() {
        return Markup::default();
    }
    let body = html! {
        p {
            "All ways have the same number of sub-frames in all, lasers of the same peak power, each color at the same \
             exposure, and the same steps and pupils. In sequence, each color has its own third of the sub-frames. At \
             once, each laser lights all sub-frames with its own power, and one set of phases serves all colors. \
             Brightness is the brightness of white relative to the sequence. PSNR is over random pupils and all colors."
        }
        ul.legend {
            @for (i, way) in ways(results).into_iter().enumerate() { li class={ "m" (i) } { i {} (way) } }
        }
        div.plots {
            @for scene in scenes(results) { (figure(&plot(results, scene, false), scene, "mean over random pupils and colors")) }
        }
        @for scene in scenes(results) { (of_scene(results, scene)) }
    };
    page::section("joint", "Simultaneous color", body)
}

fn of_scene(results: &Results, scene: &str) -> Markup {
    let line = |j: &JointFigures| {
        let colors: Vec<String> = j.colors_db.iter().map(|(color, db)| format!("{color} {db:.1}")).collect();
        let cells =
            [format!("{:.2}", j.brightness), decibels(j.mean_db, 2), decibels(j.worst_db, 2), colors.join(", ")];
        row(&format!("{} sub-frames, {}", j.frames, j.way), cells)
    };
    // The ways differ most at few sub-frames.
    let fewest = of(results, scene).map(|j| j.frames).min();
    let shown: Vec<&JointFigures> = of(results, scene).filter(|j| Some(j.frames) == fewest).collect();
    html! {
        (table(scene, &["Sub-frames in all", "brightness", "mean dB", "worst dB", "colors, mean dB"], of(results, scene).map(line)))
        div.shots style=(columns(shown.len())) {
            @for joint in &shown {
                @if let Some(picture) = &joint.picture {
                    @let alt = format!("{scene}, {} sub-frames, {}, {}", joint.frames, joint.way, in_decibels(joint.mean_db));
                    figure {
                        (img(picture, &alt, None))
                        figcaption { b { (joint.way) } (format!(" {} sub-frames, {}", joint.frames, in_decibels(joint.mean_db))) }
                    }
                }
            }
        }
    }
}
