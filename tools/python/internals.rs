//! Names the items of the library that this package needs and that the facade does not have.
//!
//! They are the camera in a solve, quantities in words, the values of a scene for copies of it, stored pictures,
//! measured depths, pupils for scores, and forecasts of a solve.

pub(crate) use eyebox::low_level::calibrate::{CameraBench, CameraCommand, CameraGain, CameraJob, Event};
pub(crate) use eyebox::low_level::evaluate::members;
pub(crate) use eyebox::low_level::files::{Samples, Wanted, read_pixels};
pub(crate) use eyebox::low_level::hologram::TakenWithCamera;
pub(crate) use eyebox::low_level::quantity::{Quantity, QuantityError, Unit, read_size};
pub(crate) use eyebox::low_level::scene::{DepthSource, LightField, MadeViews, ViewSynthesis};
pub(crate) use eyebox::low_level::scene::{central_depth, contact_sheet};
pub(crate) use eyebox::low_level::solve::{Loaded, PupilRange, Rates, Sampler, ScenePlan, forecast};
