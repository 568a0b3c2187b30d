//! Whether a device shares memory with other processes (`VK_KHR_external_memory_fd`), and which device it is to them.

use super::instance::{Instance, has};
use ash::{khr, vk};

/// How memory is handed over.
pub(super) const OPAQUE: vk::ExternalMemoryHandleTypeFlags = vk::ExternalMemoryHandleTypeFlags::OPAQUE_FD;
/// What buffers in shared memory are made for, on both sides.
pub(super) const USAGE: vk::BufferUsageFlags = vk::BufferUsageFlags::from_raw(
    vk::BufferUsageFlags::TRANSFER_SRC.as_raw()
        | vk::BufferUsageFlags::TRANSFER_DST.as_raw()
        | vk::BufferUsageFlags::STORAGE_BUFFER.as_raw(),
);

/// Which device it is, behind which driver: memory passes between processes where both are the same.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct DeviceIds {
    /// `deviceUUID`.
    pub device: [u8; 16],
    /// `driverUUID`.
    pub driver: [u8; 16],
}

/// Whether a device exports and imports memory of buffers as opaque file descriptors, without memory of their own for each.
pub(super) fn shares(instance: &Instance, physical: vk::PhysicalDevice) -> bool {
    // SAFETY: the device is of this instance.
    let extensions = unsafe { instance.raw.enumerate_device_extension_properties(physical) }.unwrap_or_default();
    if !has(&extensions, khr::external_memory_fd::NAME) {
        return false;
    }
    let info = vk::PhysicalDeviceExternalBufferInfo::default().usage(USAGE).handle_type(OPAQUE);
    let mut properties = vk::ExternalBufferProperties::default();
    // SAFETY: as above; the call is of Vulkan 1.1, and a device of 1.2 is asked.
    unsafe { instance.raw.get_physical_device_external_buffer_properties(physical, &info, &mut properties) };
    use vk::ExternalMemoryFeatureFlags as Features;
    let features = properties.external_memory_properties.external_memory_features;
    features.contains(Features::EXPORTABLE | Features::IMPORTABLE) && !features.contains(Features::DEDICATED_ONLY)
}

/// Its UUIDs.
pub(super) fn ids(instance: &Instance, physical: vk::PhysicalDevice) -> DeviceIds {
    let mut ids = vk::PhysicalDeviceIDProperties::default();
    let mut all = vk::PhysicalDeviceProperties2::default().push_next(&mut ids);
    // SAFETY: the device is of this instance, of Vulkan 1.2, which knows the structure.
    unsafe { instance.raw.get_physical_device_properties2(physical, &mut all) };
    DeviceIds { device: ids.device_uuid, driver: ids.driver_uuid }
}
