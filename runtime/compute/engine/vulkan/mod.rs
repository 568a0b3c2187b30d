//! Runs lists of kernels on a Vulkan device.
//!
//! A [`Gpu`](crate::gpu::Gpu) may have other users. Each [`run_part`](super::Engine::run_part) is one recording. A
//! kernel runs over all its pupil passes and frames, then one barrier follows, and pupil passes of one kernel may run
//! at the same time. Buffers of the shape are separate blocks, with frames at a stride that suits the device's
//! alignment. Buffers of pupil passes are pieces of arenas that only grow. A kernel binds ranges no larger than the
//! device's largest, so frames and views come in chunks. Pipelines, descriptor pools, staging and queries are kept,
//! and nothing is allocated once all sizes have occurred. Shaders assume no subgroup size and synchronize through
//! shared memory only.
//!
//! Module `engine` runs lists of kernels, and `self_test` tests a device at first use. Module `encode` makes video
//! frames of phases, `decode` makes views from an application's samples, `splats` and `relief` draw views of splats
//! and of pictures with depths, and `fft` plans and records transforms.

#![allow(unsafe_code)]

mod check;
mod decode;
mod encode;
mod engine;
mod fft;
mod flight;
#[cfg(test)]
mod guard_tests;
mod layout;
mod look_up;
#[cfg(test)]
mod look_up_tests;
mod prepare;
#[cfg(any(test, feature = "test-hooks"))]
mod pretend;
mod record;
mod relief;
#[cfg(test)]
mod relief_tests;
mod self_test;
mod splats;
#[cfg(test)]
mod splats_tests;
mod tables;
#[cfg(test)]
mod tests;
mod views;

pub use decode::{NoLight, StoredViews, ViewDecoder, ViewsLight};
pub use encode::VulkanEncoder;
pub use engine::VulkanEngine;
pub use fft::{Timed, Transforms};
#[cfg(any(test, feature = "test-hooks"))]
pub use pretend::LesserDevice;
pub use relief::{DeviceRelief, StoredDepths};
pub(super) use self_test::check as self_test;
pub use splats::{DeviceSplats, VulkanSplats};
