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

pub use descent::{CameraGain, CameraJob};
pub use pictures::CameraBench;
