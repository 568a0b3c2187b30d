//! **eyebox-lab**: the laboratory. What holograms are worth, and which settings are worth their time.
//!
//! [`comparison`] solves the same scenes by every method and looks through the same groups of pupils. [`tuning`] tries a grid of
//! [`Settings`](eyebox::low_level::solve::Settings) and recommends three of them for this device. [`film`] writes what an eye sees while it moves.
//! [`study`] measures what refinement for a simulated eye gains. [`report`] makes pages, tables and plots of all of this, of studies and of calibrations.
//!
//! Nothing that solves or shows holograms needs it.

pub mod comparison;
pub mod film;
mod kept;
pub mod report;
mod stoppable;
pub mod study;
pub mod tuning;
mod watch;

pub use kept::writable;
pub use watch::Observe;
