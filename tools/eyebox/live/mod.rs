//! The commands that steer: `eyebox refine` at one place, `eyebox study` for a simulated eye, `eyebox live`.

mod args;
mod plot;
mod refine;
mod study;
mod subject;

pub use refine::Refine;
pub use study::Study;

pub use refine::run as refine;
pub use study::run as study;
