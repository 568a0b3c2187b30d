//! What can be wrong with a solve.

use crate::engine::EngineError;
use crate::optics::OpticsError;
use crate::scene::SceneError;
use eyebox_base::error::Reason;

/// Why a solve failed.
#[derive(Debug, thiserror::Error, serde::Serialize)]
#[error(transparent)]
#[serde(tag = "code", content = "fields", rename_all = "kebab-case")]
#[non_exhaustive]
pub enum SolveError {
    /// A setting that cannot be.
    #[error("{what} is {value}: it must be {right}")]
    Setting {
        /// Which, with its unit.
        what: &'static str,
        /// Its value.
        value: String,
        /// What would be right.
        right: &'static str,
    },
    /// Settings as text that cannot be read.
    #[error("the settings: {0}")]
    Text(Reason),
    /// A scene that does not tell what is needed of it.
    Scene(#[from] SceneError),
    /// A colour or a size that the display does not have.
    Optics(#[from] OpticsError),
    /// From the engine.
    Engine(#[from] EngineError),
}

/// Refuses the `value` of a setting unless it `fits`; `right` says which values do.
pub(super) fn require(
    fits: bool,
    what: &'static str,
    value: impl ToString,
    right: &'static str,
) -> Result<(), SolveError> {
    if fits { Ok(()) } else { Err(SolveError::Setting { what, value: value.to_string(), right }) }
}
