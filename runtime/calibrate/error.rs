//! Lists the errors of a calibration.

use eyebox_base::error::Reason;
use eyebox_base::files::FileError;
use eyebox_compute::engine::EngineError;
use eyebox_optics::{Display, OpticsError};
use eyebox_scene::SceneError;
use eyebox_solve::quality::QualityError;
use std::io;
use std::path::Path;

/// The reason why a calibration ended without a model.
#[derive(Debug, thiserror::Error, serde::Serialize)]
#[error(transparent)]
#[serde(tag = "code", content = "fields", rename_all = "kebab-case")]
#[non_exhaustive]
pub enum CalibrateError {
    /// The camera's command cannot be split into words as a POSIX shell does.
    #[error("the camera's command '{command}': no words, or a quote that is not closed")]
    Words {
        /// The command as it was given.
        command: String,
    },
    /// The camera's command does not start.
    #[error("the camera's command '{program}' does not start: {source}")]
    Start {
        /// The first word of the command.
        program: String,
        /// The error of the operating system.
        #[serde(serialize_with = "eyebox_base::error::as_text")]
        source: io::Error,
    },
    /// The bench does not match the display.
    #[error("the bench does not match the display '{display}': {reason}")]
    Bench {
        /// The name of the display.
        display: String,
        /// The difference between the two.
        reason: Reason,
    },
    /// The bench refused a step that cannot be left out.
    #[error("the bench could not {what}: {text}")]
    Refused {
        /// The step that was requested.
        what: String,
        /// The text of the bench.
        text: String,
    },
    /// The camera's command was lost too often.
    #[error("the camera's command was lost {deaths} times, the last time because it {reason}")]
    Lost {
        /// The number of losses.
        deaths: usize,
        /// The reason of the last loss.
        reason: Reason,
    },
    /// The user stopped the calibration.
    #[error("the calibration was stopped: nothing is written")]
    Stopped,
    /// The folder of captures has invalid content.
    #[error("{file}: {reason}")]
    Captures {
        /// The file with the problem.
        file: String,
        /// The problem, its place and the remedy.
        reason: Reason,
    },
    /// The pictures do not contain the information that the fit needs.
    #[error("{0}")]
    Pictures(Reason),
    /// The display that shows the patterns failed.
    #[error("the patterns cannot be shown: {0}")]
    #[serde(serialize_with = "eyebox_base::error::as_text")]
    Shows(Box<dyn std::error::Error + Send + Sync>),
    /// The gain of the calibration could not be measured.
    #[serde(rename = "quality")]
    Gain(#[from] QualityError),
    /// The scene of that measurement could not be loaded.
    Scene(#[from] SceneError),
    /// A file could not be read or written.
    File(#[from] FileError),
    /// The engine that computes next to the camera failed.
    Engine(#[from] EngineError),
    /// The display or the color is not possible.
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

    /// True if the bench or the user ended the calibration. The input was not the cause then.
    pub fn is_ended(&self) -> bool {
        matches!(self, Self::Stopped | Self::Lost { .. } | Self::Refused { .. } | Self::Shows(_))
    }
}
