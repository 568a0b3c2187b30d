//! One Vulkan device, opened once and shared.
//!
//! A [`Gpu`] is a handle: cloning it clones a reference. Engines, encoders, transforms and swapchains are made from one, each
//! with a command pool, descriptor pools and staging of its own ([`Commands`]), so that each can live on a thread of its
//! own. What is shared is behind locks: pipelines with their cache on disk, the allocator, and the queues, of which
//! submissions are made one at a time. Where a device has more than one queue, pictures are presented on another one than
//! kernels run on: neither waits for the other.
//!
//! `instance` loads Vulkan; `devices` lists, and chooses; `device` is what all else holds; `block` is memory; `pipelines`
//! and `cache` compile; `recorder` records and submits; `commands` joins these for one user; `open` makes the handle, of a
//! device of its own or of one that a program brings.
//! This room imports `files` (the folder of caches) alone.

#![allow(unsafe_code)]

mod block;
mod cache;
mod commands;
mod counters;
mod device;
mod devices;
mod error;
mod instance;
mod open;
mod pipelines;
mod recorder;

pub use ash;
pub(crate) use block::{Block, Range};
pub(crate) use commands::Commands;
pub use counters::Counts;
pub(crate) use counters::add;
pub use devices::{DeviceKind, DeviceReport, Limits, devices};
pub use error::EngineError;
pub use instance::Messages;
pub(crate) use instance::{Instance, has};
pub use open::{Gpu, Options, RawDevice};
pub(crate) use pipelines::{PUSH_BYTES, Pipeline};
pub(crate) use recorder::Piece;
