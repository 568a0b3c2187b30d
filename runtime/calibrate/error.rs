//! What can go wrong while a display is calibrated.

use eyebox_base::error::Reason;
use eyebox_base::files::FileError;
use eyebox_compute::engine::EngineError;
use eyebox_optics::{Display, OpticsError};
use eyebox_scene::SceneError;
use eyebox_solve::quality::QualityError;
use std::io;
use std::path::Path;

/// Why a calibration ended without a model.
#[derive(Debug, thiserror::Error, serde::Serialize)]
#[error(transparent)]
#[serde(tag = "code", content = "fields", rename_all = "kebab-case")]
#[non_exhaustive]
pub enum CalibrateError {
    /// The camera's command is no list of words as a POSIX shell has them.
    #[error("the camera's command '{command}' has no words, or a quote that is not closed")]
    Words {
        /// Command as it was given.
        command: String,
    },
    /// It does not start.
    #[error("the camera's command '{program}' does not start: {source}")]
    Start {
        /// Its first word.
        program: String,
        /// Why.
        #[serde(serialize_with = "eyebox_base::error::as_text")]
        source: io::Error,
    },
    /// The bench is not the display's.
    #[error("the bench is not that of the display '{display}': {reason}")]
    Bench {
        /// The display's name.
        display: String,
        /// What the two say.
        reason: Reason,
    },
    /// The bench said why it could not do something that cannot be left out.
    #[error("the bench could not {what}: {text}")]
    Refused {
        /// What was asked of it.
        what: String,
        /// What it said.
        text: String,
    },
    /// The camera's command was lost once too often.
    #[error("the camera's command was lost {deaths} times, the last time because it {reason}")]
    Lost {
        /// How often.
        deaths: usize,
        /// What happened the last time.
        reason: Reason,
    },
    /// The user stopped it.
    #[error("the calibration was stopped: nothing is written")]
    Stopped,
    /// The folder of captures cannot be what it should be.
    #[error("{file}: {reason}")]
    Captures {
        /// The file.
        file: String,
        /// What is wrong, where, and what would be right.
        reason: Reason,
    },
    /// The pictures do not say what they have to.
    #[error("{0}")]
    Pictures(Reason),
    /// The display that shows the patterns.
    #[error("the patterns cannot be shown: {0}")]
    #[serde(serialize_with = "eyebox_base::error::as_text")]
    Shows(Box<dyn std::error::Error + Send + Sync>),
    /// What the fit is worth could not be measured.
    #[serde(rename = "quality")]
    Gain(#[from] QualityError),
    /// The scene by which that is measured.
    Scene(#[from] SceneError),
    /// A file.
    File(#[from] FileError),
    /// The engine that computes beside the camera.
    Engine(#[from] EngineError),
    /// The display.
    Optics(#[from] OpticsError),
}

impl From<Reason> for CalibrateError {
    fn from(reason: Reason) -> Self {
        Self::Pictures(reason)
    }
}

impl CalibrateError {
    pub(crate) fn bench(display: &Display, reason: Reason) -> Self {
        Self::Bench { display: display.name.clone(), reason }
    }

    pub(crate) fn captures(file: &Path, reason: Reason) -> Self {
        Self::Captures { file: file.display().to_string(), reason }
    }

    /// Whether the bench or the user ended it, and not what it was given.
    pub fn is_ended(&self) -> bool {
        matches!(self, Self::Stopped | Self::Lost { .. } | Self::Refused { .. } | Self::Shows(_))
    }
}
