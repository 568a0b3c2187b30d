//! The loader of Vulkan, the kind of shared memory, and the identity of a device, which both devices use.

use ash::vk;
use eyebox_live_input::DeviceIds;
use std::sync::OnceLock;

/// The kind of shared memory.
pub const OPAQUE: vk::ExternalMemoryHandleTypeFlags = vk::ExternalMemoryHandleTypeFlags::OPAQUE_FD;
/// The usage of shared buffers, on all sides. It is the one of the display's memory.
pub const USAGE: vk::BufferUsageFlags = vk::BufferUsageFlags::from_raw(
    vk::BufferUsageFlags::TRANSFER_SRC.as_raw()
        | vk::BufferUsageFlags::TRANSFER_DST.as_raw()
        | vk::BufferUsageFlags::STORAGE_BUFFER.as_raw(),
);

/// Returns the loader of Vulkan, which is the one that the application uses. It stays open as long as the process.
pub fn entry() -> Option<&'static ash::Entry> {
    static ENTRY: OnceLock<Option<ash::Entry>> = OnceLock::new();
    // SAFETY: the library is Vulkan's loader, whose initialization has no requirements.
    ENTRY.get_or_init(|| unsafe { ash::Entry::load() }.ok()).as_ref()
}

/// Returns the UUIDs of a device.
///
/// # Safety
/// The function must be of the device's instance.
pub unsafe fn ids(get: vk::PFN_vkGetPhysicalDeviceProperties2, physical: vk::PhysicalDevice) -> DeviceIds {
    let mut ids = vk::PhysicalDeviceIDProperties::default();
    let mut all = vk::PhysicalDeviceProperties2::default().push_next(&mut ids);
    // SAFETY: as stated above. A driver that does not know the inner structure leaves it as it is.
    unsafe { get(physical, &mut all) };
    DeviceIds { device: ids.device_uuid, driver: ids.driver_uuid }
}
