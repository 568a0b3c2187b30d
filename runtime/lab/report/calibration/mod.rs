//! Makes the page of a calibration.
//!
//! The page shows the orientation of the bench, the faults to correct, the fitted display, the pictures next to the
//! predictions, the parameters of the model, and the residuals.

mod display;
mod left;
mod worth;

use super::page::{bare, row, section, table};
use eyebox::low_level::calibrate::{Calibration, Report, Verdict};
use eyebox::low_level::optics::Color;
use maud::{Markup, html};

/// Returns the complete page as HTML.
pub fn page(calibration: &Calibration, color: Color) -> String {
    let report = &calibration.report;
    let lead = match report.verdict {
        Verdict::Calibrated => "The model of the display explains the pictures to the camera's noise.",
        Verdict::WithFaults => "The display is calibrated, but the bench has faults that the model does not contain.",
        _ => "The display is not calibrated, because the model does not explain the pictures.",
    };
    let plots = display::plots(report);
    let body = html! {
        p.case { "The bench: " (report.directions) "." }
        @for warning in &report.warnings { p.warn { (warning) } }
        nav aria-label="Sections" {
            @if report.gain.is_some() { a href="#mend" { "Faults to correct" } a href="#worth" { "Decibels" } }
            @if plots.is_some() { a href="#display" { "The fitted display" } }
            a href="#pictures" { "Pictures" }
            a href="#left" { "Residuals" }
            a href="#numbers" { "Numbers" }
        }
        @if let Some(gain) = &report.gain { (worth::mend(gain)) (worth::decibels(gain)) }
        @if let Some(plots) = plots { (section("display", "The fitted display", plots)) }
        (left::pictures(&calibration.shown, color)) (left::map(&report.map)) (numbers(report)) (left::by_picture(report))
    };
    bare(&format!("Calibration of {}", calibration.display.name), lead, &facts(calibration, color), body)
}

fn facts(calibration: &Calibration, color: Color) -> Vec<(&'static str, String)> {
    let report = &calibration.report;
    let percent = |share: Option<f64>| share.map_or("not measured".into(), |s| format!("{:.4} %", 100.0 * s));
    let gain = report.gain.as_ref().map_or("not measured".into(), |gain| {
        format!("{:.2} dB before, {:.2} now", gain.before_db[0], gain.after_db[0])
    });
    vec![
        ("Display", calibration.display.name.clone()),
        ("Color", color.to_string()),
        ("Pictures", report.captures.to_string()),
        ("Computing", format!("{:.0} s", report.seconds)),
        ("Camera's map", format!("{:.2} of its pixels RMS", report.camera_rms_px)),
        ("Unexplained before", percent(report.before)),
        ("Unexplained now", percent(report.unexplained)),
        ("The camera's noise", percent(report.noise)),
        ("Built-in still life", gain),
    ]
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
        @if !report.unobservable.is_empty() {
            p { "The pictures do not determine " (report.unobservable.join(", ")) ". They keep the display file's values." }
        }
        @if !report.confused.is_empty() {
            (table("Numbers that the pictures hardly separate", &["", "and", "Correlation"], pairs))
        }
    };
    section("numbers", "Numbers", body)
}

#[cfg(test)]
mod tests;
