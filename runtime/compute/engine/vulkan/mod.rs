//! The Vulkan engine.
//!
//! Design: a [`Gpu`](crate::gpu::Gpu) that others may share, one recording per [`run_part`](super::Engine::run_part). A
//! kernel runs over all its pupil passes and frames, then one barrier; pupil passes of one kernel may run side by side.
//! Buffers of the shape are blocks of their own, frames at a stride that suits the device's alignment; buffers of pupil
//! passes are pieces of arenas that only grow; a kernel sees ranges no larger than the device's largest, so frames and
//! views come in chunks. Pipelines, descriptor pools, staging and queries are kept: nothing is made once all sizes have
//! been seen. Nothing is assumed of the size of subgroups; shaders synchronise through shared memory only.
//!
//! `engine` runs lists of kernels, `self_test` tries a device that was never met, `encode` makes video frames of phases, `decode` views
//! of an application's samples, `fft` plans and records transforms.

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
mod self_test;
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
pub(super) use self_test::check as self_test;
