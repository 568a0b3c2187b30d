//! **eyebox-compute**: lists of kernels and the engines that run them, for [eyebox](https://github.com/eyebox/eyebox).
//!
//! [`plan`] describes as plain data what is computed. [`gpu`] is one Vulkan device. [`engine`] runs plans on that device or on the CPU.

pub mod engine;
pub mod gpu;
pub mod plan;

// Modules name these as if they were beside them.
#[cfg(feature = "vulkan")]
use eyebox_base::files;
use eyebox_base::memory;
use eyebox_optics as optics;
use eyebox_scene as scene;
