//! Runs eyebox on a Vulkan device that the program opened itself and continues to own.
//!
//! Run `cargo run --example own_vulkan_device`.

#![allow(unsafe_code)]

use eyebox::engine::VulkanEngine;
use eyebox::gpu::Gpu;
use eyebox::low_level::gpu::RawDevice;
use eyebox::low_level::gpu::ash::{self, vk};
use eyebox::optics::{Color, Display, Padding};
use eyebox::scene::{self, Request};
use eyebox::solve::{Flow, Problem, Settings, solve};
use std::error::Error;

/// The program's own device. It is any device that computes, with the one feature that eyebox needs.
fn own(entry: &ash::Entry) -> Result<(ash::Instance, ash::Device, RawDevice), Box<dyn Error>> {
    let about = vk::ApplicationInfo::default().api_version(vk::API_VERSION_1_2);
    // SAFETY: all that the structures point to lives until the calls return, and `main` destroys what is made, last.
    unsafe {
        let instance = entry.create_instance(&vk::InstanceCreateInfo::default().application_info(&about), None)?;
        let physical = *instance.enumerate_physical_devices()?.first().ok_or("there is no device")?;
        let families = instance.get_physical_device_queue_family_properties(physical);
        let computes = |f: &vk::QueueFamilyProperties| f.queue_flags.contains(vk::QueueFlags::COMPUTE);
        let family = families.iter().position(computes).ok_or("it does not compute")? as u32;
        let queues = [vk::DeviceQueueCreateInfo::default().queue_family_index(family).queue_priorities(&[1.0])];
        let mut timeline = vk::PhysicalDeviceTimelineSemaphoreFeatures::default().timeline_semaphore(true);
        let info = vk::DeviceCreateInfo::default().queue_create_infos(&queues).push_next(&mut timeline);
        let device = instance.create_device(physical, &info, None)?;
        let raw = RawDevice {
            entry: entry.clone(),
            instance: instance.handle(),
            instance_extensions: Vec::new(),
            physical,
            device: device.handle(),
            device_extensions: Vec::new(),
            family,
            queue: device.get_device_queue(family, 0),
        };
        Ok((instance, device, raw))
    }
}

/// Opens a device, lends it to eyebox, solves, and closes the device.
///
/// # Errors
/// There is no device, or eyebox returns an error.
pub fn main() -> Result<(), Box<dyn Error>> {
    // SAFETY: what is called Vulkan on this machine is trusted to be Vulkan.
    let entry = unsafe { ash::Entry::load()? };
    let (instance, device, raw) = own(&entry)?;
    {
        // SAFETY: the handles belong together and live until after this block, and nobody else makes use of the queue.
        let gpu = unsafe { Gpu::from_raw(raw, None)? };
        let display = Display { height: 24, width: 32, ..Display::load("small")? };
        let field = scene::load("builtin:plane", &Request { views: 3, ..Request::new(&display, &[Color::Green]) })?;
        let problem = Problem::new(&field, Color::Green, &display, Padding::default())?;
        let settings = Settings { steps: 3, frames: 2, ..Settings::default() };
        let mut engine = VulkanEngine::new(&gpu)?;
        let solution = solve(&problem, &settings, &mut engine, &mut |_| Flow::Continue)?;
        println!("{}: {:.1} dB", gpu.report().name, solution.validation.mean());
    }
    // SAFETY: all that was made from them is gone.
    unsafe {
        device.destroy_device(None);
        instance.destroy_instance(None);
    }
    Ok(())
}
