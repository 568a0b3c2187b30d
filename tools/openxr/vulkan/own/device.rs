//! The layer's own device.

use super::fault::{Fault, of};
use super::pipelines::Pipelines;
use crate::vulkan::sharing::{OPAQUE, USAGE, entry, ids};
use ash::{khr, vk};
use eyebox_live_input::DeviceIds;
use std::sync::{Arc, Mutex};

/// The device with its queue.
pub struct Own {
    instance: ash::Instance,
    pub(super) raw: ash::Device,
    pub(super) family: u32,
    pub(super) queue: Mutex<vk::Queue>,
    pub(super) memory: vk::PhysicalDeviceMemoryProperties,
    /// The unit of the places of bindings.
    pub(super) alignment: u64,
    /// The bytes of the largest binding.
    pub(super) range: u64,
    pub(super) pipelines: Pipelines,
}

impl Own {
    /// Opens the device with these UUIDs.
    ///
    /// # Errors
    /// Returns [`Fault`] if no such device computes and shares memory, or the driver fails.
    pub fn open(wanted: DeviceIds) -> Result<Arc<Self>, Fault> {
        let entry = entry().ok_or(Fault::Loader)?;
        let about = vk::ApplicationInfo::default().application_name(c"eyebox openxr").api_version(vk::API_VERSION_1_2);
        let info = vk::InstanceCreateInfo::default().application_info(&about);
        // SAFETY: the structures live as long as the call.
        let instance = unsafe { entry.create_instance(&info, None) }.map_err(of("vkCreateInstance"))?;
        let opened = open(&instance, wanted);
        opened
            .inspect_err(|_| {
                // SAFETY: `open` destroyed the device.
                unsafe { instance.destroy_instance(None) };
            })
            .map(|(raw, family, physical, pipelines)| {
                // SAFETY: the device is of the instance.
                let memory = unsafe { instance.get_physical_device_memory_properties(physical) };
                // SAFETY: as above.
                let limits = unsafe { instance.get_physical_device_properties(physical) }.limits;
                // SAFETY: the device was made with this queue.
                let queue = Mutex::new(unsafe { raw.get_device_queue(family, 0) });
                let alignment = limits.min_storage_buffer_offset_alignment.max(16);
                let range = u64::from(limits.max_storage_buffer_range);
                Arc::new(Self { instance, raw, family, queue, memory, alignment, range, pipelines })
            })
    }
}

type Opened = (ash::Device, u32, vk::PhysicalDevice, Pipelines);

/// Opens a device of an instance, with a queue and pipelines.
fn open(instance: &ash::Instance, wanted: DeviceIds) -> Result<Opened, Fault> {
    // SAFETY: the instance is valid.
    let all = unsafe { instance.enumerate_physical_devices() }.map_err(of("vkEnumeratePhysicalDevices"))?;
    let is_wanted = |physical: &vk::PhysicalDevice| {
        // SAFETY: the device is of the instance.
        let version = unsafe { instance.get_physical_device_properties(*physical) }.api_version;
        // SAFETY: as above. The instance has Vulkan 1.2, which has the function.
        let same = || unsafe { ids(instance.fp_v1_1().get_physical_device_properties2, *physical) } == wanted;
        version >= vk::API_VERSION_1_2 && same()
    };
    let physical = all.into_iter().find(is_wanted).ok_or(Fault::Device)?;
    check_sharing(instance, physical)?;
    let family = family(instance, physical).ok_or(Fault::Device)?;
    let queues = [vk::DeviceQueueCreateInfo::default().queue_family_index(family).queue_priorities(&[1.0])];
    let extensions = [khr::external_memory_fd::NAME.as_ptr()];
    // Every device has this feature. An access outside of a buffer then has no effect.
    let features = vk::PhysicalDeviceFeatures::default().robust_buffer_access(true);
    let info = vk::DeviceCreateInfo::default()
        .queue_create_infos(&queues)
        .enabled_extension_names(&extensions)
        .enabled_features(&features);
    // SAFETY: the device has the family and the extension, and the structures live as long as the call.
    let raw = unsafe { instance.create_device(physical, &info, None) }.map_err(of("vkCreateDevice"))?;
    match Pipelines::new(&raw) {
        Ok(pipelines) => Ok((raw, family, physical, pipelines)),
        Err(fault) => {
            // SAFETY: nothing uses the device.
            unsafe { raw.destroy_device(None) };
            Err(fault)
        }
    }
}

/// Selects a family of queues for computing, without graphics if there is one, so that the work runs next to the
/// application's.
fn family(instance: &ash::Instance, physical: vk::PhysicalDevice) -> Option<u32> {
    // SAFETY: the device is of the instance.
    let all = unsafe { instance.get_physical_device_queue_family_properties(physical) };
    let computes = |without: vk::QueueFlags| {
        all.iter().position(|family| {
            family.queue_flags.contains(vk::QueueFlags::COMPUTE) && !family.queue_flags.intersects(without)
        })
    };
    computes(vk::QueueFlags::GRAPHICS).or_else(|| computes(vk::QueueFlags::empty())).map(|index| index as u32)
}

/// Checks that the device exports and imports buffers as opaque descriptors, without dedicated memory.
fn check_sharing(instance: &ash::Instance, physical: vk::PhysicalDevice) -> Result<(), Fault> {
    // SAFETY: the device is of the instance.
    let extensions = unsafe { instance.enumerate_device_extension_properties(physical) }.unwrap_or_default();
    if !extensions.iter().any(|one| one.extension_name_as_c_str() == Ok(khr::external_memory_fd::NAME)) {
        return Err(Fault::Sharing);
    }
    let info = vk::PhysicalDeviceExternalBufferInfo::default().usage(USAGE).handle_type(OPAQUE);
    let mut properties = vk::ExternalBufferProperties::default();
    // SAFETY: as above. The device has Vulkan 1.2, which has the call.
    unsafe { instance.get_physical_device_external_buffer_properties(physical, &info, &mut properties) };
    use vk::ExternalMemoryFeatureFlags as Features;
    let features = properties.external_memory_properties.external_memory_features;
    let shares =
        features.contains(Features::EXPORTABLE | Features::IMPORTABLE) && !features.contains(Features::DEDICATED_ONLY);
    if shares { Ok(()) } else { Err(Fault::Sharing) }
}

impl Drop for Own {
    fn drop(&mut self) {
        // SAFETY: buffers and composers hold the device, so that none is left. No work is in progress, because each
        // waits for its own.
        unsafe {
            self.pipelines.destroy(&self.raw);
            self.raw.destroy_device(None);
            self.instance.destroy_instance(None);
        }
    }
}
