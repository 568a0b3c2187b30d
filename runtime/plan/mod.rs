//! What is to be computed, decided once, as plain data: nothing here touches a buffer or a device.
//!
//! [`List`](Step) and its parts say what an engine runs; [`Planner`] makes them from optics, pupils and a scene.
//! May import `optics` and `scene`.

mod cost;
mod kernel;
mod list;
mod lists;
mod pupil_pass;
mod scales;
mod storage;
mod viewpoint;

pub use cost::{Slots, pupil_pass_bytes, shared_bytes, work};
pub use kernel::{Access, Dispatch, Group, Kernel, Scope, Step, Timing};
pub use list::{Buffer, Extent, PerFrame, PupilPass, Purpose, Resource, Shape, Shot};
pub use pupil_pass::{Comparison, Planner, ViewLayout};
pub use storage::Storage;
pub use viewpoint::Viewpoint;
