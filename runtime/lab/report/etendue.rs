//! Shows quality against the eyebox of a mask in the page of a comparison.

use super::page::{self, figure, row, table};
use super::pictures::{columns, decibels, img, in_decibels};
use super::plot::{Axis, Plot};
use crate::comparison::{EtendueFigures, Results};
use maud::{Markup, html};

/// Returns one plot per scene with its name.
pub fn figures(results: &Results) -> Vec<(String, Plot)> {
    scenes(results).into_iter().map(|scene| (format!("etendue {scene}"), plot(results, scene, true))).collect()
}

fn scenes(results: &Results) -> Vec<&str> {
    let mut scenes: Vec<&str> = results.etendue.iter().map(|e| &e.scene[..]).collect();
    scenes.dedup();
    scenes
}

/// Returns the measurements of one scene.
fn of<'a>(results: &'a Results, scene: &'a str) -> impl Iterator<Item = &'a EtendueFigures> {
    results.etendue.iter().filter(move |e| e.scene == scene)
}

/// Returns the numbers of sub-frames with the kind of mask.
fn lines(results: &Results) -> Vec<(usize, bool)> {
    let mut lines: Vec<(usize, bool)> = results.etendue.iter().map(|e| (e.frames, e.designed)).collect();
    lines.sort_unstable();
    lines.dedup();
    lines
}

fn name((frames, designed): (usize, bool)) -> String {
    format!("{frames} sub-frames, {} masks", if designed { "designed" } else { "random" })
}

/// Plots the mean PSNR against the side of the eyebox.
fn plot(results: &Results, scene: &str, legend: bool) -> Plot {
    let title = format!("PSNR of {scene} against the eyebox that a mask makes");
    let mut plot = Plot::new(&title, Axis::linear("side of the eyebox, mm"), Axis::linear("dB"));
    for (i, line) in lines(results).into_iter().enumerate() {
        let own = of(results, scene).filter(|e| (e.frames, e.designed) == line);
        let points: Vec<[f64; 2]> = own.filter_map(|e| Some([e.eyebox_mm, e.mean_db?])).collect();
        plot.series(&format!("m{i}"), &name(line), &points);
        if legend {
            plot.legend(&format!("m{i}"), &name(line));
        }
    }
    plot
}

/// Returns the section, which is empty without a comparison of masks.
pub fn section(results: &Results) -> Markup {
    let Some(first) = results.etendue.first() else { return Markup::default() };
    let body = html! {
        p {
            (format!(
                "Masks of finer pixels in front of the SLM are compared in {}. Each hologram is solved for its mask, \
                 and scored behind it through random pupils over its whole eyebox. The number of phases is the same \
                 with and without a mask, so a larger eyebox and etendue cost quality. Views without a stated pitch \
                 stretch over each eyebox. Speckle is the standard deviation of an even plane over its mean, through a \
                 pupil of {:.1} mm.",
                first.color, first.eye_mm
            ))
        }
        ul.legend {
            @for (i, line) in lines(results).into_iter().enumerate() { li class={ "m" (i) } { i {} (name(line)) } }
        }
        div.plots {
            @for scene in scenes(results) { (figure(&plot(results, scene, false), scene, "mean over random pupils")) }
        }
        @for scene in scenes(results) { (of_scene(results, scene)) }
    };
    page::section("etendue", "Masks against eyebox", body)
}

fn of_scene(results: &Results, scene: &str) -> Markup {
    let line = |e: &EtendueFigures| {
        let numbers = [
            format!("{:.1}", e.eyebox_mm),
            format!("{:.3}", e.etendue_mm2_sr),
            decibels(e.mean_db, 2),
            decibels(e.worst_db, 2),
            format!("{:.3}", e.contrast),
        ];
        row(&format!("{} sub-frames, {}", e.frames, e.mask), numbers)
    };
    let head = ["Mask", "eyebox, mm", "etendue, mm2 sr", "mean dB", "worst dB", "speckle"];
    html! {
        (table(scene, &head, of(results, scene).map(line)))
        div.shots style=(columns(4)) {
            @for e in of(results, scene) {
                @if let Some(picture) = &e.picture {
                    @let words = format!("{}, {} sub-frames, {}", e.mask, e.frames, in_decibels(e.mean_db));
                    figure { (img(picture, &format!("{scene}, {words}"), None)) figcaption { (words) } }
                }
            }
        }
    }
}
