//! Finds out if a device shares memory with other processes (`VK_KHR_external_memory_fd`), and identifies it.

use super::extensions::has;
use super::instance::Instance;
use ash::{khr, vk};

/// Handle type of shared memory.
pub(super) const OPAQUE: vk::ExternalMemoryHandleTypeFlags = vk::ExternalMemoryHandleTypeFlags::OPAQUE_FD;
/// Usage of buffers in shared memory, on both sides.
pub(super) const USAGE: vk::BufferUsageFlags = vk::BufferUsageFlags::from_raw(
    vk::BufferUsageFlags::TRANSFER_SRC.as_raw()
        | vk::BufferUsageFlags::TRANSFER_DST.as_raw()
        | vk::BufferUsageFlags::STORAGE_BUFFER.as_raw(),
);

/// Identity of a device and its driver. Memory passes between processes if both are equal.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct DeviceIds {
    /// The `deviceUUID` of the device.
    pub device: [u8; 16],
    /// The `driverUUID` of the driver.
    pub driver: [u8; 16],
}

/// Returns true if a device exports and imports buffer memory as opaque file descriptors, without dedicated
/// allocations.
pub(super) fn shares(instance: &Instance, physical: vk::PhysicalDevice) -> bool {
    // SAFETY: the device is of this instance.
    let extensions = unsafe { instance.raw.enumerate_device_extension_properties(physical) }.unwrap_or_default();
    if !has(&extensions, khr::external_memory_fd::NAME) {
        return false;
    }
    let info = vk::PhysicalDeviceExternalBufferInfo::default().usage(USAGE).handle_type(OPAQUE);
    let mut properties = vk::ExternalBufferProperties::default();
    // SAFETY: as above. The call is of Vulkan 1.1, and the device is of 1.2.
    unsafe { instance.raw.get_physical_device_external_buffer_properties(physical, &info, &mut properties) };
    use vk::ExternalMemoryFeatureFlags as Features;
    let features = properties.external_memory_properties.external_memory_features;
    features.contains(Features::EXPORTABLE | Features::IMPORTABLE) && !features.contains(Features::DEDICATED_ONLY)
}

/// Returns the UUIDs of a device.
pub(super) fn ids(instance: &Instance, physical: vk::PhysicalDevice) -> DeviceIds {
    let mut ids = vk::PhysicalDeviceIDProperties::default();
    let mut all = vk::PhysicalDeviceProperties2::default().push_next(&mut ids);
    // SAFETY: the device is of this instance, of Vulkan 1.2, which knows the structure.
    unsafe { instance.raw.get_physical_device_properties2(physical, &mut all) };
    DeviceIds { device: ids.device_uuid, driver: ids.driver_uuid }
}
