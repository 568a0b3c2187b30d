//! Defines the errors of a session.

use crate::calibrate::CalibrateError;
use crate::encode::EncodeError;
use crate::engine::EngineError;
use crate::files::FileError;
use crate::gaze::GazeError;
use crate::hologram::HologramError;
use crate::present::PresentError;
use crate::present::plm::PlmError;
use crate::present::trigger::TriggerError;
use crate::solve::SolveError;
use crate::trackers::TrackerError;
use eyebox_base::error::Reason;

/// An error of a session.
#[derive(Debug, thiserror::Error, serde::Serialize)]
#[error(transparent)]
#[serde(tag = "code", content = "fields", rename_all = "kebab-case")]
#[non_exhaustive]
pub enum SessionError {
    /// The display refused to open or was lost.
    Present(#[from] PresentError),
    /// The controller of the display failed.
    Plm(#[from] PlmError),
    /// A trigger of the display failed.
    Trigger(#[from] TriggerError),
    /// The holograms caused an error.
    Hologram(#[from] HologramError),
    /// The encoding caused an error.
    Encode(#[from] EncodeError),
    /// An engine or the device of the encoder failed.
    Engine(#[from] EngineError),
    /// A file could not be read or written.
    File(#[from] FileError),
    /// The solver refused its input.
    Solve(#[from] SolveError),
    /// The tracker caused an error.
    Tracker(#[from] TrackerError),
    /// The calibration of a tracker or a setting of the gaze filter is not valid.
    Gaze(#[from] GazeError),
    /// The camera of a bench or the fit to its pictures failed.
    Calibrate(#[from] CalibrateError),
    /// The input of frames from an application failed.
    #[cfg(target_os = "linux")]
    #[serde(serialize_with = "eyebox_base::error::as_text")]
    LiveInput(#[from] eyebox_live_input::LiveError),
    /// A thread could not be started, or it failed.
    #[error("the thread that {what} {reason}")]
    Thread {
        /// The task of the thread, as a verb phrase.
        what: &'static str,
        /// The event that ended the thread.
        reason: String,
    },
    /// No pupil position was ever known for a live hologram that was to follow the eye.
    #[error("{tracker}: {reason}, so the hologram was not refined for a pupil")]
    NotFollowed {
        /// The description of the tracker.
        tracker: String,
        /// The state of its samples.
        reason: String,
    },
    /// The sidecar window next to the display failed.
    #[error("the window next to the display: {0}")]
    #[serde(rename = "companion")]
    SidecarWindow(Reason),
    /// A setting is not valid.
    #[error("{0}")]
    Setting(Reason),
}

impl From<Reason> for SessionError {
    fn from(reason: Reason) -> Self {
        Self::Setting(reason)
    }
}

impl SessionError {
    /// Returns true if the display refused or was lost, and nothing else is wrong.
    pub fn is_of_display(&self) -> bool {
        matches!(self, Self::Present(PresentError::Display { .. }))
    }
}
