//! Runs the last steps of a solve with a camera's pictures (camera in the loop, Peng et al. 2020).
//!
//! After a solve, the light that the camera sees through each pupil of a step replaces the simulated intensity. The
//! gradient uses the fitted model. This also corrects faults that the model has no term for, as far as they show in
//! pictures.
//!
//! Pictures through pupils that no step uses judge the result. A hologram is kept only if they show that it is better.

mod descent;
mod pictures;
mod registration;
mod sensor;

pub use descent::{CameraGain, CameraJob};
pub use pictures::CameraBench;
