//! The page of a calibration: what was seen beside what the model says, the model's numbers, and what is left.

use super::page::{bare, row, section, table};
use crate::calibrate::{Calibration, LeftMap, Report, Shown, Verdict};
use crate::optics::Color;
use crate::quality::comparison::{Picture, light_exact, map};
use maud::{Markup, html};

/// All of it.
pub fn page(calibration: &Calibration, color: Color) -> String {
    let report = &calibration.report;
    let percent = |share: Option<f64>| share.map_or("not measured".into(), |s| format!("{:.4} %", 100.0 * s));
    let facts = [
        ("Display", calibration.display.name.clone()),
        ("Colour", color.to_string()),
        ("Pictures", report.captures.to_string()),
        ("Computing", format!("{:.0} s", report.seconds)),
        ("Camera's map", format!("{:.2} of its pixels RMS", report.camera_rms_px)),
        ("Unexplained before", percent(report.before)),
        ("Unexplained now", percent(report.unexplained)),
        ("The camera's noise", percent(report.noise)),
        (
            "Built-in still life",
            report.gain.as_ref().map_or("not measured".into(), |gain| {
                format!("{:.2} dB before, {:.2} now", gain.before_db[0], gain.after_db[0])
            }),
        ),
    ];
    let lead = match report.verdict {
        Verdict::Calibrated => {
            "The model of the display that its pictures tell. Shares are of the variance of pictures that were not fitted."
        }
        Verdict::WithFaults => {
            "Calibrated, with faults that the model lacks. Shares are of the variance of pictures that were not fitted."
        }
        _ => {
            "Not calibrated: the model does not explain the pictures. Shares are of the variance of pictures that were not fitted."
        }
    };
    let body = html! {
        @for warning in &report.warnings { p.warn { (warning) } }
        (pictures(&calibration.shown, color)) (left(&report.map)) (numbers(report)) (by_picture(report))
    };
    bare(&format!("Calibration of {}", calibration.display.name), lead, &facts, body)
}

fn img(picture: &Picture, alt: &str) -> Markup {
    html! { img width=(picture.width) height=(picture.height) alt=(alt) title=(alt) src=(picture.data); }
}

fn pictures(all: &[Shown], color: Color) -> Markup {
    let shot = |picture: Picture, name: &str, under: String| {
        html! { figure { (img(&picture, name)) figcaption { b { (name) } br; span.note { (under) } } } }
    };
    let body = html! {
        @for shown in all {
            @let [height, width] = shown.size;
            @let most = shown.picture.iter().copied().fold(f32::MIN_POSITIVE, f32::max);
            @let scaled = |values: &[f32]| values.iter().map(|v| (v / most).max(0.0)).collect::<Vec<f32>>();
            @let errors: Vec<f64> = shown.difference.iter().map(|d| f64::from(*d)).collect();
            @let worst = errors.iter().copied().fold(f64::MIN_POSITIVE, f64::max);
            @let shares: Vec<f64> = errors.iter().map(|e| e / worst).collect();
            div.shots style="--n:3" {
                (shot(light_exact(&[(color, &scaled(&shown.picture))], height, width), "Seen", shown.file.clone()))
                (shot(light_exact(&[(color, &scaled(&shown.prediction))], height, width), "Predicted", "the same exposure".into()))
                (shot(map(&shares, height, width), "Difference", format!("black is 0, white {:.3} of the brightest", worst / f64::from(most))))
            }
        }
    };
    section("pictures", "Pictures that were not fitted", body)
}

fn left(map_of: &LeftMap) -> Markup {
    let most = map_of.squares.iter().flatten().copied().fold(2.0, f64::max);
    let values: Vec<f64> = map_of.squares.iter().map(|s| s.map_or(0.0, |s| s / most)).collect();
    let body = html! {
        div.shots style="--n:3" {
            figure {
                (img(&map(&values, map_of.rows, map_of.columns), "what is left, over the camera's picture"))
                figcaption { span.note { (format!("All pictures together, tiles of {0} × {0} camera pixels: squares of what is left, \
                    from 0 to {most:.1} times the noise's. A good fit is even, at 1.", map_of.tile_px)) } }
            }
        }
    };
    section("left", "Where something is left", body)
}

fn numbers(report: &Report) -> Markup {
    let rows = report.parameters.iter().map(|p| {
        let error = p.error.map_or_else(String::new, |e| format!("{e:.5}"));
        row(&p.name, [format!("{:.5}", p.value), error, p.unit.into()])
    });
    let pairs = report.confused.iter().map(|pair| {
        let [a, b] = &pair.names;
        row(a, [b.clone(), format!("{:.3}", pair.correlation)])
    });
    let body = html! {
        (table("The model's numbers", &["", "Value", "Standard error", "Unit"], rows))
        @if !report.untold.is_empty() {
            p { "The pictures say nothing of " (report.untold.join(", ")) ": they stay as the display's file has them." }
        }
        @if let Some(gain) = &report.gain {
            p.note { (format!("Built-in still life: {} x {} of the display's pixels, {} steps, mean of random pupils, seen on the \
                fitted display; solved for the display as its file was (worst pupil {:.2} dB), and for the fitted one ({:.2} dB).",
                gain.size[0], gain.size[1], gain.steps, gain.before_db[1], gain.after_db[1])) }
        }
        @if !report.confused.is_empty() {
            (table("Numbers that the pictures hardly tell apart", &["", "and", "Correlation"], pairs))
        }
    };
    section("numbers", "Numbers", body)
}

fn by_picture(report: &Report) -> Markup {
    let rows = report.pictures.iter().map(|p| {
        let [x, y, d] = p.iris_mm;
        row(
            &p.file,
            [
                format!("{x:.2}, {y:.2}, {d:.2}"),
                p.role.into(),
                format!("{:.4} %", 100.0 * p.left),
                format!("{:.2}", p.squares),
            ],
        )
    });
    let columns = ["", "Iris x, y, diameter (mm)", "Used", "Left of its variance", "Squares, times the noise's"];
    section("each", "Picture by picture", table("What is left of each picture, noise and all", &columns, rows))
}
