//! Measures the cost and the quality of settings on one color of a scene.
//!
//! [`Settings`](crate::solve::Settings) hold every setting that trades quality for time. A [`ColorJob`] is one color of a
//! scene that they are tried on; a [`Reference`] scores what came of it, the same truth for all. A [`ModelWorth`] says what each
//! term of a display's model is worth.

mod color_job;
mod model_worth;
mod recipe;
mod reference;

pub use color_job::{ColorJob, Prepared, Solved};
pub use model_worth::ModelWorth;
pub use reference::{PUPILS as REFERENCE_PUPILS, Reference};

use crate::engine::EngineError;
use crate::evaluate::EvaluateError;
use crate::files::FileError;
use crate::hologram::HologramError;
use crate::optics::OpticsError;
use crate::reconstruction::ReconstructionError;
use crate::solve::SolveError;
use eyebox_base::error::Reason;
use serde::{Deserialize, Serialize};

/// How much time quality may take.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[non_exhaustive]
pub enum Quality {
    /// At least twenty times faster than accurate.
    Fast,
    /// Within half a decibel of accurate, in at most a fifth of its time.
    Balanced,
    /// The best that there is time for.
    Accurate,
}

impl Quality {
    /// All three, the fastest first.
    pub const ALL: [Self; 3] = [Self::Fast, Self::Balanced, Self::Accurate];

    /// The name by which it is chosen.
    pub fn name(self) -> &'static str {
        ["fast", "balanced", "accurate"][self as usize]
    }
}

/// Why settings could not be tried, or methods not compared.
#[derive(Debug, thiserror::Error, serde::Serialize)]
#[error(transparent)]
#[serde(tag = "code", content = "fields", rename_all = "kebab-case")]
#[non_exhaustive]
pub enum QualityError {
    /// The display, or a colour that it does not have.
    Optics(#[from] OpticsError),
    /// The solve.
    Solve(#[from] SolveError),
    /// The engine.
    Engine(#[from] EngineError),
    /// A measure of what was seen.
    Evaluate(#[from] EvaluateError),
    /// A hologram.
    Hologram(#[from] HologramError),
    /// The reconstruction of a hologram.
    Reconstruction(#[from] ReconstructionError),
    /// A file of results.
    File(#[from] FileError),
    /// A view that is no picture.
    #[error("a view has pixels that are NaN: there is nothing to compare")]
    NotFinite,
    /// Something given that cannot be used.
    #[error("{what}: {reason}")]
    Input {
        /// The file, or the setting.
        what: String,
        /// What is wrong with it, and what would be right.
        reason: Reason,
    },
}
