//! Lists the errors of a tracker.

use super::hid::HidError;
use eyebox_base::error::Reason;
use std::path::Path;

/// A source cannot be opened or has failed permanently.
#[derive(Debug, thiserror::Error, serde::Serialize)]
#[serde(tag = "code", content = "fields", rename_all = "kebab-case")]
#[non_exhaustive]
pub enum TrackerError {
    /// No source has this name.
    #[error(
        "'{name}' is not a tracker: use hid, FILE.hid, FILE.jsonl, pupil://HOST[:PORT], udp://[HOST]:PORT, mouse or simulated[:SEED]"
    )]
    Spec {
        /// The name as it was given.
        name: String,
    },
    /// A file cannot be used.
    #[error("{file}: {reason}")]
    File {
        /// The file with the problem.
        file: String,
        /// The problem, its place and the remedy.
        reason: Reason,
    },
    /// A HID device or its descriptor cannot be used.
    #[error(transparent)]
    Hid(#[from] HidError),
    /// A network address or peer cannot be used.
    #[error("{address}: {reason}")]
    Network {
        /// The address of the peer.
        address: String,
        /// The problem of the address.
        reason: Reason,
    },
    /// The times of a recording have no unit, and either no unit or several units give a plausible rate.
    #[error(
        "{file}: its times advance by {step} per sample, which does not show their unit. Add it to the first line, as in \"t_unit\": \"ms\" (s, ms, us or ns)"
    )]
    TimeUnit {
        /// The file with the times.
        file: String,
        /// The usual step between consecutive times, in their unit.
        step: f64,
    },
    /// The positions are plausible in another unit only.
    #[error(
        "{name}: its pupil moves within {largest_mm:.4} mm, which no eye does. If positions are in meters, add \"unit\": \"m\" to them, or \"unit\": \"mm\" if they are in millimeters"
    )]
    PositionUnit {
        /// The file or the address.
        name: String,
        /// The largest coordinate in the assumed unit, mm.
        largest_mm: f64,
    },
    /// A setting of a source is wrong.
    #[error("{0}")]
    Setting(Reason),
}

impl TrackerError {
    /// The error for a `file` that cannot be used.
    pub fn file(file: &Path, reason: impl Into<Reason>) -> Self {
        Self::File { file: file.display().to_string(), reason: reason.into() }
    }
}
