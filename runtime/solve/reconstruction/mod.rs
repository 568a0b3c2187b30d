//! Computes the image that an eye sees of a hologram, and compares it with the target image of the scene.
//!
//! [`Hologram::look`](crate::hologram::Hologram::look) simulates a [`PhaseSource`](crate::hologram::PhaseSource)
//! through a pupil. A [`SceneSource`] provides the target images of the scene through the same pupils, and
//! [`HologramScores`] compare the two. [`SolveInput`] finds the scene of a hologram and reads it as it was read for the
//! solve.
//!
//! The type [`ForwardModel`] has the same images with their derivatives, for optimizers outside of this library.

mod forward;
mod input;
mod jod;
mod look;
mod scene_source;
mod score;
mod seen;

pub use forward::ForwardModel;
pub use input::{InputOptions, SceneReading, SolveInput, drawer_for};
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
    /// A [`ForwardModel`] received a wrong number of values.
    #[error("the model has {expected} {what}, but {given} were given")]
    Count {
        /// The kind of the values, `phases` or `gradients`.
        what: &'static str,
        /// Number of given values.
        given: usize,
        /// Number of values of the model.
        expected: usize,
    },
    /// A phase given to a [`ForwardModel`] is infinite or NaN.
    #[error("the phase {phase} at sub-frame {frame}, row {row}, column {column} is not finite")]
    NotFinite {
        /// Index of the sub-frame.
        frame: usize,
        /// Index of the row.
        row: usize,
        /// Index of the column.
        column: usize,
        /// The phase that is infinite or NaN.
        phase: f32,
    },
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
