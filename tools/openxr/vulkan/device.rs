//! The Vulkan device of the application.

use ash::vk::{self, Handle};
use std::sync::OnceLock;

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
}

/// The loader of Vulkan, which is the one that the application uses. It stays open as long as the process.
static ENTRY: OnceLock<Option<ash::Entry>> = OnceLock::new();

impl Device {
    /// Takes the device of a session.
    ///
    /// # Errors
    /// Returns the reason in words if the loader of Vulkan is not found.
    pub fn of(binding: Binding) -> Result<Self, String> {
        // SAFETY: the library is Vulkan's loader, whose initialization has no requirements.
        let entry = ENTRY.get_or_init(|| unsafe { ash::Entry::load() }.ok());
        let entry = entry.as_ref().ok_or("the loader of Vulkan is not found")?;
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
        Ok(Self { raw, queue, family: binding.family, memory, atom: limits.non_coherent_atom_size.max(1) })
    }
}
