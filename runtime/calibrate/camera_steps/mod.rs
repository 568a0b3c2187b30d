//! Steps with a camera's pictures (camera in the loop, Peng et al. 2020): after a solve, what the camera sees through each pupil
//! of a step takes the place of the simulated intensity, and the way back is the fitted model's. So what the model has no
//! term for is corrected as well, as far as it shows in pictures.
//!
//! What comes of it is judged by pictures through pupils that no step uses; a hologram that they do not show to be better is
//! not kept.

mod descent;
mod pictures;
mod registration;
mod sensor;

pub use descent::{CameraGain, CameraSubject};
pub use pictures::CameraBench;

use std::path::Path;
use std::time::Duration;

/// What steps with a camera are to be.
#[derive(Debug, Clone, Copy)]
pub struct CameraSteps<'a> {
    /// The camera's command: its words, as a POSIX shell splits them; no shell runs it.
    pub command: &'a str,
    /// Steps of each colour.
    pub steps: usize,
    /// Where the pictures are kept. In a folder that a calibration kept they are added to its own, and its picture of the dots
    /// is not taken again.
    pub keep: Option<&'a Path>,
    /// Limit for every question, in the place of the protocol's own.
    pub limit: Option<Duration>,
    /// Where an iris stands that does not move: x, y, diameter, mm; where the command does not say so itself.
    pub iris_mm: Option<[f64; 3]>,
}
