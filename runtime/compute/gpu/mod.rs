//! One Vulkan device, opened once and shared: queues, memory, pipelines and their cache, validation messages.
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

#[cfg(not(feature = "vulkan"))]
mod absent;
mod error;
mod report;

#[cfg(feature = "vulkan")]
mod block;
#[cfg(feature = "vulkan")]
mod cache;
#[cfg(feature = "vulkan")]
mod commands;
#[cfg(feature = "vulkan")]
mod counters;
#[cfg(feature = "vulkan")]
mod device;
#[cfg(feature = "vulkan")]
mod devices;
#[cfg(all(target_os = "linux", feature = "vulkan"))]
mod external;
#[cfg(all(test, feature = "vulkan"))]
pub(crate) mod guards;
#[cfg(feature = "vulkan")]
mod instance;
#[cfg(feature = "vulkan")]
mod modules;
#[cfg(feature = "vulkan")]
mod open;
#[cfg(feature = "vulkan")]
mod pictures;
#[cfg(feature = "vulkan")]
mod pipelines;
#[cfg(feature = "vulkan")]
mod recorder;
#[cfg(all(target_os = "linux", feature = "vulkan"))]
mod sharing;
#[cfg(feature = "vulkan")]
mod slot;
#[cfg(all(any(test, feature = "test-hooks"), feature = "vulkan"))]
pub mod statistics;
#[cfg(all(any(test, feature = "test-hooks"), feature = "vulkan"))]
pub mod test_options;
#[cfg(feature = "vulkan")]
mod tested;

#[cfg(not(feature = "vulkan"))]
pub use absent::{Gpu, PhasesOnDevice, devices};
pub use error::EngineError;
pub use report::{DeviceKind, DeviceReport, Limits, Options, Tested};

#[cfg(feature = "vulkan")]
pub use ash;
#[cfg(feature = "vulkan")]
pub use block::{Block, Range};
#[cfg(feature = "vulkan")]
pub(crate) use commands::Commands;
#[cfg(feature = "vulkan")]
pub use counters::Counts;
#[cfg(feature = "vulkan")]
pub(crate) use counters::add;
#[cfg(feature = "vulkan")]
pub use device::Device;
#[cfg(feature = "vulkan")]
pub use devices::devices;
#[cfg(all(target_os = "linux", feature = "vulkan"))]
pub use external::{SharedLayout, SharedMemory, SlotWriter};
#[cfg(feature = "vulkan")]
pub use instance::Messages;
#[cfg(feature = "vulkan")]
pub use instance::{Instance, has};
#[cfg(feature = "vulkan")]
pub use open::{Gpu, RawDevice};
#[cfg(feature = "vulkan")]
pub use pictures::Ready;
#[cfg(feature = "vulkan")]
pub use pictures::{PhasesOnDevice, Pictures, PixelOrder};
#[cfg(feature = "vulkan")]
pub(crate) use pipelines::{PUSH_BYTES, Pipeline};
#[cfg(feature = "vulkan")]
pub(crate) use recorder::{Groups, Piece};
#[cfg(all(target_os = "linux", feature = "vulkan"))]
pub use sharing::DeviceIds;
#[cfg(feature = "vulkan")]
pub(crate) use slot::IN_FLIGHT;
