//! Names the items of the library that this package needs and that the facade does not have.
//!
//! They are the camera in a solve, quantities in words, and the values of a scene for copies of it.

pub(crate) use eyebox::low_level::calibrate::{CameraBench, CameraCommand, CameraGain, CameraJob, Event};
pub(crate) use eyebox::low_level::hologram::TakenWithCamera;
pub(crate) use eyebox::low_level::quantity::{Quantity, QuantityError, Unit, read_size};
pub(crate) use eyebox::low_level::scene::{LightField, MadeViews, ViewSynthesis};
