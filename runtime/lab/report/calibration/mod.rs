//! The page of a calibration: which way round the bench is, what to mend, the display as it is, what was seen beside what the model
//! says, the model's numbers, and what is left.

mod display;
mod left;
mod worth;

use super::page::{bare, row, section, table};
use eyebox::low_level::calibrate::{Calibration, Report, Verdict};
use eyebox::low_level::optics::Color;
use maud::{Markup, html};

/// The whole page.
pub fn page(calibration: &Calibration, color: Color) -> String {
    let report = &calibration.report;
    let lead = match report.verdict {
        Verdict::Calibrated => "The model of the display explains the pictures to the camera's noise.",
        Verdict::WithFaults => "Calibrated, but the bench has faults that the model lacks.",
        _ => "Not calibrated: the model does not explain the pictures.",
    };
    let plots = display::plots(report);
    let body = html! {
        p.case { "The bench: " (report.directions) "." }
        @for warning in &report.warnings { p.warn { (warning) } }
        nav aria-label="Sections" {
            @if report.gain.is_some() { a href="#mend" { "Mend first" } a href="#worth" { "Decibels" } }
            @if plots.is_some() { a href="#display" { "The display as it is" } }
            a href="#pictures" { "Pictures" }
            a href="#left" { "What is left" }
            a href="#numbers" { "Numbers" }
        }
        @if let Some(gain) = &report.gain { (worth::mend(gain)) (worth::decibels(gain)) }
        @if let Some(plots) = plots { (section("display", "The display as it is", plots)) }
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
            p { "The pictures do not determine " (report.unobservable.join(", ")) ": they stay as the display's file has them." }
        }
        @if !report.confused.is_empty() {
            (table("Numbers that the pictures hardly separate", &["", "and", "Correlation"], pairs))
        }
    };
    section("numbers", "Numbers", body)
}

#[cfg(test)]
mod tests;
