//! Predicts where the pupil will be when the light arrives, as a distribution, from the samples of a tracker.
//!
//! The way of a sample, each stage a file, pure, with times from outside, and each printable:
//!
//! 1. [`place`]: tracker coordinates to metres in the pupil plane, by a user's [`Calibration`] or the rotation of the
//!    eye, for both eyes, and what is implausible refused;
//! 2. [`one_euro`]: jitter is filtered, its lag known;
//! 3. [`saccade`]: a jump is noticed, and where it will land is said while it flies;
//! 4. [`Estimator`]: keeps these together, through blinks and losses (hold, then widen), and predicts.
//!
//! The result is a [`PupilDistribution`](eyebox_optics::PupilDistribution), not a point: that is what a solver draws pupils from, and its spread is a
//! promise that is tested.

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

/// What can be wrong with a calibration or a setting.
#[derive(Debug, Clone, PartialEq, thiserror::Error, serde::Serialize)]
#[serde(tag = "code", content = "fields", rename_all = "kebab-case")]
#[non_exhaustive]
pub enum GazeError {
    /// Too few fixations, or all on a line.
    #[error("a calibration needs at least 4 fixations that are not on a line{0}")]
    TooFew(String),
    /// The fixations do not agree with each other.
    #[error(
        "the fixations do not fit together: they are {rms_mm:.2} mm off on average, {limit_mm:.1} mm at most; repeat them"
    )]
    Disagree {
        /// Root mean square of what is left, mm.
        rms_mm: f64,
        /// What is accepted, mm.
        limit_mm: f64,
    },
    /// A file cannot be used.
    #[error("{file}: {reason}")]
    File {
        /// The file.
        file: String,
        /// What is wrong, where, and what would be right.
        reason: Reason,
    },
    /// A setting is out of its range.
    #[error("{0}")]
    Setting(Reason),
}

impl GazeError {
    /// `file` cannot be used.
    fn file(file: &Path, reason: impl Into<Reason>) -> Self {
        Self::File { file: file.display().to_string(), reason: reason.into() }
    }
}
