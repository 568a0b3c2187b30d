//! What is to be computed, decided once, as plain data: nothing here touches a buffer or a device.
//!
//! [`List`](Step) and its parts say what an engine runs; [`Planner`] makes them from optics, pupils and a scene.
//! May import `optics` and `scene`.

mod cost;
mod lane;
mod list;
mod lists;
mod sight;
mod storage;

pub use cost::{Group, Slots, lane_bytes, shared_bytes, work};
pub use lane::{Comparison, Planner, Views};
pub use list::{Buffer, Dispatch, Kernel, Lane, Purpose, Scope, Shape, Shot, Step, Timing};
pub use sight::Sight;
pub use storage::Storage;
