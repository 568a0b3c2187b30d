//! Measures the cost and the quality of settings on one color of a scene.
//!
//! [`Settings`](crate::solve::Settings) hold every setting that trades quality for time. A [`ColorJob`] is one color of
//! a scene on which they are tested. A [`Reference`] scores the results in the same way for all. A [`ModelWorth`]
//! measures the gain of each term of a display model.

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

/// The time that quality may take.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[non_exhaustive]
pub enum Quality {
    /// At least twenty times faster than accurate.
    Fast,
    /// Within half a decibel of accurate, in at most a fifth of its time.
    Balanced,
    /// The highest quality in a practical time.
    Accurate,
}

impl Quality {
    /// All three qualities, the fastest first.
    pub const ALL: [Self; 3] = [Self::Fast, Self::Balanced, Self::Accurate];

    /// Returns the name by which it is chosen.
    pub fn name(self) -> &'static str {
        ["fast", "balanced", "accurate"][self as usize]
    }
}

/// The reason why settings could not be tested, or methods not compared.
#[derive(Debug, thiserror::Error, serde::Serialize)]
#[error(transparent)]
#[serde(tag = "code", content = "fields", rename_all = "kebab-case")]
#[non_exhaustive]
pub enum QualityError {
    /// The display is invalid, or lacks a color.
    Optics(#[from] OpticsError),
    /// The solve ended with an error.
    Solve(#[from] SolveError),
    /// The engine reported a failure.
    Engine(#[from] EngineError),
    /// A measure of an image failed.
    Evaluate(#[from] EvaluateError),
    /// A hologram is invalid.
    Hologram(#[from] HologramError),
    /// The reconstruction of a hologram failed.
    Reconstruction(#[from] ReconstructionError),
    /// A file of results is unusable.
    File(#[from] FileError),
    /// A view is not finite.
    #[error("the views: a pixel is NaN, so they cannot be compared")]
    NotFinite,
    /// An input is unusable.
    #[error("{what}: {reason}")]
    Input {
        /// The file or the setting.
        what: String,
        /// The fault and its remedy.
        reason: Reason,
    },
}
