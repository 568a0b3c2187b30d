//! Shows quality against coherence in the page of a comparison.

use super::page::{self, figure, row, table};
use super::pictures::{columns, decibels, img, in_decibels};
use super::plot::{Axis, Plot};
use crate::comparison::{CoherenceFigures, Results};
use maud::{Markup, html};

/// Returns two plots per scene with their names.
pub fn figures(results: &Results) -> Vec<(String, Plot)> {
    let of = |scene| {
        let named = |name: &str, plot| (format!("coherence {name} {scene}"), plot);
        [named("quality", quality(results, scene, true)), named("resolution", resolution(results, scene, true))]
    };
    scenes(results).into_iter().flat_map(of).collect()
}

fn scenes(results: &Results) -> Vec<&str> {
    let mut scenes: Vec<&str> = results.coherence.iter().map(|c| &c.scene[..]).collect();
    scenes.dedup();
    scenes
}

/// Returns the measurements of one scene.
fn of<'a>(results: &'a Results, scene: &'a str) -> impl Iterator<Item = &'a CoherenceFigures> {
    results.coherence.iter().filter(move |c| c.scene == scene)
}

/// Returns the numbers of sub-frames in the order of the measurements.
fn frames(results: &Results, scene: &str) -> Vec<usize> {
    let mut frames: Vec<usize> = of(results, scene).map(|c| c.frames).collect();
    frames.dedup();
    frames
}

/// One line of a plot over the size of the source, as its name, its number of sub-frames and its value.
type Line<'a> = (String, usize, &'a dyn Fn(&CoherenceFigures) -> Option<f64>);

fn plot(results: &Results, scene: &str, title: &str, y: Axis, lines: &[Line], legend: bool) -> Plot {
    let mut plot = Plot::new(title, Axis::linear("image of the source in the eyebox, mm"), y);
    for (i, (name, frames, value)) in lines.iter().enumerate() {
        let of_frames = of(results, scene).filter(|c| c.frames == *frames);
        let points: Vec<[f64; 2]> = of_frames.filter_map(|c| Some([c.image_mm, value(c)?])).collect();
        plot.series(&format!("m{i}"), name, &points);
        if legend {
            plot.legend(&format!("m{i}"), name);
        }
    }
    plot
}

fn quality_lines(results: &Results, scene: &str) -> Vec<Line<'static>> {
    let line = |f| (format!("{f} sub-frames"), f, &(|c: &CoherenceFigures| c.mean_db) as &dyn Fn(&_) -> Option<f64>);
    frames(results, scene).into_iter().map(line).collect()
}

/// Plots the mean PSNR against the size of the source.
fn quality(results: &Results, scene: &str, legend: bool) -> Plot {
    let title = format!("PSNR of {scene} against the size of the source");
    plot(results, scene, &title, Axis::linear("dB"), &quality_lines(results, scene), legend)
}

/// Returns the lines of modulation and speckle contrast, at the largest number of sub-frames.
fn resolution_lines(results: &Results, scene: &str) -> Vec<Line<'static>> {
    let Some(most) = frames(results, scene).into_iter().max() else { return Vec::new() };
    vec![
        ("modulation at the picture's Nyquist frequency".into(), most, &|c| Some(c.modulation[0])),
        ("modulation at half of it".into(), most, &|c| Some(c.modulation[1])),
        ("contrast of speckle".into(), most, &|c| Some(c.contrast)),
    ]
}

fn resolution(results: &Results, scene: &str, legend: bool) -> Plot {
    let title = format!("Modulation and speckle of {scene} against the size of the source");
    plot(results, scene, &title, Axis::linear("share").floor(0.0), &resolution_lines(results, scene), legend)
}

/// Returns the section, which is empty without a comparison of sources.
pub fn section(results: &Results) -> Markup {
    let Some(first) = results.coherence.first() else { return Markup::default() };
    let legend = |lines: Vec<Line>| {
        html! { ul.legend { @for (i, (name, ..)) in lines.iter().enumerate() { li class={ "m" (i) } { i {} (name) } } } }
    };
    let body = html! {
        p {
            (format!(
                "Square sources of several sizes are compared in {}. Each hologram is solved for its source, with as \
                 few modes as the scene requires, and judged in the light of up to 25 modes. The narrowest pupils of a \
                 step ({:.1} mm) and the widest ({:.1} mm) use as many of the modes as leave their speckle unchanged. \
                 A wide source averages speckle, and blurs content that is away from the SLM. Speckle is the standard \
                 deviation of an even plane over its mean, through a pupil of {:.1} mm. Modulation is the share that \
                 vertical bars at a depth of {:.1} mm keep, in focus through a pupil of {:.1} mm. Narrower pupils pass \
                 less than the picture's Nyquist frequency. Depth of field is the range of focus through which bars of \
                 half the cut-off of {:.1} mm keep half of their modulation. It is measured up to twice the wavelength \
                 times the square of focal length over diameter on either side. If the table has this limit, the depth \
                 of field is larger.",
                first.color, first.diameter_mm[0], first.diameter_mm[1], first.eye_mm, first.bars_mm, first.widest_mm, first.eye_mm
            ))
        }
        @for scene in scenes(results) {
            @if scenes(results).len() > 1 { h3 { (scene) } }
            div.plots {
                div { (legend(quality_lines(results, scene))) (figure(&quality(results, scene, false), "Quality", "mean over random pupils")) }
                div {
                    (legend(resolution_lines(results, scene)))
                    (figure(&resolution(results, scene, false), "Resolution and speckle", "of the most sub-frames"))
                }
            }
            (of_scene(results, scene))
        }
    };
    page::section("coherence", "Quality against coherence", body)
}

fn of_scene(results: &Results, scene: &str) -> Markup {
    let line = |c: &CoherenceFigures| {
        let [nyquist, half] = c.modulation;
        let size = if c.image_mm > 0.0 { format!("{} mm", c.image_mm) } else { "a point".into() };
        let cells = [
            c.modes.to_string(),
            format!("{} / {}", c.pupil_modes[0], c.pupil_modes[1]),
            decibels(c.mean_db, 2),
            decibels(c.worst_db, 2),
            format!("{:.3}", c.contrast),
            format!("{nyquist:.2}"),
            format!("{half:.2}"),
            format!("{:.1} ({:.3} D)", c.depth_of_field_mm, c.depth_of_field_dioptres),
        ];
        row(&format!("{} sub-frames, {size}", c.frames), cells)
    };
    let head = [
        "Source",
        "modes",
        "narrowest / widest",
        "mean dB",
        "worst dB",
        "speckle",
        "at Nyquist",
        "at half of it",
        "depth of field, mm",
    ];
    // Sources differ most at few sub-frames.
    let fewest = of(results, scene).map(|c| c.frames).min();
    let shown: Vec<&CoherenceFigures> = of(results, scene).filter(|c| Some(c.frames) == fewest).collect();
    html! {
        (table(scene, &head, of(results, scene).map(line)))
        div.shots style=(columns(shown.len())) {
            @for one in &shown {
                @if let Some(picture) = &one.picture {
                    @let words = format!("{} mm, {} sub-frames, {}", one.image_mm, one.frames, in_decibels(one.mean_db));
                    figure { (img(picture, &format!("{scene}, {words}"), None)) figcaption { (words) } }
                }
            }
        }
    }
}
