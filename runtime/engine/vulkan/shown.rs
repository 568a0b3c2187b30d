//! What the swapchains of a screen and of a canvas have in common: which device shows, in which format, and how a picture
//! gets into an image.

use super::super::EngineError;
use crate::gpu::{Instance, has};
use ash::{khr, vk};

pub(super) fn failed(name: &str, call: &'static str, result: vk::Result) -> EngineError {
    EngineError::Vulkan { device: name.into(), call, result: format!("{result:?}") }
}

/// The format whose levels are the bytes. Drivers list sRGB formats first, which would change them.
pub(super) fn plain(formats: &[vk::SurfaceFormatKHR]) -> Option<vk::SurfaceFormatKHR> {
    let plain = [vk::Format::B8G8R8A8_UNORM, vk::Format::R8G8B8A8_UNORM];
    let is =
        |f: &&vk::SurfaceFormatKHR| plain.contains(&f.format) && f.color_space == vk::ColorSpaceKHR::SRGB_NONLINEAR;
    formats.iter().find(is).copied()
}

/// How a window covers what is below it.
pub(super) fn opaque(can: &vk::SurfaceCapabilitiesKHR) -> Option<vk::CompositeAlphaFlagsKHR> {
    let ways = [vk::CompositeAlphaFlagsKHR::OPAQUE, vk::CompositeAlphaFlagsKHR::INHERIT];
    ways.into_iter().find(|a| can.supported_composite_alpha.contains(*a))
}

/// Records the copy of a picture into an image that was acquired, and what lets it be presented.
///
/// # Safety
/// The commands are being recorded; they, the buffer, which has four bytes for each pixel of the extent, and the image of
/// that extent are this device's and outlive the submission, which waits for the image at the stage of transfers: the change
/// of layout comes after that.
pub(super) unsafe fn record_picture(
    device: &ash::Device,
    commands: vk::CommandBuffer,
    from: vk::Buffer,
    image: vk::Image,
    extent: vk::Extent2D,
) {
    let layers = vk::ImageSubresourceLayers::default().aspect_mask(vk::ImageAspectFlags::COLOR).layer_count(1);
    let range =
        vk::ImageSubresourceRange::default().aspect_mask(vk::ImageAspectFlags::COLOR).level_count(1).layer_count(1);
    let barrier = vk::ImageMemoryBarrier::default()
        .image(image)
        .subresource_range(range)
        .src_queue_family_index(vk::QUEUE_FAMILY_IGNORED)
        .dst_queue_family_index(vk::QUEUE_FAMILY_IGNORED);
    let written = vk::ImageLayout::TRANSFER_DST_OPTIMAL;
    let into = barrier
        .old_layout(vk::ImageLayout::UNDEFINED)
        .new_layout(written)
        .dst_access_mask(vk::AccessFlags::TRANSFER_WRITE);
    let out = barrier
        .old_layout(written)
        .new_layout(vk::ImageLayout::PRESENT_SRC_KHR)
        .src_access_mask(vk::AccessFlags::TRANSFER_WRITE);
    let vk::Extent2D { width, height } = extent;
    let extent = vk::Extent3D { width, height, depth: 1 };
    let copy = vk::BufferImageCopy::default().image_subresource(layers).image_extent(extent);
    let (transfer, bottom) = (vk::PipelineStageFlags::TRANSFER, vk::PipelineStageFlags::BOTTOM_OF_PIPE);
    let none = vk::DependencyFlags::empty();
    // SAFETY: the caller says so.
    unsafe {
        device.cmd_pipeline_barrier(commands, transfer, transfer, none, &[], &[], &[into]);
        device.cmd_copy_buffer_to_image(commands, from, image, written, &[copy]);
        device.cmd_pipeline_barrier(commands, transfer, bottom, none, &[], &[], &[out]);
    }
}

/// The first device that can show on the surface, real ones first, and its queue family.
pub(super) fn choose(
    instance: &Instance,
    calls: &khr::surface::Instance,
    surface: vk::SurfaceKHR,
    only: Option<vk::PhysicalDevice>,
) -> Result<(vk::PhysicalDevice, u32, String), EngineError> {
    // SAFETY: the instance is valid.
    let devices = unsafe { instance.raw.enumerate_physical_devices() }.unwrap_or_default();
    let mut found: Vec<(bool, vk::PhysicalDevice, u32, String)> = Vec::new();
    for device in devices.into_iter().filter(|d| only.is_none_or(|o| o == *d)) {
        // SAFETY: the device and the surface are of this instance.
        let (properties, families, extensions) = unsafe {
            (
                instance.raw.get_physical_device_properties(device),
                instance.raw.get_physical_device_queue_family_properties(device),
                instance.raw.enumerate_device_extension_properties(device).unwrap_or_default(),
            )
        };
        if !has(&extensions, khr::swapchain::NAME) {
            continue;
        }
        let shows = |family: &u32| {
            // SAFETY: as above; the family is one of the device's.
            let supported = unsafe { calls.get_physical_device_surface_support(device, *family, surface) };
            let graphics = families[*family as usize].queue_flags.contains(vk::QueueFlags::GRAPHICS);
            graphics && supported.unwrap_or(false)
        };
        if let Some(family) = (0..families.len() as u32).find(shows) {
            let name = properties.device_name_as_c_str().map_or_else(|_| String::new(), |n| n.to_string_lossy().into());
            found.push((properties.device_type == vk::PhysicalDeviceType::CPU, device, family, name));
        }
    }
    found.sort_by_key(|f| f.0);
    let first = found.into_iter().next();
    first.map(|f| (f.1, f.2, f.3)).ok_or_else(|| EngineError::NoDevice {
        reason: "no Vulkan device can show pictures in a window of this system".into(),
    })
}
