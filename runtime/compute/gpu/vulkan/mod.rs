//! Opens a Vulkan device with its queues, memory, pipelines, pipeline cache and validation messages.
//!
//! A [`Gpu`] is a handle, and its clones share the device. Engines, encoders, transforms and swapchains are made from
//! one. Each has its own command pool, descriptor pools and staging (`Commands`), so that each can live on its own
//! thread. The shared parts are behind locks. These are pipelines with their cache on disk, the allocator, and the
//! queues, which take one submission at a time. If a device has more than one queue, pictures are presented on
//! another queue than kernels run on, so that neither waits for the other.
//!
//! Module `instance` loads Vulkan, and `validation` requests its checks. Module `devices` lists devices and chooses
//! one. The shared parts are in `device`, and memory is in `block`. Modules `pipelines`, `background` and `cache` compile. Module
//! `recorder` records and submits, and `commands` joins all of these for one user. Data that users pass to each other
//! without the host is in `pictures`, and memory shared with another process in `external`. Module `presentation` chooses the
//! extensions for pictures. Module `tested` stores the
//! results of device tests. Module `open` makes the handle, for its own device or for one from the program.

#![allow(unsafe_code)]

mod background;
mod block;
mod cache;
mod commands;
mod counters;
mod device;
mod devices;
mod extensions;
#[cfg(target_os = "linux")]
mod external;
mod groups;
#[cfg(test)]
pub(crate) mod guards;
mod instance;
mod modules;
mod open;
mod pictures;
mod pipelines;
pub mod presentation;
mod recorder;
#[cfg(target_os = "linux")]
mod sharing;
mod slot;
#[cfg(any(test, feature = "test-hooks"))]
pub mod statistics;
#[cfg(any(test, feature = "test-hooks"))]
pub mod test_options;
mod tested;
mod timeline;
mod validation;

#[cfg(any(test, feature = "test-hooks"))]
use super::Options;
use super::{error, report};
pub use ash;
pub use block::{Block, Range};
pub(crate) use commands::Commands;
pub use counters::Counts;
pub use device::Device;
#[cfg(test)]
pub(crate) use device::Patience;
pub use devices::devices;
pub use extensions::has;
#[cfg(target_os = "linux")]
pub use external::{SharedLayout, SharedMemory, SlotWriter};
pub(crate) use groups::Groups;
pub use instance::{Instance, Messages};
pub use open::{Gpu, RawDevice};
pub use pictures::{PhasesOnDevice, Pictures, PixelOrder, Ready};
pub(crate) use pipelines::{PUSH_BYTES, Pipeline};
pub(crate) use recorder::Piece;
#[cfg(target_os = "linux")]
pub use sharing::DeviceIds;
pub(crate) use slot::IN_FLIGHT;
