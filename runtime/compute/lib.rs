//! **eyebox-compute** describes computations as lists of kernels and runs them on the CPU or on Vulkan, for
//! [eyebox](https://github.com/eyebox/eyebox).
//!
//! [`plan`] describes the computations as plain data. [`gpu`] is one Vulkan device. [`engine`] runs plans on that
//! device or on the CPU.

pub mod engine;
pub mod gpu;
pub mod plan;

// Re-exports let modules name these crates as siblings.
#[cfg(feature = "vulkan")]
use eyebox_base::files;
use eyebox_base::memory;
use eyebox_optics as optics;
use eyebox_scene as scene;
