//! Defines the errors of a film.

use eyebox::low_level::error::Reason;
use eyebox::low_level::files::FileError;
use eyebox::low_level::reconstruction::ReconstructionError;

/// An example of a path, in one line.
pub(super) const EXAMPLE: &str = r#"{"rate_hz": 30, "keys": [{"t_s": 0, "x_mm": -4, "diameter_mm": 4, "focus": 0}, {"t_s": 2, "x_mm": 4, "focus": "0.01D"}], "blinks_s": [1]}"#;

/// Errors of a film.
#[derive(Debug, thiserror::Error, serde::Serialize)]
#[error(transparent)]
#[serde(tag = "code", content = "fields", rename_all = "kebab-case")]
#[non_exhaustive]
pub enum FilmError {
    /// The file could not be written.
    File(#[from] FileError),
    /// The path of the eye is invalid.
    #[error("{file}: {reason}. Example: {}", EXAMPLE)]
    Path {
        /// The file of the path.
        file: String,
        /// The problem and its place.
        reason: Reason,
    },
    /// The hologram could not be rendered or scored.
    Reconstruction(#[from] ReconstructionError),
    /// Settings or contents do not fit together.
    #[error("{0}")]
    Setting(Reason),
}
