//! **eyebox-solve** computes holograms of scenes and the video frames that an SLM receives from them, for
//! [eyebox](https://github.com/eyebox/eyebox).
//!
//! [`evaluate`] computes what an eye sees of a hologram, and [`solve`](mod@solve) moves its phases. The module
//! [`hologram`] stores holograms in files, and [`tiled`] solves holograms larger than memory. The module
//! [`reconstruction`] compares a hologram with its scene. The module [`quality`] measures the cost and the gain of
//! settings, and [`produce`] solves all colors of scenes and sequences. The module [`encode`] makes the bytes for the
//! SLM, and [`encoded`] reads and writes folders of them.

pub mod encode;
pub mod encoded;
pub mod evaluate;
pub mod hologram;
pub mod produce;
pub mod quality;
pub mod reconstruction;
pub mod solve;
pub mod tiled;

// Modules name these crates like modules of this one.
use eyebox_base::{files, memory};
#[cfg(feature = "vulkan")]
use eyebox_compute::gpu;
use eyebox_compute::{engine, plan};
use eyebox_optics as optics;
use eyebox_scene as scene;
