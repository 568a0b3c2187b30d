//! The reasons for which frames are composed on the host instead.

use ash::vk;

/// A fault of the layer's own device.
#[derive(Debug, Clone, Copy, thiserror::Error)]
pub enum Fault {
    /// The loader of Vulkan is missing.
    #[error("the loader of Vulkan is not found")]
    Loader,
    /// No device has the UUIDs of the application's device, with Vulkan 1.2 and a queue for computing.
    #[error("no device for computing has the UUIDs of the application's device")]
    Device,
    /// The device does not export and import the memory of buffers.
    #[error("the device does not share memory of buffers (VK_KHR_external_memory_fd)")]
    Sharing,
    /// The shared memory does not fit the device.
    #[error("shared memory of {bytes} bytes and type {kind} does not fit the device")]
    Memory { bytes: u64, kind: u32 },
    /// A picture is too large for a binding of the device.
    #[error("an image of {found} bytes, but the device reads at most {most} at once")]
    Size { found: u64, most: u64 },
    /// The display's pictures have too many rows for a device.
    #[error("pictures of {found} rows, but a device composes at most {most}")]
    Rows { found: usize, most: usize },
    /// A call of Vulkan failed.
    #[error("{call}: {result}")]
    Vulkan { call: &'static str, result: vk::Result },
}

/// Adds the name of a call to its error.
pub(super) fn of(call: &'static str) -> impl Fn(vk::Result) -> Fault {
    move |result| Fault::Vulkan { call, result }
}
