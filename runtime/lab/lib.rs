//! Compares methods, measures settings, and writes films and reports (**eyebox-lab**, the laboratory).
//!
//! The module [`comparison`] solves the same scenes with each method and measures the holograms through the same groups
//! of pupils. The module [`tuning`] tries a grid of [`Settings`](eyebox::low_level::solve::Settings) and recommends
//! three of them for this device. The module [`film`] writes the images that an eye sees while it moves. The module
//! [`study`] measures the gain of the refinement for a simulated eye. The module [`report`] makes pages, tables and
//! plots of these results, of studies and of calibrations.
//!
//! The solver and the display of holograms do not depend on this crate.

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
