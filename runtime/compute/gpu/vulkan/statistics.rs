//! Reads compiler statistics of pipelines from drivers, for tests.
//!
//! The extension is `VK_KHR_pipeline_executable_properties`. RADV compiles for absent devices (`RADV_FORCE_FAMILY`),
//! which can run nothing and have no memory.

use super::modules::FloatModes;
use super::pipelines::PUSH_BYTES;
use ash::{khr, vk};
use rayon::iter::{IntoParallelRefIterator, ParallelIterator};
use std::collections::BTreeMap;
use std::time::Instant;

/// A pipeline to compile, with the name of its module, its number of buffers and its constants.
pub type Key = (String, u32, Vec<u32>);

/// Numbers by the driver's names for them, with the microseconds of compilation.
pub type Statistics = BTreeMap<String, u64>;

/// Compiles each for the first device that the loader finds. Returns the device's name, and the statistics of each.
///
/// # Errors
/// The missing part, or the failed call.
pub fn compile(keys: &[Key]) -> Result<(String, Vec<Statistics>), String> {
    let failed = |what: &'static str| move |e: vk::Result| format!("{what}: {e}");
    // SAFETY: the loader is a Vulkan loader.
    let entry = unsafe { ash::Entry::load() }.map_err(|e| e.to_string())?;
    let about = vk::ApplicationInfo::default().api_version(vk::API_VERSION_1_2);
    let info = vk::InstanceCreateInfo::default().application_info(&about);
    // SAFETY: the pointers in `info` stay valid until the call returns.
    let instance = unsafe { entry.create_instance(&info, None) }.map_err(failed("vkCreateInstance"))?;
    // SAFETY: the instance is alive, and is destroyed after everything that is made of it.
    let told = unsafe {
        let all = instance.enumerate_physical_devices().map_err(failed("vkEnumeratePhysicalDevices"));
        let told = all.and_then(|all| of_device(&instance, *all.first().ok_or("no device")?, keys));
        instance.destroy_instance(None);
        told
    };
    drop(entry);
    told
}

/// # Safety
/// The device is the instance's.
unsafe fn of_device(
    instance: &ash::Instance,
    physical: vk::PhysicalDevice,
    keys: &[Key],
) -> Result<(String, Vec<Statistics>), String> {
    // SAFETY: the caller guarantees it.
    let properties = unsafe { instance.get_physical_device_properties(physical) };
    let name = properties.device_name_as_c_str().map_or_else(|_| "?".into(), |n| n.to_string_lossy().into_owned());
    let mut tells = vk::PhysicalDevicePipelineExecutablePropertiesFeaturesKHR::default().pipeline_executable_info(true);
    let queues = [vk::DeviceQueueCreateInfo::default().queue_family_index(0).queue_priorities(&[1.0])];
    let extensions = [khr::pipeline_executable_properties::NAME.as_ptr()];
    let info = vk::DeviceCreateInfo::default()
        .queue_create_infos(&queues)
        .enabled_extension_names(&extensions)
        .push_next(&mut tells);
    // SAFETY: the pointers in `info` stay valid until the call returns.
    let device = unsafe { instance.create_device(physical, &info, None) }.map_err(|e| format!("{name}: {e}"))?;
    let asked = khr::pipeline_executable_properties::Device::new(instance, &device);
    let mut floats = vk::PhysicalDeviceFloatControlsProperties::default();
    let mut all = vk::PhysicalDeviceProperties2::default().push_next(&mut floats);
    // SAFETY: as above, of Vulkan 1.2, which knows the structure.
    unsafe { instance.get_physical_device_properties2(physical, &mut all) };
    let modes = FloatModes::of(&floats);
    // SAFETY: the device is alive, and everything made of it is gone when it is destroyed.
    let told: Result<_, String> =
        keys.par_iter().map(|key| unsafe { of_pipeline(&device, &asked, &modes, key) }).collect();
    // SAFETY: as above.
    unsafe { device.destroy_device(None) };
    Ok((name, told?))
}

/// # Safety
/// The device is alive and has the extension.
unsafe fn of_pipeline(
    device: &ash::Device,
    asked: &khr::pipeline_executable_properties::Device,
    modes: &FloatModes,
    (module, bindings, constants): &Key,
) -> Result<Statistics, String> {
    let failed = |what: &'static str| move |e: vk::Result| format!("{module}: {what}: {e}");
    let words = modes.put_into(eyebox_spirv::module(module).ok_or("no such module")?.words());
    let (entries, values) = modes.specialised(constants);
    let special = vk::SpecializationInfo::default().map_entries(&entries).data(bytemuck::cast_slice(&values));
    let slot = |i| {
        let slot = vk::DescriptorSetLayoutBinding::default().binding(i).descriptor_count(1);
        slot.descriptor_type(vk::DescriptorType::STORAGE_BUFFER).stage_flags(vk::ShaderStageFlags::COMPUTE)
    };
    let slots: Vec<_> = (0..*bindings).map(slot).collect();
    let push = [vk::PushConstantRange::default().stage_flags(vk::ShaderStageFlags::COMPUTE).size(PUSH_BYTES)];
    // SAFETY: each is made of live objects, and destroyed once, after the objects made of it.
    unsafe {
        let info = vk::ShaderModuleCreateInfo::default().code(&words);
        let shader = device.create_shader_module(&info, None).map_err(failed("vkCreateShaderModule"))?;
        let info = vk::DescriptorSetLayoutCreateInfo::default().bindings(&slots);
        let set = device.create_descriptor_set_layout(&info, None).map_err(failed("vkCreateDescriptorSetLayout"))?;
        let sets = [set];
        let info = vk::PipelineLayoutCreateInfo::default().set_layouts(&sets).push_constant_ranges(&push);
        let layout = device.create_pipeline_layout(&info, None).map_err(failed("vkCreatePipelineLayout"))?;
        let stage = vk::PipelineShaderStageCreateInfo::default()
            .stage(vk::ShaderStageFlags::COMPUTE)
            .module(shader)
            .name(c"main")
            .specialization_info(&special);
        let info = vk::ComputePipelineCreateInfo::default().stage(stage).layout(layout);
        let info = [info.flags(vk::PipelineCreateFlags::CAPTURE_STATISTICS_KHR)];
        let begun = Instant::now();
        let made = device.create_compute_pipelines(vk::PipelineCache::null(), &info, None);
        let took = ("microseconds".to_owned(), begun.elapsed().as_micros() as u64);
        let made = made.map_err(|(_, e)| failed("vkCreateComputePipelines")(e))?[0];
        let of = vk::PipelineExecutableInfoKHR::default().pipeline(made).executable_index(0);
        let numbers = asked.get_pipeline_executable_statistics(&of).map_err(failed("its statistics"));
        device.destroy_pipeline(made, None);
        device.destroy_pipeline_layout(layout, None);
        device.destroy_descriptor_set_layout(set, None);
        device.destroy_shader_module(shader, None);
        let number = |s: &vk::PipelineExecutableStatisticKHR| {
            let name = s.name_as_c_str().map_or_else(|_| String::new(), |n| n.to_string_lossy().into_owned());
            (name, s.value.u64)
        };
        Ok(numbers?.iter().map(number).chain([took]).collect())
    }
}
