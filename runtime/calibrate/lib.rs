//! Fits a model of a real display to pictures that a camera took of it (OPTICS 10).
//!
//! A camera's command, a folder of its pictures, or both are a *bench*. [`calibrate`] plans the patterns, requests the
//! pictures and fits the numbers in the order in which the pictures separate them. Dots locate the camera. Smooth
//! patterns give the source and the wavefront. Random patterns through several irises give crosstalk, table and zero
//! order (undiffracted light). Sets give lag. The last fit frees all numbers. Pictures that were taken twice are not
//! fitted. They measure the camera's noise and the share of the pictures that the model leaves unexplained.
//!
//! The modules `message`, `link` and `captures` are the protocol. The patterns are in `pattern`. Both `dots` and `map`
//! find where the camera looks. `device` and `seen` are the forward model with its slopes. `fit` has the least squares.
//! `camera_steps` uses the camera in the last steps of a solve.

mod acquire;
mod age;
mod aligned;
mod bench;
mod calibrated;
mod camera_steps;
mod captures;
mod classified;
mod device;
mod directions;
mod dots;
mod error;
mod even;
mod figures;
mod fit;
mod follower;
#[cfg(test)]
mod forward_tests;
mod gain;
mod holdout;
mod iris_edge;
mod link;
mod map;
mod mend;
mod message;
mod noise;
mod orders;
mod parameters;
mod pattern;
mod picture;
mod pieces;
mod report;
mod residual;
mod seen;
mod slopes;
mod stages;
mod terms;
mod verdict;
mod views;

pub use acquire::TAKING;
pub use age::ModelAge;
pub use bench::{Bench, CameraCommand, Event, FEWEST, ShowsPatterns};
pub use calibrated::Calibration;
pub use camera_steps::{CameraBench, CameraGain, CameraJob};
pub use directions::{Directions, PhaseSign};
pub use error::CalibrateError;
pub use figures::{Aberration, Figures, IrisFound, Kernel, Map, Table, Wavefront, ZeroOrder};
pub use follower::{Follower, Look};
pub use gain::Gain;
pub use mend::Mend;
pub use report::{Confused, Fitted, Report};
pub use residual::{HoldoutPicture, PictureLeft, ResidualMap};
pub use verdict::Verdict;

use eyebox_optics::{Color, Display};
use std::cell::RefCell;
use std::time::Instant;

/// Fits the model of one color of a display to pictures of it. The fit starts at the display's own model. `shows` shows
/// the patterns if the camera's command does not.
///
/// # Errors
/// [`CalibrateError`]. Only pictures were written then.
pub fn calibrate(
    display: &Display,
    color: Color,
    bench: &Bench,
    shows: Option<&mut dyn ShowsPatterns>,
    observe: &mut dyn FnMut(Event),
) -> Result<Calibration, CalibrateError> {
    let begun = Instant::now();
    let observe = RefCell::new(observe);
    let tell = |event: Event| (observe.borrow_mut())(event);
    let taken = match bench {
        Bench::Folder { folder, iris_mm } => acquire::read(display, color, folder, *iris_mm)?,
        Bench::Command { .. } => acquire::take(display, color, bench, shows, &tell)?,
    };
    let waited = taken.waited;
    let quick = matches!(bench, Bench::Command { quick: true, .. });
    let mut calibrated = stages::run(display, color, taken, quick, &tell)?;
    calibrated.report.seconds = (begun.elapsed().saturating_sub(waited)).as_secs_f64();
    Ok(calibrated)
}
