//! Reports: pages that open from disk, and the same numbers as CSV and JSON.
//!
//! What was measured comes as plain data ([`comparison::Results`](crate::quality::comparison::Results)); nothing here
//! computes light. A [`Plot`] is the one type of drawing, `page` is what all pages are made of. Behind the feature
//! `reports`.

mod comparison;
mod drawing;
mod findings;
mod page;
mod pictures;
mod plot;
mod plots;
#[cfg(feature = "window")]
mod study;
mod tables;
mod text;
mod tradeoff;

pub use plot::{Axis, Plot};

use crate::files::{FileError, write_file};
use crate::quality::Tuned;
use crate::quality::comparison::Results;
#[cfg(feature = "window")]
use crate::session::Study;
use serde_json::Value;
use std::path::Path;

/// The numbers of a comparison of methods as one JSON object, without its pictures.
pub fn comparison_json(results: &Results) -> Value {
    tables::json(results)
}

/// Writes `report.html`, `scores.csv`, `summary.csv` and `report.json` of a comparison of methods into a folder, each whole
/// or not at all; and its plots, each by itself as SVG and as PDF, into `figures/`.
///
/// # Errors
/// [`FileError`].
pub fn write_comparison(results: &Results, folder: &Path) -> Result<(), FileError> {
    write_figures(folder, plots::figures(results))?;
    write(
        folder,
        [
            ("scores.csv", tables::scores(results)),
            ("summary.csv", tables::summary(results)),
            ("report.json", format!("{:#}\n", tables::json(results)).into_bytes()),
            ("report.html", comparison::page(results).into_bytes()),
        ],
    )
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
pub fn write_tuned(tuned: &Tuned, folder: &Path) -> Result<(), FileError> {
    write_figures(folder, tradeoff::figures(tuned))?;
    write(
        folder,
        [
            ("trials.csv", tradeoff::csv(tuned)),
            ("tradeoff.json", format!("{:#}\n", tradeoff::json(tuned)).into_bytes()),
            ("index.html", tradeoff::page(tuned).into_bytes()),
        ],
    )
}

/// Writes `study.html`, the page of a study of steering, into a folder, whole or not at all; and its plots, each by itself as
/// SVG and as PDF, into `figures/`. `engine` is what computed it.
///
/// # Errors
/// [`FileError`].
#[cfg(feature = "window")]
pub fn write_study(title: &str, engine: &str, study: &Study, folder: &Path) -> Result<(), FileError> {
    write_figures(folder, study::figures(study))?;
    write(folder, [("study.html", study::page(title, engine, study).into_bytes())])
}

/// Each plot by itself, under its name with dashes.
fn write_figures(folder: &Path, figures: impl IntoIterator<Item = (impl AsRef<str>, Plot)>) -> Result<(), FileError> {
    let folder = folder.join("figures");
    std::fs::create_dir_all(&folder).map_err(|e| FileError::write(&folder, e))?;
    for (name, plot) in figures {
        let words = name.as_ref().to_lowercase();
        let words: Vec<&str> = words.split(|c: char| !c.is_ascii_alphanumeric()).filter(|w| !w.is_empty()).collect();
        let name = words.join("-");
        write_file(&folder.join(format!("{name}.svg")), |out| out.write_all(plot.file().as_bytes()))?;
        write_file(&folder.join(format!("{name}.pdf")), |out| out.write_all(&plot.pdf()))?;
    }
    Ok(())
}

fn write<const N: usize>(folder: &Path, files: [(&str, Vec<u8>); N]) -> Result<(), FileError> {
    files.into_iter().try_for_each(|(name, bytes)| write_file(&folder.join(name), |out| out.write_all(&bytes)))
}
