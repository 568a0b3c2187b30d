//! Tries settings on this machine and recommends three of them.
//!
//! [`Settings`](eyebox::low_level::solve::Settings) hold all settings that trade quality for time. A [`Tuning`] tries a
//! grid of them on a [`ColorJob`]. The function [`front`](fn@front) finds the trials that no other trial beats. The
//! function [`recommend`] chooses three of them as `fast`, `balanced` and `accurate`. [`Measured`] stores them for this
//! device in the user's cache.

mod choice;
mod front;
mod grid;
mod measured;
mod tune;
mod tuned;

pub use choice::{Recommended, recommend, within};
pub(crate) use front::short_of;
pub use front::{Trial, front};
pub use measured::{Measured, MeasuredError};
pub use tune::Tuning;
pub use tuned::{Checked, LevelRow, NEAR_DB, Tuned};

use eyebox::low_level::quality::{ColorJob, Quality, QualityError, Reference, Solved};
