//! Computes the image that an eye sees of a hologram, and compares it with the target image of the scene.
//!
//! A pupil looks at a [`PhaseSource`](crate::hologram::PhaseSource) ([`Hologram::look`](crate::hologram::Hologram::look)); a
//! [`SceneSource`] has the photographs of the scene through the same pupils, and [`HologramScores`] compare the two. [`SolveInput`] finds
//! the scene of a hologram again and reads it as it was when the hologram was solved.

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

/// Why a hologram could not be looked at or scored.
#[derive(Debug, thiserror::Error, serde::Serialize)]
#[error(transparent)]
#[serde(tag = "code", content = "fields", rename_all = "kebab-case")]
pub enum ReconstructionError {
    /// The hologram, its optics or its file.
    Hologram(#[from] HologramError),
    /// The engine.
    Engine(#[from] EngineError),
    /// A measure of the difference.
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
