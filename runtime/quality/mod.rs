//! Speed against accuracy: what a solve costs, how good it is, and which settings are worth their time.
//!
//! [`Settings`](crate::solve::Settings) hold every setting that trades quality for time. A [`Subject`] is one colour of a
//! scene that they are tried on; a [`Reference`] scores what came of it, the same truth for all. A [`Tuning`] tries a grid of
//! them, [`front`](fn@front) says which trials none beats, [`recommend`] which three of them are `fast`, `balanced` and
//! `accurate`; [`Measured`] keeps them for this device in the user's cache.
//!
//! `comparison` (with the feature `reports`) compares methods: every method, every group of pupils.
//!
//! May import everything that `hologram` may, and `hologram`.

mod choice;
#[cfg(feature = "reports")]
pub mod comparison;
mod front;
mod grid;
mod kept;
mod measured;
mod model_worth;
mod recipe;
mod reference;
mod subject;
mod tune;
mod tuned;
mod watch;

pub use choice::{Recommended, recommend, within};
pub(crate) use front::short_of;
pub use front::{Trial, front};
pub use kept::writable;
pub use measured::{Measured, MeasuredError};
pub use model_worth::ModelWorth;
pub use reference::{PUPILS as REFERENCE_PUPILS, Reference};
pub use subject::{Prepared, Solved, Subject};
pub use tune::Tuning;
pub use tuned::{Checked, LevelRow, NEAR_DB, Tuned};
pub use watch::Observe;

use crate::engine::EngineError;
use crate::evaluate::EvaluateError;
use crate::files::FileError;
use crate::hologram::HologramError;
use crate::optics::OpticsError;
use crate::solve::SolveError;
use serde::{Deserialize, Serialize};

/// How much time quality may take.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[non_exhaustive]
pub enum Quality {
    /// At least twenty times faster than accurate.
    Fast,
    /// Within half a decibel of accurate, in at most a fifth of its time.
    Balanced,
    /// The best that there is time for.
    Accurate,
}

impl Quality {
    /// All three, the fastest first.
    pub const ALL: [Self; 3] = [Self::Fast, Self::Balanced, Self::Accurate];

    /// The name by which it is chosen.
    pub fn name(self) -> &'static str {
        ["fast", "balanced", "accurate"][self as usize]
    }
}

/// Why settings could not be tried, or methods not compared.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum QualityError {
    /// The display, or a colour that it does not have.
    #[error(transparent)]
    Optics(#[from] OpticsError),
    /// The solve.
    #[error(transparent)]
    Solve(#[from] SolveError),
    /// The engine.
    #[error(transparent)]
    Engine(#[from] EngineError),
    /// A measure of what was seen.
    #[error(transparent)]
    Evaluate(#[from] EvaluateError),
    /// A hologram.
    #[error(transparent)]
    Hologram(#[from] HologramError),
    /// A file of results.
    #[error(transparent)]
    File(#[from] FileError),
    /// A view that is no picture.
    #[error("a view has pixels that are NaN: there is nothing to compare")]
    NotFinite,
    /// Something given that cannot be used.
    #[error("{what}: {reason}")]
    Input {
        /// The file, or the setting.
        what: String,
        /// What is wrong with it, and what would be right.
        reason: String,
    },
}
