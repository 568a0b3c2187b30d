//! Copies images of an application to memory of the host, on the application's own device and queue.
//!
//! An application may use its queue on other threads. OpenXR requires it to stay away from the queue during the calls
//! that may submit (`XR_KHR_vulkan_enable`, concurrency), and a release of an image is one of them. The layer submits
//! during releases only.

// Calls of Vulkan are `unsafe`. Each has its reason.
#![allow(unsafe_code)]

mod buffer;
mod copier;
mod device;
mod part;

pub use buffer::Captured;
pub use copier::{Copier, Source};
pub use device::{Binding, Device};
pub use part::Part;
