//! Describes computations as plain data, with lists of kernels, their arguments and their cost.
//!
//! No code here touches a buffer or a device. [`Step`] and its fields describe the work of an engine. [`Planner`]
//! makes them from optics, pupils and a scene.

mod cost;
#[cfg(feature = "vulkan")]
mod device_model;
mod eye;
#[cfg(feature = "vulkan")]
pub(crate) mod fusion;
mod kernel;
mod list;
mod lists;
mod mask;
mod model;
mod moments;
mod moved;
mod pass;
mod pupil_pass;
mod resample_tables;
mod scales;
mod storage;
#[cfg(feature = "vulkan")]
mod traffic;
mod viewpoint;

pub use cost::{Slots, pupil_pass_bytes, shared_bytes, work};
#[cfg(feature = "vulkan")]
pub use device_model::{DEVICES, DeviceModel, Estimate};
#[cfg(feature = "vulkan")]
pub(crate) use device_model::{DISPATCH_BYTES, SUBMISSION_BYTES};
pub use eye::EyeTables;
pub use kernel::{Access, Dispatch, Group, Kernel, Scope, Step, Timing};
pub use list::{Buffer, BufferSize, ModelParts, PerFrame, Purpose, Resource, Shape};
pub use lists::{StepLists, mean_loss};
pub use model::ModelTables;
pub use moments::{Moment, Moving};
pub(crate) use moved::moved;
pub use pass::{PupilPass, Shot};
pub use pupil_pass::{Comparison, Planner, ViewLayout};
pub use storage::Storage;
#[cfg(feature = "vulkan")]
pub(crate) use traffic::Entry;
#[cfg(feature = "vulkan")]
pub use traffic::{Move, Recording};
pub use viewpoint::Viewpoint;
