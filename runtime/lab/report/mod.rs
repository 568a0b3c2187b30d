//! Writes reports: pages that open from disk, and the same numbers as CSV and JSON.
//!
//! What was measured comes as plain data ([`comparison::Results`](crate::comparison::Results)); nothing here
//! computes light. A [`Plot`] is the one type of drawing, `page` is what all pages are made of.

mod calibration;
mod coherence;
mod comparison;
mod content_study;
mod drawing;
mod etendue;
mod joint;
mod page;
mod pictures;
mod plot;
mod plots;
mod sources;
mod study;
mod tables;
mod text;
mod tradeoff;

pub use plot::{Axis, Plot};

use crate::comparison::Results;
use crate::study::{ContentRun, Study};
use crate::tuning::Tuned;
use eyebox::low_level::calibrate::Calibration;
use eyebox::low_level::files::{FileError, ManagedDir};
use eyebox::low_level::optics::Color;
use serde_json::Value;

/// What [`write_comparison`] writes, as [`ManagedDir::open`] takes it.
pub const COMPARISON: [&str; 8] = [
    "report.html",
    "scores.csv",
    "summary.csv",
    "joint-color.csv",
    "coherence.csv",
    "etendue.csv",
    "report.json",
    "figures/",
];
/// What [`write_tuned`] writes.
pub const TUNED: [&str; 4] = ["index.html", "trials.csv", "tradeoff.json", "figures/"];
/// What [`write_study`] writes.
pub const STUDY: [&str; 3] = ["study.html", "study.json", "figures/"];

/// The numbers of a comparison of methods as one JSON object, without its pictures.
pub fn comparison_json(results: &Results) -> Value {
    tables::json(results)
}

/// Writes `report.html`, `scores.csv`, `summary.csv`, `report.json` and, where it has them, `joint-color.csv`, `coherence.csv` and
/// `etendue.csv` of a comparison of methods into a folder, each whole or not at all; and its plots, each by itself as SVG and as PDF, into `figures/`.
///
/// # Errors
/// [`FileError`].
pub fn write_comparison(results: &Results, folder: &mut ManagedDir) -> Result<(), FileError> {
    let methods = if results.methods.is_empty() { Vec::new() } else { plots::figures(results) };
    let joint = (!results.joint.is_empty()).then(|| ("joint-color.csv", tables::joint_table(results)));
    let sizes = (!results.coherence.is_empty()).then(|| ("coherence.csv", tables::coherence_table(results)));
    let masks = (!results.etendue.is_empty()).then(|| ("etendue.csv", tables::etendue_table(results)));
    write(
        folder,
        methods
            .into_iter()
            .chain(joint::figures(results))
            .chain(coherence::figures(results))
            .chain(etendue::figures(results))
            .chain(sources::figures(results)),
        joint.into_iter().chain(sizes).chain(masks).chain([
            ("scores.csv", tables::scores(results)),
            ("summary.csv", tables::summary(results)),
            ("report.json", format!("{:#}\n", tables::json(results)).into_bytes()),
            ("report.html", comparison::page(results).into_bytes()),
        ]),
    )
}

/// The page of a calibration: pictures beside predictions, the model's numbers, what is left and where.
pub fn calibration_page(calibration: &Calibration, color: Color) -> String {
    calibration::page(calibration, color)
}

/// The numbers of a tuning as one JSON object, with the trials that are on each front.
pub fn tuned_json(tuned: &Tuned) -> Value {
    tradeoff::json(tuned)
}

/// Writes `index.html`, `trials.csv` and `tradeoff.json` of a tuning into a folder, each whole or not at all; and its plots,
/// each by itself as SVG and as PDF, into `figures/`.
///
/// # Errors
/// [`FileError`].
pub fn write_tuned(tuned: &Tuned, folder: &mut ManagedDir) -> Result<(), FileError> {
    write(
        folder,
        tradeoff::figures(tuned),
        [
            ("trials.csv", tradeoff::csv(tuned)),
            ("tradeoff.json", format!("{:#}\n", tradeoff::json(tuned)).into_bytes()),
            ("index.html", tradeoff::page(tuned).into_bytes()),
        ],
    )
}

/// Writes `study.html`, the page of a study of steering, and `study.json`, its `numbers`, into a folder, each whole or not at
/// all; and its plots, each by itself as SVG and as PDF, into `figures/`. `engine` is what computed it.
///
/// # Errors
/// [`FileError`].
pub fn write_study(
    title: &str,
    engine: &str,
    study: &Study,
    numbers: &Value,
    folder: &mut ManagedDir,
) -> Result<(), FileError> {
    let numbers = format!("{numbers:#}\n").into_bytes();
    let page = study::page(title, engine, study).into_bytes();
    write(folder, study::figures(study), [("study.json", numbers), ("study.html", page)])
}

/// The same of a study of content that stands still, moves or jumps: its runs, and how many sets after a change summaries leave out.
///
/// # Errors
/// [`FileError`].
pub fn write_content_study(
    title: &str,
    engine: &str,
    (runs, settles): (&[ContentRun], u32),
    numbers: &Value,
    folder: &mut ManagedDir,
) -> Result<(), FileError> {
    let numbers = format!("{numbers:#}\n").into_bytes();
    let page = content_study::page(title, engine, runs, settles).into_bytes();
    write(folder, content_study::figures(runs), [("study.json", numbers), ("study.html", page)])
}

/// The files, after each plot by itself, under its name with dashes.
fn write<'f>(
    folder: &mut ManagedDir,
    figures: impl IntoIterator<Item = (impl AsRef<str>, Plot)>,
    files: impl IntoIterator<Item = (&'f str, Vec<u8>)>,
) -> Result<(), FileError> {
    let mut all = Vec::new();
    for (name, plot) in figures {
        let words = name.as_ref().to_lowercase();
        let words: Vec<&str> = words.split(|c: char| !c.is_ascii_alphanumeric()).filter(|w| !w.is_empty()).collect();
        let name = words.join("-");
        all.push((format!("figures/{name}.svg"), plot.file().into_bytes()));
        all.push((format!("figures/{name}.pdf"), plot.pdf()));
    }
    all.extend(files.into_iter().map(|(name, bytes)| (name.to_owned(), bytes)));
    folder.write(all)
}
