//! Predicts where the pupil will be when the light arrives, as a distribution, from the samples of a tracker.
//!
//! A sample passes four stages. Each stage has a file, is pure, receives its times from outside, and can be printed:
//!
//! 1. The module [`place`] maps tracker coordinates to meters in the pupil plane by a user's [`Calibration`] or by the rotation
//!    of the eye. It handles both eyes and refuses implausible samples.
//! 2. The module [`one_euro`] filters jitter with a known lag.
//! 3. The module [`saccade`] detects a saccade and predicts its landing during the flight.
//! 4. The [`Estimator`] connects the stages, bridges blinks and losses (it holds, then widens), and predicts.
//!
//! The result is a [`PupilDistribution`](eyebox_optics::PupilDistribution), not a point. A solver draws pupils from it,
//! and tests check that its spread is correct.

pub mod one_euro;
pub mod place;
pub mod saccade;

mod calibration;
#[cfg(test)]
mod calibration_tests;
mod estimator;
#[cfg(test)]
mod eyes_tests;
mod settings;
mod stages;
#[cfg(test)]
mod tests;
#[cfg(test)]
mod velocity_tests;

pub use calibration::{Affine, Calibration, Fit, Pair};
pub use estimator::{Estimator, EyeVelocity};
pub use settings::{Eye, Eyepiece, Settings};
pub use stages::{Phase, Stages};

use eyebox_base::error::Reason;
use std::path::Path;

/// An error of a calibration or a setting.
#[derive(Debug, Clone, PartialEq, thiserror::Error, serde::Serialize)]
#[serde(tag = "code", content = "fields", rename_all = "kebab-case")]
#[non_exhaustive]
pub enum GazeError {
    /// There are too few fixations, or all are on a line.
    #[error("a calibration needs at least 4 fixations that are not on a line{0}")]
    TooFew(String),
    /// The fixations contradict each other.
    #[error("the fixations are {rms_mm:.2} mm off on average, but the limit is {limit_mm:.1} mm. Repeat them")]
    Disagree {
        /// Root mean square distance from the map, mm.
        rms_mm: f64,
        /// The largest accepted value, mm.
        limit_mm: f64,
    },
    /// A file cannot be used.
    #[error("{file}: {reason}")]
    File {
        /// The file with the problem.
        file: String,
        /// The problem, its place and the remedy.
        reason: Reason,
    },
    /// A setting is out of its range.
    #[error("{0}")]
    Setting(Reason),
}

impl GazeError {
    /// The error for a `file` that cannot be used.
    fn file(file: &Path, reason: impl Into<Reason>) -> Self {
        Self::File { file: file.display().to_string(), reason: reason.into() }
    }
}
