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

impl ReconstructionError {
    /// Returns the wrapped error as an error of the caller, which wraps the same three.
    pub fn unwrapped<E: From<HologramError> + From<EngineError> + From<EvaluateError>>(self) -> E {
        match self {
            Self::Hologram(error) => error.into(),
            Self::Engine(error) => error.into(),
            Self::Evaluate(error) => error.into(),
        }
    }
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
