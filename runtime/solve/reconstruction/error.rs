//! Why a hologram could not be looked at or scored.

use crate::engine::EngineError;
use crate::evaluate::EvaluateError;
use crate::files::FileError;
use crate::hologram::HologramError;
use crate::optics::OpticsError;

/// Why a hologram could not be looked at or scored.
// Exhaustive, so that every crate maps each variant to one of its own errors.
#[derive(Debug, thiserror::Error, serde::Serialize)]
#[serde(tag = "code", content = "fields", rename_all = "kebab-case")]
pub enum ReconstructionError {
    /// The hologram, its optics or its file.
    #[error(transparent)]
    Hologram(#[from] HologramError),
    /// The engine.
    #[error(transparent)]
    Engine(#[from] EngineError),
    /// A measure of the difference.
    #[error(transparent)]
    Evaluate(#[from] EvaluateError),
}

impl From<OpticsError> for ReconstructionError {
    fn from(error: OpticsError) -> Self {
        Self::Hologram(error.into())
    }
}

impl From<FileError> for ReconstructionError {
    fn from(error: FileError) -> Self {
        Self::Hologram(error.into())
    }
}
