//! A Vulkan device: queues, memory, pipelines and their cache, validation messages.
//!
//! A [`Gpu`] is a handle: cloning it clones a reference. Engines, encoders, transforms and swapchains are made from one, each
//! with a command pool, descriptor pools and staging of its own (`Commands`), so that each can live on a thread of its
//! own. What is shared is behind locks: pipelines with their cache on disk, the allocator, and the queues, of which
//! submissions are made one at a time. Where a device has more than one queue, pictures are presented on another one than
//! kernels run on: neither waits for the other.
//!
//! `instance` loads Vulkan; `devices` lists, and chooses; `device` is what all else holds; `block` is memory; `pipelines`
//! and `cache` compile; `recorder` records and submits; `commands` joins these for one user; `pictures` is what
//! users pass to each other without the host; `external` is memory that another process has too; `tested` remembers which devices were tried; `open` makes the handle, of a
//! device of its own or of one that a program brings.

#![allow(unsafe_code)]

mod block;
mod cache;
mod commands;
mod counters;
mod device;
mod devices;
#[cfg(target_os = "linux")]
mod external;
#[cfg(test)]
pub(crate) mod guards;
mod instance;
mod modules;
mod open;
mod pictures;
mod pipelines;
mod recorder;
#[cfg(target_os = "linux")]
mod sharing;
mod slot;
#[cfg(any(test, feature = "test-hooks"))]
pub mod statistics;
#[cfg(any(test, feature = "test-hooks"))]
pub mod test_options;
mod tested;

#[cfg(any(test, feature = "test-hooks"))]
use super::Options;
use super::{error, report};
pub use ash;
pub use block::{Block, Range};
pub(crate) use commands::Commands;
pub use counters::Counts;
pub use device::Device;
pub use devices::devices;
#[cfg(target_os = "linux")]
pub use external::{SharedLayout, SharedMemory, SlotWriter};
pub use instance::{Instance, Messages, has};
pub use open::{Gpu, RawDevice};
pub use pictures::{PhasesOnDevice, Pictures, PixelOrder, Ready};
pub(crate) use pipelines::{PUSH_BYTES, Pipeline};
pub(crate) use recorder::{Groups, Piece};
#[cfg(target_os = "linux")]
pub use sharing::DeviceIds;
pub(crate) use slot::IN_FLIGHT;
