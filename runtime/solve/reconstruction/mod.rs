//! Computes the image that an eye sees of a hologram, and compares it with the target image of the scene.
//!
//! A pupil looks at a [`PhaseSource`](crate::hologram::PhaseSource) ([`Hologram::look`](crate::hologram::Hologram::look)); a
//! [`SceneSource`] has the photographs of the scene through the same pupils, and [`HologramScores`] compare the two. [`SolveInput`] finds
//! the scene of a hologram again and reads it as it was when the hologram was solved.

mod error;
mod input;
mod jod;
mod look;
mod scene_source;
mod score;
mod seen;

pub use error::ReconstructionError;
pub use input::{InputOptions, SceneReading, SolveInput};
pub use jod::{FOVEA_DEGREES, JodSettings};
pub use look::Sampling;
pub use scene_source::SceneSource;
pub use score::{HologramScores, PupilScore};
