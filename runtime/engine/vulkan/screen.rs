//! A swapchain that shows bytes as they are: UNORM, first in first out, no scaling, exactly the picture's size.

use super::super::EngineError;
use super::lit::{How, Lit, Teller, has_present_wait, present_number};
use super::shown::{choose, failed, opaque, plain, record_picture};
use super::target::{Target, WindowHandle};
use crate::gpu::{Instance, Messages};
use ash::{khr, vk};
use std::sync::Arc;
use std::time::Instant;

/// Pictures under way to the screen, each with its staging buffer.
const SLOTS: usize = 2;
/// How long the screen may take for a picture before it counts as lost.
const PATIENCE_NS: u64 = 2_000_000_000;

struct Slot {
    buffer: vk::Buffer,
    memory: vk::DeviceMemory,
    mapped: *mut u8,
    commands: vk::CommandBuffer,
    acquired: vk::Semaphore,
    done: vk::Fence,
}

/// The swapchain of a window, or of a display that no desktop drives, and what feeds it.
pub struct Screen {
    pub(super) device: ash::Device,
    queue: vk::Queue,
    pool: vk::CommandPool,
    slots: Vec<Slot>,
    next: usize,
    swapchain_calls: khr::swapchain::Device,
    swapchain: vk::SwapchainKHR,
    images: Vec<vk::Image>,
    rendered: Vec<vk::Semaphore>,
    pub(super) surface_calls: khr::surface::Instance,
    pub(super) surface: vk::SurfaceKHR,
    pub(super) physical: vk::PhysicalDevice,
    pub(super) family: u32,
    pub(super) teller: Teller,
    format: vk::Format,
    size: [usize; 2],
    /// The swapchain could be better; it was made again for that.
    pub(super) suboptimal: bool,
    pub(super) tolerated: bool,
    pub(super) name: String,
    /// What a test has the driver answer, call by call.
    #[cfg(test)]
    pub(super) pretended: std::collections::VecDeque<(&'static str, vk::Result)>,
    pub(super) target: Target,
    // Goes last.
    pub(super) instance: Instance,
}

impl Screen {
    /// A swapchain on a window whose inside has `size` (rows, columns) pixels.
    ///
    /// # Errors
    /// [`EngineError::NoDevice`]; [`EngineError::Unsuitable`] where no device can show bytes as they are, and where the
    /// window's size is another one; [`EngineError::Vulkan`].
    ///
    /// # Safety
    /// The handles are those of a window that outlives the screen.
    pub unsafe fn open(window: WindowHandle, size: [usize; 2], validation: bool) -> Result<Self, EngineError> {
        let instance = Instance::with(validation, &[khr::surface::NAME, window.extension()])?;
        // SAFETY: the instance has the extension, and the caller vouches for the handles.
        unsafe { Self::on(instance, Target::Window(window), size) }
    }

    /// A swapchain on a target.
    ///
    /// # Errors
    /// Those of [`open`](Self::open).
    ///
    /// # Safety
    /// The instance has the extension of the target, and the handles of a window are those of one that outlives the screen.
    pub(super) unsafe fn on(instance: Instance, target: Target, size: [usize; 2]) -> Result<Self, EngineError> {
        let surface_calls = khr::surface::Instance::new(&instance.entry, &instance.raw);
        // SAFETY: the caller vouches for it.
        let surface = unsafe { target.surface(&instance) }.map_err(|e| failed("the screen", "surface", e))?;
        let direct = target.direct();
        let chosen = choose(&instance, &surface_calls, surface, direct.map(|d| d.0));
        let (physical, family, name) = match chosen {
            Ok(chosen) => chosen,
            Err(error) => {
                // SAFETY: nothing was made of it.
                unsafe { surface_calls.destroy_surface(surface, None) };
                return Err(error);
            }
        };
        // SAFETY: the device is of this instance.
        let extensions = unsafe { instance.raw.enumerate_device_extension_properties(physical) }.unwrap_or_default();
        let how = How::best(&extensions, has_present_wait(&instance.raw, physical, &extensions), direct.is_some());
        let mut wanted = vec![khr::swapchain::NAME.as_ptr()];
        wanted.extend(how.extensions().iter().map(|name| name.as_ptr()));
        let mut id = vk::PhysicalDevicePresentIdFeaturesKHR::default().present_id(true);
        let mut wait = vk::PhysicalDevicePresentWaitFeaturesKHR::default().present_wait(true);
        let priorities = [1.0];
        let queues = [vk::DeviceQueueCreateInfo::default().queue_family_index(family).queue_priorities(&priorities)];
        let mut info = vk::DeviceCreateInfo::default().queue_create_infos(&queues).enabled_extension_names(&wanted);
        if how == How::PresentWait {
            info = info.push_next(&mut id).push_next(&mut wait);
        }
        // SAFETY: the device has the family, the extensions and the features.
        let device = unsafe { instance.raw.create_device(physical, &info, None) };
        let device = match device {
            Ok(device) => device,
            Err(e) => {
                // SAFETY: nothing was made of it.
                unsafe { surface_calls.destroy_surface(surface, None) };
                return Err(failed(&name, "vkCreateDevice", e));
            }
        };
        // SAFETY: the family was asked for with one queue.
        let queue = unsafe { device.get_device_queue(family, 0) };
        let mut screen = Self {
            queue,
            pool: vk::CommandPool::null(),
            slots: Vec::new(),
            next: 0,
            swapchain_calls: khr::swapchain::Device::new(&instance.raw, &device),
            swapchain: vk::SwapchainKHR::null(),
            images: Vec::new(),
            rendered: Vec::new(),
            surface_calls,
            surface,
            physical,
            family,
            teller: Teller::new(&instance.raw, &device, how, direct.map_or(vk::DisplayKHR::null(), |d| d.1)),
            format: vk::Format::UNDEFINED,
            size,
            suboptimal: false,
            tolerated: false,
            name,
            #[cfg(test)]
            pretended: Default::default(),
            target,
            device,
            instance,
        };
        screen.make_slots(family)?;
        screen.make_swapchain()?;
        Ok(screen)
    }

    /// The device, and how it is known when pictures light up.
    pub fn describe(&self) -> String {
        format!("{} ({:?}, first in first out, timed by {})", self.name, self.format, self.timed_by())
    }

    /// How it is known when pictures light up.
    pub fn timed_by(&self) -> &'static str {
        self.teller.how().name()
    }

    /// What the validation layer says, to the last.
    pub fn messages(&self) -> Messages {
        Arc::clone(&self.instance.messages)
    }

    fn make_slots(&mut self, family: u32) -> Result<(), EngineError> {
        let bytes = 4 * (self.size[0] * self.size[1]) as u64;
        let pool = vk::CommandPoolCreateInfo::default()
            .queue_family_index(family)
            .flags(vk::CommandPoolCreateFlags::RESET_COMMAND_BUFFER);
        // SAFETY: the device is valid; what is made is kept in `self` at once and destroyed with it.
        unsafe {
            self.pool =
                self.device.create_command_pool(&pool, None).map_err(|e| self.error("vkCreateCommandPool", e))?;
            let memory_types = self.instance.raw.get_physical_device_memory_properties(self.physical);
            for _ in 0..SLOTS {
                let info = vk::BufferCreateInfo::default().size(bytes).usage(vk::BufferUsageFlags::TRANSFER_SRC);
                let buffer = self.device.create_buffer(&info, None).map_err(|e| self.error("vkCreateBuffer", e))?;
                self.slots.push(Slot {
                    buffer,
                    memory: vk::DeviceMemory::null(),
                    mapped: std::ptr::null_mut(),
                    commands: vk::CommandBuffer::null(),
                    acquired: vk::Semaphore::null(),
                    done: vk::Fence::null(),
                });
                let at = self.slots.len() - 1;
                let needs = self.device.get_buffer_memory_requirements(buffer);
                let visible = vk::MemoryPropertyFlags::HOST_VISIBLE | vk::MemoryPropertyFlags::HOST_COHERENT;
                let kind = (0..memory_types.memory_type_count).find(|i| {
                    let flags = memory_types.memory_types[*i as usize].property_flags;
                    needs.memory_type_bits & (1 << i) != 0 && flags.contains(visible)
                });
                let Some(kind) = kind else { return Err(self.error("memory", vk::Result::ERROR_OUT_OF_DEVICE_MEMORY)) };
                let info = vk::MemoryAllocateInfo::default().allocation_size(needs.size).memory_type_index(kind);
                let memory = self.device.allocate_memory(&info, None).map_err(|e| self.error("vkAllocateMemory", e))?;
                self.slots[at].memory = memory;
                self.device.bind_buffer_memory(buffer, memory, 0).map_err(|e| self.error("vkBindBufferMemory", e))?;
                let mapped = self
                    .device
                    .map_memory(memory, 0, vk::WHOLE_SIZE, vk::MemoryMapFlags::empty())
                    .map_err(|e| self.error("vkMapMemory", e))?;
                self.slots[at].mapped = mapped.cast();
                let info = vk::CommandBufferAllocateInfo::default().command_pool(self.pool).command_buffer_count(1);
                let commands = self
                    .device
                    .allocate_command_buffers(&info)
                    .map_err(|e| self.error("vkAllocateCommandBuffers", e))?;
                self.slots[at].commands = commands[0];
                let info = vk::SemaphoreCreateInfo::default();
                self.slots[at].acquired =
                    self.device.create_semaphore(&info, None).map_err(|e| self.error("vkCreateSemaphore", e))?;
                let info = vk::FenceCreateInfo::default().flags(vk::FenceCreateFlags::SIGNALED);
                self.slots[at].done =
                    self.device.create_fence(&info, None).map_err(|e| self.error("vkCreateFence", e))?;
            }
        }
        Ok(())
    }

    /// What the surface can do, where it has the picture's size.
    pub(super) fn capabilities(&self) -> Result<vk::SurfaceCapabilitiesKHR, EngineError> {
        // SAFETY: the surface and the device are of this instance.
        let can = unsafe { self.surface_calls.get_physical_device_surface_capabilities(self.physical, self.surface) };
        let can = can.map_err(|e| self.error("surface capabilities", e))?;
        let ([height, width], is) = (self.size.map(|n| n as u32), can.current_extent);
        if is.width != u32::MAX && (is.width, is.height) != (width, height) {
            let reason = format!(
                "the window is {}x{} pixels, and a video frame has {height}x{width}: nothing is scaled, so they must be \
                 equal",
                is.height, is.width
            );
            return Err(EngineError::Unsuitable { device: self.name.clone(), reason });
        }
        Ok(can)
    }

    pub(super) fn make_swapchain(&mut self) -> Result<(), EngineError> {
        let unsuitable = |reason: String| EngineError::Unsuitable { device: self.name.clone(), reason };
        let can = self.capabilities()?;
        // SAFETY: the surface and the device are of this instance.
        let formats = unsafe { self.surface_calls.get_physical_device_surface_formats(self.physical, self.surface) };
        let formats = formats.map_err(|e| self.error("surface formats", e))?;
        let format = plain(&formats).ok_or_else(|| {
            unsuitable("the window offers no UNORM format of 8 bits, and others change the levels".into())
        })?;
        let [height, width] = self.size.map(|n| n as u32);
        if !can.supported_usage_flags.contains(vk::ImageUsageFlags::TRANSFER_DST) {
            return Err(unsuitable("pictures cannot be copied into its window".into()));
        }
        let most = if can.max_image_count == 0 { u32::MAX } else { can.max_image_count };
        let alpha = opaque(&can).ok_or_else(|| unsuitable("its window cannot be opaque".into()))?;
        let old = self.swapchain;
        let info = vk::SwapchainCreateInfoKHR::default()
            .surface(self.surface)
            .min_image_count((can.min_image_count + 1).min(most))
            .image_format(format.format)
            .image_color_space(format.color_space)
            .image_extent(vk::Extent2D { width, height })
            .image_array_layers(1)
            .image_usage(vk::ImageUsageFlags::TRANSFER_DST)
            .image_sharing_mode(vk::SharingMode::EXCLUSIVE)
            .pre_transform(can.current_transform)
            .composite_alpha(alpha)
            // MAILBOX may leave a sub-frame out.
            .present_mode(vk::PresentModeKHR::FIFO)
            .clipped(true)
            .old_swapchain(old);
        self.format = format.format;
        // SAFETY: the device is idle before anything of the old swapchain is destroyed; all handles are valid.
        unsafe {
            let _ = self.device.device_wait_idle();
            self.teller.renewed();
            let made = self.swapchain_calls.create_swapchain(&info, None);
            self.drop_swapchain();
            self.swapchain = made.map_err(|e| self.error("vkCreateSwapchainKHR", e))?;
            self.images = self
                .swapchain_calls
                .get_swapchain_images(self.swapchain)
                .map_err(|e| self.error("vkGetSwapchainImagesKHR", e))?;
            for _ in 0..self.images.len() {
                let semaphore = self
                    .device
                    .create_semaphore(&vk::SemaphoreCreateInfo::default(), None)
                    .map_err(|e| self.error("vkCreateSemaphore", e))?;
                self.rendered.push(semaphore);
            }
        }
        Ok(())
    }

    /// # Safety
    /// The device is idle.
    pub(super) unsafe fn drop_swapchain(&mut self) {
        // SAFETY: the caller says so; each is destroyed once.
        unsafe {
            self.rendered.drain(..).for_each(|s| self.device.destroy_semaphore(s, None));
            self.swapchain_calls.destroy_swapchain(self.swapchain, None);
        }
        self.swapchain = vk::SwapchainKHR::null();
        self.images.clear();
    }

    /// Takes in a picture, (row, column, channel), 1 or 3 channels of 8 bits.
    ///
    /// # Errors
    /// [`EngineError::Mismatch`]; a lost device.
    pub fn upload(&mut self, picture: &[u8]) -> Result<(), EngineError> {
        let pixels = self.size[0] * self.size[1];
        if picture.len() != pixels && picture.len() != 3 * pixels {
            let reason =
                format!("a picture has {} bytes, and {pixels} or three times as many were expected", picture.len());
            return Err(EngineError::Mismatch { reason });
        }
        let slot = &self.slots[self.next];
        // SAFETY: the fence is the device's; once it is signalled the device no longer reads the buffer, which is mapped
        // for as long as the slot lives and has four bytes for each pixel.
        let staging = unsafe {
            self.device
                .wait_for_fences(&[slot.done], true, PATIENCE_NS)
                .map_err(|e| self.error("vkWaitForFences", e))?;
            std::slice::from_raw_parts_mut(slot.mapped, 4 * pixels)
        };
        let blue_first = self.format == vk::Format::B8G8R8A8_UNORM;
        let grey = picture.len() == pixels;
        for (to, from) in staging.chunks_exact_mut(4).zip(picture.chunks_exact(if grey { 1 } else { 3 })) {
            let [r, g, b] = if grey { [from[0]; 3] } else { [from[0], from[1], from[2]] };
            to.copy_from_slice(&if blue_first { [b, g, r, 255] } else { [r, g, b, 255] });
        }
        Ok(())
    }

    /// Puts the picture taken in last in line. `id` rises.
    ///
    /// # Errors
    /// The window is gone, or has another size; a lost device.
    pub fn present(&mut self, id: u64) -> Result<(), EngineError> {
        let image = self.next_image()?;
        let slot = &self.slots[self.next];
        let rendered = [self.rendered[image as usize]];
        let transfer = vk::PipelineStageFlags::TRANSFER;
        let begin = vk::CommandBufferBeginInfo::default().flags(vk::CommandBufferUsageFlags::ONE_TIME_SUBMIT);
        let (wait, stages, commands) = ([slot.acquired], [transfer], [slot.commands]);
        let submit = vk::SubmitInfo::default()
            .wait_semaphores(&wait)
            .wait_dst_stage_mask(&stages)
            .command_buffers(&commands)
            .signal_semaphores(&rendered);
        let (chains, indices) = ([self.swapchain], [image]);
        // Numbers of 32 bits, which go round; the answer is matched modulo that.
        let times = [vk::PresentTimeGOOGLE::default().present_id(id as u32)];
        let mut times = vk::PresentTimesInfoGOOGLE::default().times(&times);
        let numbers = [present_number(id)];
        let mut numbers = vk::PresentIdKHR::default().present_ids(&numbers);
        let mut info =
            vk::PresentInfoKHR::default().wait_semaphores(&rendered).swapchains(&chains).image_indices(&indices);
        info = match self.teller.how() {
            How::DisplayTiming => info.push_next(&mut times),
            How::PresentWait => info.push_next(&mut numbers),
            How::FirstPixel | How::Acquire => info,
        };
        // SAFETY: the slot's fence was waited for in `upload`, so its commands and its semaphore are free; every handle is
        // of this device, and everything pointed to lives until the calls return.
        let presented = unsafe {
            self.device.reset_fences(&[slot.done]).map_err(|e| self.error("vkResetFences", e))?;
            self.device
                .begin_command_buffer(slot.commands, &begin)
                .map_err(|e| self.error("vkBeginCommandBuffer", e))?;
            let [height, width] = self.size.map(|n| n as u32);
            let extent = vk::Extent2D { width, height };
            record_picture(&self.device, slot.commands, slot.buffer, self.images[image as usize], extent);
            self.device.end_command_buffer(slot.commands).map_err(|e| self.error("vkEndCommandBuffer", e))?;
            self.device.queue_submit(self.queue, &[submit], slot.done).map_err(|e| self.error("vkQueueSubmit", e))?;
            self.swapchain_calls.queue_present(self.queue, &info)
        };
        self.next = (self.next + 1) % SLOTS;
        self.teller.presented(id);
        match self.answered("present", presented) {
            Ok(suboptimal) => {
                self.note(suboptimal);
                Ok(())
            }
            // Told again when the next image is acquired.
            Err(vk::Result::ERROR_OUT_OF_DATE_KHR | vk::Result::ERROR_SURFACE_LOST_KHR) => Ok(()),
            Err(e) => Err(self.error("vkQueuePresentKHR", e)),
        }
    }

    /// An image of the swapchain, and whether it could be better.
    pub(super) fn acquire(&mut self) -> Result<(u32, bool), vk::Result> {
        let start = Instant::now();
        // A test's answer comes without the call, which then did nothing.
        self.answered("acquire", Ok(false))?;
        let slot = &self.slots[self.next];
        // SAFETY: the semaphore is free, since the slot's fence was waited for.
        let image = unsafe {
            self.swapchain_calls.acquire_next_image(self.swapchain, PATIENCE_NS, slot.acquired, vk::Fence::null())
        };
        self.teller.acquired(start);
        image
    }

    /// What the driver answered, or what a test has it answer.
    #[cfg(not(test))]
    fn answered(&mut self, _: &'static str, is: Result<bool, vk::Result>) -> Result<bool, vk::Result> {
        is
    }

    #[cfg(test)]
    fn answered(&mut self, call: &'static str, is: Result<bool, vk::Result>) -> Result<bool, vk::Result> {
        match self.pretended.front().filter(|p| p.0 == call).copied() {
            None => is,
            Some((_, answer)) => {
                self.pretended.pop_front();
                if answer == vk::Result::SUBOPTIMAL_KHR { is.map(|_| true) } else { Err(answer) }
            }
        }
    }

    /// The next picture that is known to have lit up. Waits for it for some milliseconds at most, where that is the way
    /// to know, and once for every picture that was presented.
    pub fn lit(&mut self) -> Option<Lit> {
        self.teller.next(self.swapchain)
    }

    /// Waits until all that was handed over is with the screen.
    pub fn wait(&self) {
        // SAFETY: the device is valid. A lost one ends the wait as well.
        let _ = unsafe { self.device.device_wait_idle() };
    }
}

impl Drop for Screen {
    fn drop(&mut self) {
        // SAFETY: the device is idle, and everything is destroyed once, before what it was made from.
        unsafe {
            let _ = self.device.device_wait_idle();
            self.teller.destroy();
            self.drop_swapchain();
            for slot in self.slots.drain(..) {
                self.device.destroy_buffer(slot.buffer, None);
                self.device.free_memory(slot.memory, None);
                self.device.destroy_semaphore(slot.acquired, None);
                self.device.destroy_fence(slot.done, None);
            }
            self.device.destroy_command_pool(self.pool, None);
            self.device.destroy_device(None);
            self.surface_calls.destroy_surface(self.surface, None);
        }
    }
}
