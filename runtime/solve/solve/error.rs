//! Errors of a solve.

use crate::engine::EngineError;
use crate::optics::OpticsError;
use crate::scene::SceneError;
use eyebox_base::error::Reason;

/// The cause of a failed solve.
#[derive(Debug, thiserror::Error, serde::Serialize)]
#[error(transparent)]
#[serde(tag = "code", content = "fields", rename_all = "kebab-case")]
#[non_exhaustive]
pub enum SolveError {
    /// A setting has an invalid value.
    #[error("{what} is {value}: it must be {right}")]
    Setting {
        /// The setting and its unit.
        what: &'static str,
        /// The invalid value as text.
        value: String,
        /// A description of the valid values.
        right: &'static str,
    },
    /// The text of the settings is invalid.
    #[error("the settings: {0}")]
    Text(Reason),
    /// The scene lacks data that the solve needs.
    Scene(#[from] SceneError),
    /// The display does not have this color or size.
    Optics(#[from] OpticsError),
    /// The engine failed during the solve.
    Engine(#[from] EngineError),
}

/// Returns an error for the `value` of a setting unless it `fits`. `right` describes the valid values.
pub(super) fn require(
    fits: bool,
    what: &'static str,
    value: impl ToString,
    right: &'static str,
) -> Result<(), SolveError> {
    if fits { Ok(()) } else { Err(SolveError::Setting { what, value: value.to_string(), right }) }
}
