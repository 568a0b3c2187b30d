//! Sends the frames of an OpenXR application to an eyebox display (docs/openxr.md).
//!
//! The crate is an API layer. The loader of OpenXR places it between the application and the runtime, and it passes
//! every call on. When the application releases an image of a swapchain, the layer copies the image on the
//! application's own Vulkan queue. When the application ends a frame, the layer collects the copies that the frame
//! uses. A thread of the layer waits for the copies, composes the picture with its depth, and sends it through
//! `eyebox_live_input`.
//!
//! - `layer` is the edge to OpenXR, and `vulkan` is the edge to Vulkan. All `unsafe` code is there.
//! - `composition` makes the picture of an eye from copies, in safe code.
//! - `sender` is the thread that waits, composes and sends.

#[cfg(target_os = "linux")]
mod composition;
#[cfg(target_os = "linux")]
mod layer;
#[cfg(target_os = "linux")]
mod notes;
#[cfg(target_os = "linux")]
mod sender;
#[cfg(target_os = "linux")]
mod vulkan;

/// The manifest of the layer, in JSON. Its `library_path` is relative to the folder of the manifest.
pub const MANIFEST: &str = include_str!("eyebox.json");
