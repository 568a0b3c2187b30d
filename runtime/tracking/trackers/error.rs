//! What can be wrong with a tracker.

use super::hid::HidError;
use eyebox_base::error::Reason;
use std::path::Path;

/// A source that cannot be opened or has failed for good.
#[derive(Debug, thiserror::Error, serde::Serialize)]
#[serde(tag = "code", content = "fields", rename_all = "kebab-case")]
#[non_exhaustive]
pub enum TrackerError {
    /// No source has such a name.
    #[error(
        "'{name}' is no tracker: use hid, FILE.hid, FILE.jsonl, pupil://HOST[:PORT], udp://[HOST]:PORT, mouse or simulated[:SEED]"
    )]
    Spec {
        /// Name as it was given.
        name: String,
    },
    /// A file cannot be used.
    #[error("{file}: {reason}")]
    File {
        /// The file.
        file: String,
        /// What is wrong, where, and what would be right.
        reason: Reason,
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
        reason: Reason,
    },
    /// Times of a recording without a unit, of which no tracker's rate or several are plausible.
    #[error(
        "{file}: its times advance by {step} per sample, which does not show their unit. Add it to the first line, as in \"t_unit\": \"ms\" (s, ms, us or ns)"
    )]
    TimeUnit {
        /// The file.
        file: String,
        /// The usual step from one time to the next, in their unit.
        step: f64,
    },
    /// Positions that are plausible in another unit only.
    #[error(
        "{name}: its pupil moves within {largest_mm:.4} mm, which no eye does. If positions are in metres, add \"unit\": \"m\" to them; if they are in millimetres, \"unit\": \"mm\""
    )]
    PositionUnit {
        /// The file or the address.
        name: String,
        /// The largest coordinate, in the unit that was taken.
        largest_mm: f64,
    },
    /// A setting of a source.
    #[error("{0}")]
    Setting(Reason),
}

impl TrackerError {
    /// `file` cannot be used.
    pub fn file(file: &Path, reason: impl Into<Reason>) -> Self {
        Self::File { file: file.display().to_string(), reason: reason.into() }
    }
}
