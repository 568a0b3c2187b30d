//! The commands that steer: `eyebox refine` at one place, `eyebox study` for a simulated eye, `eyebox live`.

mod content;
#[allow(clippy::module_inception)]
mod live;
mod refine;
mod study;
mod subject;
mod tracking;
mod viewing;

pub use live::{KeptSession, Live, LiveOptions, ShowOptions, Stage, show};
pub use refine::Refine;
pub use study::Study;
pub use subject::{Steered, SubjectOptions, is_hologram, load, solved, solved_on};

pub use live::run as live;
pub use refine::run as refine;
pub use study::run as study;
