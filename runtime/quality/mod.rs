//! Speed against accuracy: what a solve costs, how good it is, and which settings are worth their time.
//!
//! [`Settings`](crate::solve::Settings) hold every setting that trades quality for time. A [`Subject`] is one colour of a
//! scene that they are tried on; a [`Reference`] scores what came of it, the same truth for all. A [`Sweep`] decides what to try
//! next, [`front`](fn@front) which trials are worth keeping, [`recommend`] which three of them are `fast`, `balanced` and
//! `accurate`; [`Measured`] keeps them for this device in the user's cache.
//!
//! May import everything that `solve` may, `solve`, and `files`.

mod choice;
mod front;
mod measured;
mod recipe;
mod reference;
mod subject;
mod sweep;

pub use choice::{Recommended, recommend, within};
pub use front::{Trial, front, short_of};
pub use measured::{Measured, MeasuredError};
pub use reference::{PUPILS as REFERENCE_PUPILS, Reference};
pub use subject::{Prepared, Solved, Subject};
pub use sweep::{Space, Sweep};

use crate::engine::EngineError;
use crate::optics::OpticsError;
use crate::solve::SolveError;
use serde::{Deserialize, Serialize};

/// How much time quality may take.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
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

/// Why settings could not be tried.
#[derive(Debug, thiserror::Error)]
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
}
