//! Sends the frames of an OpenXR application to an eyebox display (docs/openxr.md).
//!
//! The crate is an API layer. The loader of OpenXR places it between the application and the runtime, and it passes
//! every call on. When the application releases an image of a swapchain, the layer copies the image on the
//! application's own Vulkan queue. When the application ends a frame, the layer collects the copies that the frame
//! uses. A thread of the layer waits for the copies, composes the picture with its depth, and sends it through
//! `eyebox_live_input`. If the display and the application are on the same device, a device of the layer composes the
//! frame there, and it stays in the device's memory. Otherwise the host composes it.
//!
//! - `layer` is the edge to OpenXR, and `vulkan` is the edge to Vulkan. All `unsafe` code is there.
//! - `vulkan::own` is the layer's device, which composes frames.
//! - `composition` makes the picture of an eye from copies in memory of the host, in safe code. It is the twin of the
//!   kernels of the device.
//! - `sender` is the thread that waits and sends. `output` composes the frames of a display.

#[cfg(target_os = "linux")]
mod composition;
#[cfg(target_os = "linux")]
mod layer;
#[cfg(target_os = "linux")]
mod layers;
#[cfg(target_os = "linux")]
mod notes;
#[cfg(target_os = "linux")]
mod output;
#[cfg(target_os = "linux")]
mod sender;
#[cfg(target_os = "linux")]
mod vulkan;

/// The manifest of the layer, in JSON. Its `library_path` is relative to the folder of the manifest.
pub const MANIFEST: &str = include_str!("eyebox.json");
