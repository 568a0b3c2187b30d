//! A swapchain for an ordinary window: resizable, and never waited for.
//!
//! It stands beside the [`Screen`](super::Screen), which shows every picture, in order and on time; this one shows the
//! newest when there is room for it, so that a thread that has something better to do can serve it in passing. It has a
//! device of its own: nothing of one queues behind the other.

use super::super::EngineError;
use super::shown::{choose, failed, opaque, plain, record_picture};
use super::target::{WindowHandle, make_surface};
use crate::gpu::{Instance, Messages};
use ash::{khr, vk};
use std::ffi::CStr;
use std::sync::Arc;

/// A window's swapchain, and the picture under way to it.
pub struct Canvas {
    device: ash::Device,
    queue: vk::Queue,
    pool: vk::CommandPool,
    commands: vk::CommandBuffer,
    acquired: vk::Semaphore,
    done: vk::Fence,
    staging: Staging,
    swapchain_calls: khr::swapchain::Device,
    swapchain: vk::SwapchainKHR,
    images: Vec<vk::Image>,
    rendered: Vec<vk::Semaphore>,
    surface_calls: khr::surface::Instance,
    surface: vk::SurfaceKHR,
    physical: vk::PhysicalDevice,
    format: vk::Format,
    extent: vk::Extent2D,
    stale: bool,
    name: String,
    // Goes last.
    instance: Instance,
}

/// Memory that the device copies pictures from.
struct Staging {
    buffer: vk::Buffer,
    memory: vk::DeviceMemory,
    mapped: *mut u8,
    bytes: u64,
}

impl Canvas {
    /// For a window.
    ///
    /// # Errors
    /// [`EngineError::NoDevice`]; [`EngineError::Unsuitable`]; [`EngineError::Vulkan`].
    ///
    /// # Safety
    /// The handles are those of a window that outlives the canvas.
    pub unsafe fn open(window: WindowHandle, validation: bool) -> Result<Self, EngineError> {
        let extension: &CStr = match window {
            WindowHandle::Xcb { .. } => khr::xcb_surface::NAME,
            WindowHandle::Xlib { .. } => khr::xlib_surface::NAME,
            WindowHandle::Wayland { .. } => khr::wayland_surface::NAME,
        };
        let instance = Instance::with(validation, &[khr::surface::NAME, extension])?;
        let surface_calls = khr::surface::Instance::new(&instance.entry, &instance.raw);
        // SAFETY: the instance has the extension, and the caller vouches for the handles.
        let surface = unsafe { make_surface(&instance, window) }.map_err(|e| failed("the window", "surface", e))?;
        let device = choose(&instance, &surface_calls, surface, None).and_then(|(physical, family, name)| {
            let (wanted, priorities) = ([khr::swapchain::NAME.as_ptr()], [1.0]);
            let queues =
                [vk::DeviceQueueCreateInfo::default().queue_family_index(family).queue_priorities(&priorities)];
            let info = vk::DeviceCreateInfo::default().queue_create_infos(&queues).enabled_extension_names(&wanted);
            // SAFETY: the device has the family and the extension.
            let device = unsafe { instance.raw.create_device(physical, &info, None) };
            device
                .map(|device| (device, physical, family, name.clone()))
                .map_err(|e| failed(&name, "vkCreateDevice", e))
        });
        let (device, physical, family, name) = device.inspect_err(|_| {
            // SAFETY: nothing was made of it.
            unsafe { surface_calls.destroy_surface(surface, None) };
        })?;
        // SAFETY: the family was asked for with one queue.
        let queue = unsafe { device.get_device_queue(family, 0) };
        let mut canvas = Self {
            queue,
            pool: vk::CommandPool::null(),
            commands: vk::CommandBuffer::null(),
            acquired: vk::Semaphore::null(),
            done: vk::Fence::null(),
            staging: Staging {
                buffer: vk::Buffer::null(),
                memory: vk::DeviceMemory::null(),
                mapped: std::ptr::null_mut(),
                bytes: 0,
            },
            swapchain_calls: khr::swapchain::Device::new(&instance.raw, &device),
            swapchain: vk::SwapchainKHR::null(),
            images: Vec::new(),
            rendered: Vec::new(),
            surface_calls,
            surface,
            physical,
            format: vk::Format::UNDEFINED,
            extent: vk::Extent2D::default(),
            stale: true,
            name,
            device,
            instance,
        };
        canvas.make_commands(family)?;
        Ok(canvas)
    }

    /// The device, in words.
    pub fn describe(&self) -> &str {
        &self.name
    }

    /// What the validation layer says, to the last.
    pub fn messages(&self) -> Messages {
        Arc::clone(&self.instance.messages)
    }

    fn error(&self, call: &'static str, result: vk::Result) -> EngineError {
        match result {
            vk::Result::ERROR_DEVICE_LOST => EngineError::DeviceLost { device: self.name.clone(), during: call.into() },
            vk::Result::ERROR_SURFACE_LOST_KHR => {
                EngineError::Unsuitable { device: self.name.clone(), reason: "the window is gone".into() }
            }
            other => failed(&self.name, call, other),
        }
    }

    fn make_commands(&mut self, family: u32) -> Result<(), EngineError> {
        let pool = vk::CommandPoolCreateInfo::default()
            .queue_family_index(family)
            .flags(vk::CommandPoolCreateFlags::RESET_COMMAND_BUFFER);
        // SAFETY: the device is valid; what is made is kept in `self` at once and destroyed with it.
        unsafe {
            self.pool =
                self.device.create_command_pool(&pool, None).map_err(|e| self.error("vkCreateCommandPool", e))?;
            let info = vk::CommandBufferAllocateInfo::default().command_pool(self.pool).command_buffer_count(1);
            let commands = self.device.allocate_command_buffers(&info);
            self.commands = commands.map_err(|e| self.error("vkAllocateCommandBuffers", e))?[0];
            let info = vk::SemaphoreCreateInfo::default();
            self.acquired =
                self.device.create_semaphore(&info, None).map_err(|e| self.error("vkCreateSemaphore", e))?;
            let info = vk::FenceCreateInfo::default().flags(vk::FenceCreateFlags::SIGNALED);
            self.done = self.device.create_fence(&info, None).map_err(|e| self.error("vkCreateFence", e))?;
        }
        Ok(())
    }

    /// Makes the swapchain again, with the window's size where the surface leaves the choice. None where it has no pixel
    /// now.
    fn make_swapchain(&mut self, [rows, columns]: [usize; 2]) -> Result<bool, EngineError> {
        let unsuitable = |reason: &str| EngineError::Unsuitable { device: self.name.clone(), reason: reason.into() };
        // SAFETY: the surface and the device are of this instance.
        let (can, formats, modes) = unsafe {
            (
                self.surface_calls
                    .get_physical_device_surface_capabilities(self.physical, self.surface)
                    .map_err(|e| self.error("surface capabilities", e))?,
                self.surface_calls
                    .get_physical_device_surface_formats(self.physical, self.surface)
                    .map_err(|e| self.error("surface formats", e))?,
                self.surface_calls
                    .get_physical_device_surface_present_modes(self.physical, self.surface)
                    .map_err(|e| self.error("present modes", e))?,
            )
        };
        let (least, most) = (can.min_image_extent, can.max_image_extent);
        let extent = match can.current_extent {
            vk::Extent2D { width: u32::MAX, .. } => vk::Extent2D {
                width: (columns as u32).min(most.width).max(least.width),
                height: (rows as u32).min(most.height).max(least.height),
            },
            is => is,
        };
        if extent.width == 0 || extent.height == 0 {
            return Ok(false);
        }
        // Pictures are sRGB already.
        let format = plain(&formats).ok_or_else(|| unsuitable("the window offers no UNORM format of 8 bits"))?;
        if !can.supported_usage_flags.contains(vk::ImageUsageFlags::TRANSFER_DST) {
            return Err(unsuitable("pictures cannot be copied into its window"));
        }
        let alpha = opaque(&can).ok_or_else(|| unsuitable("its window cannot be opaque"))?;
        // The newest counts, and nobody waits; FIFO is what every device has.
        let mode = [vk::PresentModeKHR::MAILBOX, vk::PresentModeKHR::IMMEDIATE]
            .into_iter()
            .find(|m| modes.contains(m))
            .unwrap_or(vk::PresentModeKHR::FIFO);
        let count = if can.max_image_count == 0 { u32::MAX } else { can.max_image_count };
        let info = vk::SwapchainCreateInfoKHR::default()
            .surface(self.surface)
            .min_image_count((can.min_image_count + 1).min(count))
            .image_format(format.format)
            .image_color_space(format.color_space)
            .image_extent(extent)
            .image_array_layers(1)
            .image_usage(vk::ImageUsageFlags::TRANSFER_DST)
            .image_sharing_mode(vk::SharingMode::EXCLUSIVE)
            .pre_transform(can.current_transform)
            .composite_alpha(alpha)
            .present_mode(mode)
            .clipped(true)
            .old_swapchain(self.swapchain);
        (self.format, self.extent) = (format.format, extent);
        // SAFETY: the device is idle before anything of the old swapchain is destroyed; all handles are valid.
        unsafe {
            let _ = self.device.device_wait_idle();
            let made = self.swapchain_calls.create_swapchain(&info, None);
            self.drop_swapchain();
            self.swapchain = made.map_err(|e| self.error("vkCreateSwapchainKHR", e))?;
            self.images = self
                .swapchain_calls
                .get_swapchain_images(self.swapchain)
                .map_err(|e| self.error("vkGetSwapchainImagesKHR", e))?;
            for _ in 0..self.images.len() {
                let info = vk::SemaphoreCreateInfo::default();
                let semaphore = self.device.create_semaphore(&info, None);
                self.rendered.push(semaphore.map_err(|e| self.error("vkCreateSemaphore", e))?);
            }
        }
        self.make_staging(4 * u64::from(extent.width) * u64::from(extent.height))?;
        self.stale = false;
        Ok(true)
    }

    /// The device is idle.
    fn make_staging(&mut self, bytes: u64) -> Result<(), EngineError> {
        if bytes <= self.staging.bytes {
            return Ok(());
        }
        self.drop_staging();
        let visible = vk::MemoryPropertyFlags::HOST_VISIBLE | vk::MemoryPropertyFlags::HOST_COHERENT;
        let info = vk::BufferCreateInfo::default().size(bytes).usage(vk::BufferUsageFlags::TRANSFER_SRC);
        // SAFETY: the device is valid; what is made is kept in `self` at once and destroyed with it; the memory is of a
        // kind that the buffer takes, and as large as it needs.
        unsafe {
            self.staging.buffer =
                self.device.create_buffer(&info, None).map_err(|e| self.error("vkCreateBuffer", e))?;
            let needs = self.device.get_buffer_memory_requirements(self.staging.buffer);
            let types = self.instance.raw.get_physical_device_memory_properties(self.physical);
            let kind = (0..types.memory_type_count).find(|i| {
                let flags = types.memory_types[*i as usize].property_flags;
                needs.memory_type_bits & (1 << i) != 0 && flags.contains(visible)
            });
            let Some(kind) = kind else { return Err(self.error("memory", vk::Result::ERROR_OUT_OF_DEVICE_MEMORY)) };
            let info = vk::MemoryAllocateInfo::default().allocation_size(needs.size).memory_type_index(kind);
            self.staging.memory =
                self.device.allocate_memory(&info, None).map_err(|e| self.error("vkAllocateMemory", e))?;
            self.device
                .bind_buffer_memory(self.staging.buffer, self.staging.memory, 0)
                .map_err(|e| self.error("vkBindBufferMemory", e))?;
            let mapped = self.device.map_memory(self.staging.memory, 0, vk::WHOLE_SIZE, vk::MemoryMapFlags::empty());
            self.staging.mapped = mapped.map_err(|e| self.error("vkMapMemory", e))?.cast();
        }
        self.staging.bytes = bytes;
        Ok(())
    }

    fn drop_staging(&mut self) {
        // SAFETY: called with the device idle; null handles are ignored, and each is destroyed once.
        unsafe {
            self.device.destroy_buffer(self.staging.buffer, None);
            self.device.free_memory(self.staging.memory, None);
        }
        (self.staging.buffer, self.staging.memory) = (vk::Buffer::null(), vk::DeviceMemory::null());
        self.staging.bytes = 0;
    }

    /// # Safety
    /// The device is idle.
    unsafe fn drop_swapchain(&mut self) {
        // SAFETY: the caller says so; each is destroyed once.
        unsafe {
            self.rendered.drain(..).for_each(|s| self.device.destroy_semaphore(s, None));
            self.swapchain_calls.destroy_swapchain(self.swapchain, None);
        }
        self.swapchain = vk::SwapchainKHR::null();
        self.images.clear();
    }

    /// Shows a picture of `size` rows and columns, red, green, blue of 8 bits, if that can be done without waiting: whether
    /// it was. What the window has more than the picture is black; what the picture has more is not shown.
    ///
    /// # Errors
    /// The window is gone; a lost device; [`EngineError::Mismatch`].
    pub fn present(&mut self, rgb: &[u8], size: [usize; 2]) -> Result<bool, EngineError> {
        if rgb.len() != 3 * size[0] * size[1] {
            let reason = format!("a picture of {}x{} has {} bytes", size[0], size[1], rgb.len());
            return Err(EngineError::Mismatch { reason });
        }
        let resized = (self.extent.height as usize, self.extent.width as usize) != (size[0], size[1]);
        if (self.stale || resized) && !self.make_swapchain(size)? {
            return Ok(false);
        }
        // SAFETY: the fence is the device's, the semaphore is free once the fence is signalled, and neither is waited for.
        let image = unsafe {
            match self.device.get_fence_status(self.done) {
                Ok(true) => {}
                Ok(false) => return Ok(false),
                Err(e) => return Err(self.error("vkGetFenceStatus", e)),
            }
            self.swapchain_calls.acquire_next_image(self.swapchain, 0, self.acquired, vk::Fence::null())
        };
        let image = match image {
            Ok((image, suboptimal)) => {
                self.stale = suboptimal;
                image
            }
            Err(vk::Result::NOT_READY | vk::Result::TIMEOUT) => return Ok(false),
            Err(vk::Result::ERROR_OUT_OF_DATE_KHR) => {
                self.stale = true;
                return Ok(false);
            }
            Err(e) => return Err(self.error("vkAcquireNextImageKHR", e)),
        };
        self.fill(rgb, size);
        self.submit(image)?;
        Ok(true)
    }

    fn fill(&mut self, rgb: &[u8], [rows, columns]: [usize; 2]) {
        let (height, width) = (self.extent.height as usize, self.extent.width as usize);
        // SAFETY: the buffer is mapped, has four bytes for each pixel of the swapchain, and the device has read it.
        let staging = unsafe { std::slice::from_raw_parts_mut(self.staging.mapped, 4 * height * width) };
        let blue_first = self.format == vk::Format::B8G8R8A8_UNORM;
        let black: &[u8] = &[];
        let lines = rgb.chunks_exact(3 * columns.max(1)).take(rows).chain(std::iter::repeat(black));
        for (to, from) in staging.chunks_exact_mut(4 * width).zip(lines) {
            let shown = from.len().min(3 * width) / 3;
            for (to, from) in to.chunks_exact_mut(4).zip(from.chunks_exact(3)) {
                let [r, g, b] = [from[0], from[1], from[2]];
                to.copy_from_slice(&if blue_first { [b, g, r, 255] } else { [r, g, b, 255] });
            }
            to[4 * shown..].chunks_exact_mut(4).for_each(|p| p.copy_from_slice(&[0, 0, 0, 255]));
        }
    }

    /// Copies the staged picture into an image that was acquired, and presents it.
    fn submit(&mut self, image: u32) -> Result<(), EngineError> {
        let rendered = [self.rendered[image as usize]];
        let transfer = vk::PipelineStageFlags::TRANSFER;
        let begin = vk::CommandBufferBeginInfo::default().flags(vk::CommandBufferUsageFlags::ONE_TIME_SUBMIT);
        let (wait, stages, commands) = ([self.acquired], [transfer], [self.commands]);
        let submit = vk::SubmitInfo::default()
            .wait_semaphores(&wait)
            .wait_dst_stage_mask(&stages)
            .command_buffers(&commands)
            .signal_semaphores(&rendered);
        let (chains, indices) = ([self.swapchain], [image]);
        let info = vk::PresentInfoKHR::default().wait_semaphores(&rendered).swapchains(&chains).image_indices(&indices);
        // SAFETY: the fence was signalled, so the commands are free; every handle is of this device, and everything
        // pointed to lives until the calls return. The wait on the acquired image is at the stage of the first barrier.
        let presented = unsafe {
            self.device.reset_fences(&[self.done]).map_err(|e| self.error("vkResetFences", e))?;
            self.device
                .begin_command_buffer(self.commands, &begin)
                .map_err(|e| self.error("vkBeginCommandBuffer", e))?;
            let (from, to) = (self.staging.buffer, self.images[image as usize]);
            record_picture(&self.device, self.commands, from, to, self.extent);
            self.device.end_command_buffer(self.commands).map_err(|e| self.error("vkEndCommandBuffer", e))?;
            self.device.queue_submit(self.queue, &[submit], self.done).map_err(|e| self.error("vkQueueSubmit", e))?;
            self.swapchain_calls.queue_present(self.queue, &info)
        };
        match presented {
            Ok(suboptimal) => self.stale |= suboptimal,
            Err(vk::Result::ERROR_OUT_OF_DATE_KHR) => self.stale = true,
            Err(e) => return Err(self.error("vkQueuePresentKHR", e)),
        }
        Ok(())
    }
}

impl Drop for Canvas {
    fn drop(&mut self) {
        // SAFETY: the device is idle, and everything is destroyed once, before what it was made from.
        unsafe {
            let _ = self.device.device_wait_idle();
            self.drop_swapchain();
            self.drop_staging();
            self.device.destroy_semaphore(self.acquired, None);
            self.device.destroy_fence(self.done, None);
            self.device.destroy_command_pool(self.pool, None);
            self.device.destroy_device(None);
            self.surface_calls.destroy_surface(self.surface, None);
        }
    }
}
