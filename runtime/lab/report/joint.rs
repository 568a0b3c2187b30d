//! All colours at once against one colour after another, in the page of a comparison.

use super::page::{self, figure, row, table};
use super::pictures::{columns, decibels, img, in_decibels};
use super::plot::{Axis, Plot};
use super::plots::counts;
use crate::comparison::{JointFigures, Results};
use maud::{Markup, html};

/// A plot for each scene, under its name.
pub fn figures(results: &Results) -> Vec<(String, Plot)> {
    scenes(results).into_iter().map(|scene| (format!("joint color {scene}"), plot(results, scene, true))).collect()
}

fn scenes(results: &Results) -> Vec<&str> {
    let mut scenes: Vec<&str> = results.joint.iter().map(|j| &j.scene[..]).collect();
    scenes.dedup();
    scenes
}

/// What was measured of one scene.
fn of<'a>(results: &'a Results, scene: &'a str) -> impl Iterator<Item = &'a JointFigures> {
    results.joint.iter().filter(move |j| j.scene == scene)
}

/// The ways of lighting sub-frames, in the order in which they were measured.
fn ways(results: &Results) -> Vec<&str> {
    let mut ways: Vec<&str> = Vec::new();
    for joint in &results.joint {
        if !ways.contains(&&joint.way[..]) {
            ways.push(&joint.way);
        }
    }
    ways
}

/// Mean PSNR against sub-frames in all, a line for each way.
fn plot(results: &Results, scene: &str, legend: bool) -> Plot {
    let mut frames: Vec<usize> = of(results, scene).map(|j| j.frames).collect();
    frames.dedup();
    let title = format!("PSNR of {scene} against sub-frames in all, by how they are lit");
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

/// The section; nothing where it was not compared.
pub fn section(results: &Results) -> Markup {
    if results.joint.is_empty() {
        return Markup::default();
    }
    let body = html! {
        p {
            "The same number of sub-frames in all, lasers of the same peak power, each colour at the same exposure, the same steps \
             and pupils. In sequence each colour has its own sub-frames, a third of them; at once every laser lights every \
             sub-frame, with a power of its own, and one set of phases serves all colours. Brightness is that of white, times \
             that in sequence. PSNR is over random pupils and all colours."
        }
        ul.legend {
            @for (i, way) in ways(results).into_iter().enumerate() { li class={ "m" (i) } { i {} (way) } }
        }
        div.plots {
            @for scene in scenes(results) { (figure(&plot(results, scene, false), scene, "mean over random pupils and colours")) }
        }
        @for scene in scenes(results) { (of_scene(results, scene)) }
    };
    page::section("joint", "All colours at once", body)
}

fn of_scene(results: &Results, scene: &str) -> Markup {
    let line = |j: &JointFigures| {
        let colors: Vec<String> = j.colors_db.iter().map(|(color, db)| format!("{color} {db:.1}")).collect();
        let cells =
            [format!("{:.2}", j.brightness), decibels(j.mean_db, 2), decibels(j.worst_db, 2), colors.join(", ")];
        row(&format!("{} sub-frames, {}", j.frames, j.way), cells)
    };
    // Few sub-frames are where the ways differ most.
    let fewest = of(results, scene).map(|j| j.frames).min();
    let shown: Vec<&JointFigures> = of(results, scene).filter(|j| Some(j.frames) == fewest).collect();
    html! {
        (table(scene, &["Sub-frames in all", "brightness", "mean dB", "worst dB", "colours, mean dB"], of(results, scene).map(line)))
        div.shots style=(columns(shown.len())) {
            @for joint in &shown {
                @if let Some(picture) = &joint.picture {
                    @let alt = format!("{scene}, {} sub-frames, {}: {}", joint.frames, joint.way, in_decibels(joint.mean_db));
                    figure {
                        (img(picture, &alt, None))
                        figcaption { b { (joint.way) } (format!(" {} sub-frames, {}", joint.frames, in_decibels(joint.mean_db))) }
                    }
                }
            }
        }
    }
}
