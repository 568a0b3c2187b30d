//! Finds the extensions that an application needs, so that its device can share memory with the layer's own.

use crate::vulkan::sharing::entry;
use ash::{khr, vk};
use std::ffi::CStr;
use std::sync::OnceLock;

/// The extensions of an instance of Vulkan 1.0 that its devices need.
const INSTANCE: [&CStr; 2] = [khr::get_physical_device_properties2::NAME, khr::external_memory_capabilities::NAME];
/// The extensions of a device.
const DEVICE: [&CStr; 2] = [khr::external_memory::NAME, khr::external_memory_fd::NAME];

/// Returns the extensions for the application's instance, or none if the system does not have them.
pub fn instance_extensions() -> &'static [&'static CStr] {
    if is_everywhere() { &INSTANCE } else { &[] }
}

/// Returns the extensions for the application's device, or none if not all devices of the system have them. The device
/// that the application will select is not known.
pub fn device_extensions() -> &'static [&'static CStr] {
    if is_everywhere() { &DEVICE } else { &[] }
}

/// Looks once, because the devices of a system do not change often, and an instance takes milliseconds.
fn is_everywhere() -> bool {
    static FOUND: OnceLock<bool> = OnceLock::new();
    *FOUND.get_or_init(|| entry().is_some_and(|entry| look(entry).unwrap_or(false)))
}

fn look(entry: &ash::Entry) -> Result<bool, vk::Result> {
    let has = |all: &[vk::ExtensionProperties], name: &&CStr| {
        all.iter().any(|one| one.extension_name_as_c_str() == Ok(*name))
    };
    // SAFETY: the loader is open.
    let offered = unsafe { entry.enumerate_instance_extension_properties(None) }?;
    if !INSTANCE.iter().all(|name| has(&offered, name)) {
        return Ok(false);
    }
    // SAFETY: the structure has no pointers.
    let instance = unsafe { entry.create_instance(&vk::InstanceCreateInfo::default(), None) }?;
    // SAFETY: the instance was made just now.
    let devices = unsafe { instance.enumerate_physical_devices() }.unwrap_or_default();
    let all = devices.iter().all(|device| {
        // SAFETY: the device is of the instance.
        let offered = unsafe { instance.enumerate_device_extension_properties(*device) }.unwrap_or_default();
        DEVICE.iter().all(|name| has(&offered, name))
    });
    // SAFETY: nothing uses the instance any more.
    unsafe { instance.destroy_instance(None) };
    Ok(all && !devices.is_empty())
}
