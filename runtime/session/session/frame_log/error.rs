//! What can go wrong in a session.

use crate::calibrate::CalibrateError;
use crate::encode::EncodeError;
use crate::engine::EngineError;
use crate::files::FileError;
use crate::gaze::GazeError;
use crate::hologram::HologramError;
use crate::present::PresentError;
use crate::solve::SolveError;
use crate::trackers::TrackerError;
use eyebox_base::error::Reason;

/// What can go wrong in a session.
#[derive(Debug, thiserror::Error, serde::Serialize)]
#[error(transparent)]
#[serde(tag = "code", content = "fields", rename_all = "kebab-case")]
#[non_exhaustive]
pub enum SessionError {
    /// The display: refused, or lost.
    Present(#[from] PresentError),
    /// The holograms.
    Hologram(#[from] HologramError),
    /// The encoding.
    Encode(#[from] EncodeError),
    /// An engine, or the encoder's device.
    Engine(#[from] EngineError),
    /// A file.
    File(#[from] FileError),
    /// The solver refused.
    Solve(#[from] SolveError),
    /// A tracker.
    Tracker(#[from] TrackerError),
    /// A calibration, or a setting of the way from sample to pupil.
    Gaze(#[from] GazeError),
    /// The camera of a bench, or the fit to its pictures.
    Calibrate(#[from] CalibrateError),
    /// What takes an application's frames.
    #[cfg(target_os = "linux")]
    #[serde(serialize_with = "eyebox_base::error::as_text")]
    LiveInput(#[from] eyebox_live_input::LiveError),
    /// A thread that could not be started, or failed.
    #[error("the thread that {what} {reason}")]
    Thread {
        /// What it does.
        what: &'static str,
        /// What happened to it.
        reason: String,
    },
    /// Nothing was ever known of the eye that a live hologram was to follow.
    #[error("{tracker}: {reason}: the hologram followed nothing")]
    NotFollowed {
        /// The tracker.
        tracker: String,
        /// What it said, or did not.
        reason: String,
    },
    /// A window beside the display.
    #[error("the window beside the display: {0}")]
    #[serde(rename = "companion")]
    SidecarWindow(Reason),
    /// A setting that cannot be.
    #[error("{0}")]
    Setting(Reason),
}

impl From<Reason> for SessionError {
    fn from(reason: Reason) -> Self {
        Self::Setting(reason)
    }
}

impl SessionError {
    /// Whether the display was refused or lost, and nothing else is wrong.
    pub fn is_of_display(&self) -> bool {
        matches!(self, Self::Present(PresentError::Display { .. }))
    }
}
