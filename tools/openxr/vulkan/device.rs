//! The Vulkan device of the application.

use super::sharing::{entry, ids};
use ash::khr;
use ash::vk::{self, Handle};
use eyebox_live_input::DeviceIds;

/// The handles with which an application begins a session.
#[derive(Debug, Clone, Copy)]
pub struct Binding {
    pub instance: u64,
    pub physical_device: u64,
    pub device: u64,
    pub family: u32,
    pub queue: u32,
}

/// The application's device with its queue. The application destroys it, after its session.
pub struct Device {
    pub(super) raw: ash::Device,
    pub(super) queue: vk::Queue,
    pub(super) family: u32,
    pub(super) memory: vk::PhysicalDeviceMemoryProperties,
    /// The unit of the ranges of memory that the host reads.
    pub(super) atom: u64,
    /// The identity of the device and the functions that export memory, if the application enabled them.
    pub(super) exports: Option<(DeviceIds, khr::external_memory_fd::Device)>,
}

impl Device {
    /// Takes the device of a session.
    ///
    /// # Errors
    /// Returns the reason in words if the loader of Vulkan is not found.
    pub fn of(binding: Binding) -> Result<Self, String> {
        let entry = entry().ok_or("the loader of Vulkan is not found")?;
        let (instance, physical) =
            (vk::Instance::from_raw(binding.instance), vk::PhysicalDevice::from_raw(binding.physical_device));
        // SAFETY: the application gave these handles to xrCreateSession, which requires that they are valid until the
        // session is destroyed.
        let instance = unsafe { ash::Instance::load(entry.static_fn(), instance) };
        // SAFETY: as above.
        let raw = unsafe { ash::Device::load(instance.fp_v1_0(), vk::Device::from_raw(binding.device)) };
        // SAFETY: as above.
        let memory = unsafe { instance.get_physical_device_memory_properties(physical) };
        // SAFETY: as above.
        let limits = unsafe { instance.get_physical_device_properties(physical) }.limits;
        // SAFETY: the application made the device with this queue.
        let queue = unsafe { raw.get_device_queue(binding.family, binding.queue) };
        let atom = limits.non_coherent_atom_size.max(1);
        let exports = exports(entry, &instance, &raw, physical);
        Ok(Self { raw, queue, family: binding.family, memory, atom, exports })
    }

    /// Returns the identity of the device, if it exports memory.
    pub fn ids(&self) -> Option<DeviceIds> {
        self.exports.as_ref().map(|(ids, _)| *ids)
    }
}

/// Returns the identity of a device and the functions that export its memory. Returns none if the application did not
/// enable them.
fn exports(
    entry: &ash::Entry,
    instance: &ash::Instance,
    raw: &ash::Device,
    physical: vk::PhysicalDevice,
) -> Option<(DeviceIds, khr::external_memory_fd::Device)> {
    // SAFETY: the device is valid. A function of an extension that is not enabled is not found.
    unsafe { (instance.fp_v1_0().get_device_proc_addr)(raw.handle(), c"vkGetMemoryFdKHR".as_ptr()) }?;
    // A device has the function only if its instance has one of these. The first is of the extension, which may be
    // enabled in Vulkan 1.0.
    let names = [c"vkGetPhysicalDeviceProperties2KHR", c"vkGetPhysicalDeviceProperties2"];
    // SAFETY: the instance is valid.
    let find = |name: &std::ffi::CStr| unsafe { entry.get_instance_proc_addr(instance.handle(), name.as_ptr()) };
    let get = names.into_iter().find_map(find)?;
    // SAFETY: both names belong to functions of this type.
    let get: vk::PFN_vkGetPhysicalDeviceProperties2 = unsafe { std::mem::transmute(get) };
    // SAFETY: the function is of the instance of the device.
    let ids = unsafe { ids(get, physical) };
    Some((ids, khr::external_memory_fd::Device::new(instance, raw)))
}
