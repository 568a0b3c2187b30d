//! **eyebox-solve**: from scenes to holograms, and to what an SLM receives, for [eyebox](https://github.com/eyebox/eyebox).
//!
//! [`evaluate`] sees what an eye sees, [`solve`](mod@solve) moves the phases. A [`hologram`] is kept in a file, [`tiled`] where it is larger than memory, and
//! [`reconstruction`] compares it with its scene. [`quality`] measures what settings cost and gain, and [`produce`] makes all colors of scenes
//! and sequences. [`encode`] makes the SLM's bytes, and [`encoded`] reads and writes folders of them.

pub mod encode;
pub mod encoded;
pub mod evaluate;
pub mod hologram;
pub mod produce;
pub mod quality;
pub mod reconstruction;
pub mod solve;
pub mod tiled;

// Modules name these as if they were beside them.
use eyebox_base::{files, memory};
#[cfg(feature = "vulkan")]
use eyebox_compute::gpu;
use eyebox_compute::{engine, plan};
use eyebox_optics as optics;
use eyebox_scene as scene;
