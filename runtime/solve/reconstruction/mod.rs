//! Computes the image that an eye sees of a hologram, and compares it with the target image of the scene.
//!
//! [`Hologram::look`](crate::hologram::Hologram::look) simulates a [`PhaseSource`](crate::hologram::PhaseSource)
//! through a pupil. A [`SceneSource`] provides the target images of the scene through the same pupils, and
//! [`HologramScores`] compare the two. [`SolveInput`] finds the scene of a hologram and reads it as it was read for the
//! solve.

mod input;
mod jod;
mod look;
mod scene_source;
mod score;
mod seen;

pub use input::{InputOptions, SceneReading, SolveInput};
pub use jod::{FOVEA_DEGREES, JodSettings};
pub use look::Sampling;
pub use scene_source::SceneSource;
pub use score::{HologramScores, PupilScore};

use crate::engine::EngineError;
use crate::evaluate::EvaluateError;
use crate::files::FileError;
use crate::hologram::HologramError;
use crate::optics::OpticsError;

/// The reason why a hologram could not be simulated or scored.
#[derive(Debug, thiserror::Error, serde::Serialize)]
#[error(transparent)]
#[serde(tag = "code", content = "fields", rename_all = "kebab-case")]
pub enum ReconstructionError {
    /// An error of the hologram, its optics or its file.
    Hologram(#[from] HologramError),
    /// An error of the engine.
    Engine(#[from] EngineError),
    /// An error of a measure.
    Evaluate(#[from] EvaluateError),
}

impl From<OpticsError> for ReconstructionError {
    fn from(error: OpticsError) -> Self {
        Self::Hologram(error.into())
    }
}

impl From<FileError> for ReconstructionError {
    fn from(error: FileError) -> Self {
        Self::Hologram(error.into())
    }
}
