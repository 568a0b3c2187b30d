//! Shows the scores across the eyebox of a display's switchable sources in the page of a comparison.

use super::page::{self, figure, row, table};
use super::pictures::{columns, decibels, img, in_decibels};
use super::plot::{Axis, Plot};
use crate::comparison::{Results, SourcesFigures};
use maud::{Markup, html};

/// Returns one plot per scene with its name.
pub fn figures(results: &Results) -> Vec<(String, Plot)> {
    scenes(results).into_iter().map(|scene| (format!("sources {scene}"), plot(results, scene, true))).collect()
}

fn scenes(results: &Results) -> Vec<&str> {
    let mut scenes: Vec<&str> = results.sources.iter().map(|s| &s.scene[..]).collect();
    scenes.dedup();
    scenes
}

/// Returns the measurements of one scene.
fn of<'a>(results: &'a Results, scene: &'a str) -> impl Iterator<Item = &'a SourcesFigures> {
    results.sources.iter().filter(move |s| s.scene == scene)
}

fn is_diagonal(figures: &SourcesFigures) -> bool {
    figures.place_mm[1] != 0.0
}

/// Lists the ways of lighting the sources, along x and along the diagonal.
fn lines(results: &Results) -> Vec<(&str, bool)> {
    let mut lines: Vec<(&str, bool)> = Vec::new();
    for s in &results.sources {
        let line = (&s.way[..], is_diagonal(s));
        if !lines.contains(&line) {
            lines.push(line);
        }
    }
    lines
}

fn name((way, diagonal): (&str, bool)) -> String {
    format!("{way}, {}", if diagonal { "along the diagonal" } else { "along x" })
}

/// Plots the mean PSNR against the distance of the eye from the middle of the eyebox along x.
fn plot(results: &Results, scene: &str, legend: bool) -> Plot {
    let title = format!("PSNR of {scene} at the eye against its place in the eyebox, by the lighting of the sources");
    let mut plot = Plot::new(&title, Axis::linear("mm from the middle along x"), Axis::linear("dB"));
    for (i, line) in lines(results).into_iter().enumerate() {
        let own = of(results, scene).filter(|s| s.way == line.0 && is_diagonal(s) == line.1);
        let points: Vec<[f64; 2]> = own.filter_map(|s| Some([s.place_mm[0], s.mean_db?])).collect();
        plot.series(&format!("m{i}"), &name(line), &points);
        if legend {
            plot.legend(&format!("m{i}"), &name(line));
        }
    }
    plot
}

/// Returns the section, which is empty without a comparison of sources.
pub fn section(results: &Results) -> Markup {
    if results.sources.is_empty() {
        return Markup::default();
    }
    let body = html! {
        p {
            "Each of the display's switchable sources has its own eyebox. If they follow the eye, a hologram is solved \
             for the position of the eye. The source whose eyebox holds the pupil lights it, or near a border all \
             sources that the pupil touches. If they are lit in turn, each sub-frame has its own source. If they are \
             lit together, all sources light all sub-frames. PSNR is through pupils of 3.5 to 4.5 mm within 0.2 mm of \
             the place, focused through the scene. Each place has its own exposure."
        }
        ul.legend {
            @for (i, line) in lines(results).into_iter().enumerate() { li class={ "m" (i) } { i {} (name(line)) } }
        }
        div.plots {
            @for scene in scenes(results) { (figure(&plot(results, scene, false), scene, "mean over pupils and colors")) }
        }
        @for scene in scenes(results) { (of_scene(results, scene)) }
    };
    page::section("sources", "Sources against eyebox", body)
}

fn of_scene(results: &Results, scene: &str) -> Markup {
    let line = |s: &SourcesFigures| {
        let lit = if s.lit > 0 { s.lit.to_string() } else { "all".into() };
        let [x, y] = s.place_mm;
        row(&format!("{}, ({x:.1}, {y:.1}) mm", s.way), [lit, decibels(s.mean_db, 2), decibels(s.worst_db, 2)])
    };
    // Each way has pictures along x, in the middle, halfway and at the rim.
    let own = |way: &str| of(results, scene).filter(|s| s.way == way && !is_diagonal(s)).collect::<Vec<_>>();
    let ways = lines(results).into_iter().filter(|(_, diagonal)| !diagonal);
    let shown: Vec<&SourcesFigures> = ways
        .flat_map(|(way, _)| {
            let all = own(way);
            [0, all.len() / 2, all.len().saturating_sub(1)].map(|i| all[i])
        })
        .collect();
    html! {
        (table(scene, &["Sources, place", "lit", "mean dB", "worst dB"], of(results, scene).map(line)))
        div.shots style=(columns(3)) {
            @for s in &shown {
                @if let Some(picture) = &s.picture {
                    @let what = format!("{} at {:.0} mm, {}", s.way, s.place_mm[0], in_decibels(s.mean_db));
                    figure { (img(picture, &format!("{scene}, {what}"), None)) figcaption { (what) } }
                }
            }
        }
    }
}
