//! What can be wrong with a film.

use eyebox::low_level::error::Reason;
use eyebox::low_level::files::FileError;
use eyebox::low_level::reconstruction::ReconstructionError;

/// What a path looks like, in one line.
pub(super) const EXAMPLE: &str = r#"{"rate_hz": 30, "keys": [{"t_s": 0, "x_mm": -4, "diameter_mm": 4, "focus": 0}, {"t_s": 2, "x_mm": 4, "focus": "0.01D"}], "blinks_s": [1]}"#;

/// What can be wrong with a film.
#[derive(Debug, thiserror::Error, serde::Serialize)]
#[error(transparent)]
#[serde(tag = "code", content = "fields", rename_all = "kebab-case")]
#[non_exhaustive]
pub enum FilmError {
    /// The file could not be written.
    File(#[from] FileError),
    /// The path of the eye.
    #[error("{file}: {reason}; such as {}", EXAMPLE)]
    Path {
        /// The file.
        file: String,
        /// What is wrong, and where.
        reason: Reason,
    },
    /// The hologram could not be looked at or scored.
    Reconstruction(#[from] ReconstructionError),
    /// Something that does not fit together.
    #[error("{0}")]
    Setting(Reason),
}
