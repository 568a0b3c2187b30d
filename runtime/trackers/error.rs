//! What can be wrong with a tracker.

use super::hid::HidError;
use std::path::Path;

/// A source that cannot be opened or has failed for good.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum TrackerError {
    /// No source has such a name.
    #[error(
        "'{0}' is no tracker: use hid, FILE.hid, FILE.jsonl, pupil://HOST[:PORT], udp://[HOST]:PORT, mouse or simulated[:SEED]"
    )]
    Spec(String),
    /// A file cannot be used.
    #[error("{file}: {reason}")]
    File {
        /// The file.
        file: String,
        /// What is wrong, where, and what would be right.
        reason: String,
    },
    /// A HID device or its descriptor.
    #[error(transparent)]
    Hid(#[from] HidError),
    /// A network address or peer.
    #[error("{address}: {reason}")]
    Network {
        /// The address.
        address: String,
        /// What is wrong.
        reason: String,
    },
    /// A setting of a source.
    #[error("{0}")]
    Setting(String),
}

impl TrackerError {
    /// `file` cannot be used.
    pub fn file(file: &Path, reason: impl Into<String>) -> Self {
        Self::File { file: file.display().to_string(), reason: reason.into() }
    }
}
