//! The report of an evaluation: one page that opens from disk, and the same numbers as CSV and JSON.
//!
//! [`Report`] is plain data and knows its statistics ([`stats`]); `claims` checks what the paper says against them;
//! `page` lays all of it out with `plots`, which draw through `svg`; `tables` writes the CSV and JSON. Nothing here
//! computes light.

mod about;
mod claims;
mod page;
mod pictures;
mod plots;
mod published;
mod stats;
pub mod svg;
mod tables;

pub use about::{About, MethodAbout};
pub use page::document;
pub use published::Published;
pub use stats::Series;
pub use tables::json;

use crate::Failure;
use crate::evaluate::figures::{Run, SceneFigures, SpeckleFigures};
use eyebox::files::write_file;
use std::path::Path;

/// Everything that a report shows.
pub struct Report {
    /// What was compared, on what.
    pub about: About,
    /// The methods, in their order.
    pub methods: Vec<MethodAbout>,
    /// The scenes.
    pub scenes: Vec<SceneFigures>,
    /// Every hologram against its scene.
    pub runs: Vec<Run>,
    /// Speckle of an even plane.
    pub speckle: Vec<SpeckleFigures>,
    /// Numbers from elsewhere, drawn beside.
    pub published: Vec<Published>,
    /// Results that are not there yet.
    pub missing: usize,
}

impl Report {
    /// With nothing measured yet.
    pub fn new(about: About, methods: Vec<MethodAbout>) -> Self {
        Self {
            about,
            methods,
            scenes: Vec::new(),
            runs: Vec::new(),
            speckle: Vec::new(),
            published: Vec::new(),
            missing: 0,
        }
    }
}

/// Writes `report.html`, `scores.csv`, `summary.csv` and `report.json` into a folder, each whole or not at all.
pub fn write(report: &Report, folder: &Path) -> Result<(), Failure> {
    let files = [
        ("scores.csv", tables::scores(report)),
        ("summary.csv", tables::summary(report)),
        ("report.json", format!("{:#}\n", json(report)).into_bytes()),
        ("report.html", page::html(report).into_bytes()),
    ];
    for (name, bytes) in files {
        write_file(&folder.join(name), |out| out.write_all(&bytes))?;
    }
    Ok(())
}
