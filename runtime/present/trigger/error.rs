//! Defines the errors of triggers.

use eyebox_base::error::Reason;

/// An error of a trigger.
#[derive(Debug, Clone, PartialEq, thiserror::Error, serde::Serialize)]
#[serde(tag = "code", content = "fields", rename_all = "kebab-case")]
#[non_exhaustive]
pub enum TriggerError {
    /// A value of the display file is not valid.
    #[error("{0}")]
    Setting(Reason),
    /// This system or this build has no such line.
    #[error("{reason}")]
    Unsupported {
        /// The reason and the remedy.
        reason: String,
    },
    /// The line could not be opened.
    #[error("the trigger {port} could not be opened ({reason})")]
    Open {
        /// The place of the line.
        port: String,
        /// The message of the system.
        reason: String,
    },
    /// The line failed after it was opened.
    #[error("the trigger {port} failed ({reason})")]
    Failed {
        /// The place of the line.
        port: String,
        /// The message of the system.
        reason: String,
    },
}

impl TriggerError {
    pub(super) fn open(port: &str, reason: impl ToString) -> Self {
        Self::Open { port: port.into(), reason: reason.to_string() }
    }

    pub(super) fn failed(port: &str, reason: impl ToString) -> Self {
        Self::Failed { port: port.into(), reason: reason.to_string() }
    }
}
