//! Writes reports as pages that open from disk, and the same numbers as CSV and JSON.
//!
//! The measurements arrive as plain data ([`comparison::Results`](crate::comparison::Results)), and this module
//! computes no light. A [`Plot`] is the one type of drawing, and `page` has the parts of all pages.

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

/// The files that [`write_comparison`] writes, in the form of [`ManagedDir::open`].
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
/// The files that [`write_tuned`] writes.
pub const TUNED: [&str; 4] = ["index.html", "trials.csv", "tradeoff.json", "figures/"];
/// The files that [`write_study`] writes.
pub const STUDY: [&str; 3] = ["study.html", "study.json", "figures/"];

/// Returns the numbers of a comparison of methods as one JSON object, without its pictures.
pub fn comparison_json(results: &Results) -> Value {
    tables::json(results)
}

/// Writes `report.html`, `scores.csv`, `summary.csv` and `report.json` of a comparison of methods into a folder, each
/// atomically.
///
/// If the comparison has such results, it also writes `joint-color.csv`, `coherence.csv` and `etendue.csv`. Each plot
/// is also written as a separate SVG and PDF into `figures/`.
///
/// # Errors
/// Returns [`FileError`] if a file cannot be written.
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

/// Returns the page of a calibration with pictures next to predictions, the parameters of the model, and the residuals
/// with their places.
pub fn calibration_page(calibration: &Calibration, color: Color) -> String {
    calibration::page(calibration, color)
}

/// Returns the numbers of a tuning as one JSON object, with the trials that are on each front.
pub fn tuned_json(tuned: &Tuned) -> Value {
    tradeoff::json(tuned)
}

/// Writes `index.html`, `trials.csv` and `tradeoff.json` of a tuning into a folder, each atomically. Each plot is also
/// written as a separate SVG and PDF into `figures/`.
///
/// # Errors
/// Returns [`FileError`] if a file cannot be written.
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

/// Writes `study.html`, the page of a study of the refinement for the tracked pupil, and `study.json`, its `numbers`,
/// into a folder, each atomically. Each plot is also written as a separate SVG and PDF into `figures/`. `engine` is the
/// description of the engine.
///
/// # Errors
/// Returns [`FileError`] if a file cannot be written.
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

/// Writes the same files for a study of still, moving or jumping content. The pair has its runs and the number of sets
/// after a change that the means leave out.
///
/// # Errors
/// Returns [`FileError`] if a file cannot be written.
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

/// Writes each plot under its name with dashes, and then the files.
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
