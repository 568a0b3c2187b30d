//! Copies images of an application on its own device and queue, and composes frames on a device of the layer.
//!
//! An application may use its queue on other threads. OpenXR requires it to stay away from the queue during the calls
//! that may submit (`XR_KHR_vulkan_enable`, concurrency), and a release of an image is one of them. The layer submits
//! to this queue during releases only. It composes on a device of its own (`own`). If there is none, the copies are in
//! memory of the host.

// Calls of Vulkan are `unsafe`. Each has its reason.
#![allow(unsafe_code)]

mod buffer;
mod copier;
mod device;
pub mod own;
mod part;
mod sharing;

pub use buffer::{Captured, Room};
pub use copier::{Copier, Source};
pub use device::{Binding, Device};
pub use part::Part;
