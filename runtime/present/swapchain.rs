//! Shows pictures with unchanged bytes (UNORM) through a swapchain on the shared device.
//!
//! The [`Policy`] of a swapchain selects its use. A display shows every picture, in order and on time, at exactly its
//! size. A window shows the newest picture if there is room for it. Therefore a thread with other work can serve a
//! window without waiting.

#![allow(unsafe_code)]

mod make;

use super::copy::{fill, record_copy};
use super::slot::Slot;
use super::surface::{Surface, Target, WindowHandle};
use super::timing::{PresentTiming, TimingMethod, TimingSource, present_number};
use ash::{khr, vk};
#[cfg(all(test, target_os = "linux"))]
use eyebox_compute::gpu::presentation::TimingCalls;
use eyebox_compute::gpu::presentation::{PresentId2, PresentTimingsInfo};
use eyebox_compute::gpu::{EngineError, Gpu, Pictures, PixelOrder};
use std::sync::Arc;
use std::time::Instant;

/// The use of a swapchain.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Policy {
    /// Every picture of exactly this number of rows and columns, first in first out and not scaled. A window of another
    /// size is rejected.
    Exact([usize; 2]),
    /// The newest picture, in a window that may be resized. No call waits.
    Newest,
}

/// Time limit for the display to accept a picture. After it the display counts as lost.
pub(super) const PATIENCE_NS: u64 = 2_000_000_000;

/// The swapchain of a window, or of a display that no desktop drives, with its slots for pictures.
pub struct Swapchain {
    pub(super) gpu: Gpu,
    policy: Policy,
    pool: vk::CommandPool,
    /// Signaled when all earlier submissions are complete.
    idle: vk::Fence,
    slots: Vec<Slot>,
    next: usize,
    calls: khr::swapchain::Device,
    raw: vk::SwapchainKHR,
    images: Vec<vk::Image>,
    rendered: Vec<vk::Semaphore>,
    pub(super) times: TimingSource,
    format: vk::Format,
    pub(super) extent: vk::Extent2D,
    /// The swapchain is missing or suboptimal, so it must be made again.
    pub(super) stale: bool,
    /// A picture is in the next slot, whose fence is signaled.
    taken: bool,
    /// The semaphore or fence of an image could not be replaced, so nothing more is shown.
    broken: bool,
    /// The swapchain was made again because it was suboptimal, and still is.
    pub(super) tolerated: bool,
    /// Answers of the driver that a test sets, call by call.
    #[cfg(test)]
    pub(super) pretended: std::collections::VecDeque<(&'static str, vk::Result)>,
    /// True if the last picture was copied before it was presented.
    #[cfg(test)]
    pub(super) copied_first: std::cell::Cell<Option<bool>>,
    // The surface is dropped after all that was made of it.
    pub(super) surface: Surface,
}

impl Swapchain {
    /// Opens a swapchain on a window, from this device. If this device cannot show there, it uses another one of its
    /// instance (see [`gpu`](Self::gpu)).
    ///
    /// # Errors
    /// [`EngineError::NoDevice`] or [`EngineError::Vulkan`]. [`EngineError::Unsuitable`] if no device can show
    /// unchanged bytes, if the device was not opened to present, or if the window has another size.
    ///
    /// # Safety
    /// The handles belong to a window that outlives the swapchain.
    pub unsafe fn open(gpu: &Gpu, window: WindowHandle, policy: Policy) -> Result<Self, EngineError> {
        // SAFETY: the caller vouches for the handles.
        unsafe { Self::on(gpu, Target::Window(window), policy) }
    }

    /// # Safety
    /// The handles of a window belong to one that outlives the swapchain.
    pub(super) unsafe fn on(gpu: &Gpu, target: Target, policy: Policy) -> Result<Self, EngineError> {
        // SAFETY: the caller vouches for the handles.
        let surface = unsafe { Surface::new(&gpu.device.instance, target) }?;
        let gpu = gpu.that_shows(|physical, family| surface.shows(physical, family))?;
        let (device, instance) = (Arc::clone(&gpu.device), Arc::clone(&gpu.device.instance));
        let display = surface.display().map_or(vk::DisplayKHR::null(), |d| d.1);
        let method = match policy {
            Policy::Exact(_) => TimingMethod::best(
                |extension| device.has(extension),
                surface.times(&device),
                surface.display().is_some(),
            ),
            Policy::Newest => TimingMethod::Acquire,
        };
        let mut swapchain = Self {
            policy,
            pool: vk::CommandPool::null(),
            idle: vk::Fence::null(),
            slots: Vec::new(),
            next: 0,
            calls: khr::swapchain::Device::new(&instance.raw, &device.raw),
            raw: vk::SwapchainKHR::null(),
            images: Vec::new(),
            rendered: Vec::new(),
            times: TimingSource::new(&instance.raw, &device.raw, method, display),
            format: vk::Format::UNDEFINED,
            extent: vk::Extent2D::default(),
            stale: true,
            taken: false,
            broken: false,
            tolerated: false,
            #[cfg(test)]
            pretended: Default::default(),
            #[cfg(test)]
            copied_first: Default::default(),
            surface,
            gpu,
        };
        swapchain.make_slots(if policy == Policy::Newest { 1 } else { 2 })?;
        if let Policy::Exact(size) = policy {
            swapchain.make(size)?;
        }
        Ok(swapchain)
    }

    /// The device that shows the pictures.
    pub fn gpu(&self) -> &Gpu {
        &self.gpu
    }

    /// The device, and the source of presentation times.
    pub fn describe(&self) -> String {
        let name = &self.gpu.device.report.name;
        match self.policy {
            Policy::Exact(_) => format!("{name} ({:?}, first in first out, timed by {})", self.format, self.timed_by()),
            Policy::Newest => name.clone(),
        }
    }

    /// The source of presentation times.
    pub fn timed_by(&self) -> &'static str {
        self.times.method().name()
    }

    fn make_slots(&mut self, count: usize) -> Result<(), EngineError> {
        let device = &self.gpu.device;
        let pool = vk::CommandPoolCreateInfo::default()
            .queue_family_index(device.present().family)
            .flags(vk::CommandPoolCreateFlags::RESET_COMMAND_BUFFER);
        // SAFETY: the device is valid, and the pool is kept at once and destroyed with this.
        let pool = unsafe { device.raw.create_command_pool(&pool, None) };
        self.pool = pool.map_err(|e| self.error("vkCreateCommandPool", e))?;
        // SAFETY: as above.
        let idle = unsafe { device.raw.create_fence(&vk::FenceCreateInfo::default(), None) };
        self.idle = idle.map_err(|e| self.error("vkCreateFence", e))?;
        Slot::make(&mut self.slots, count, &self.gpu.device, self.pool)
    }

    /// # Safety
    /// The swapchain has no work under way.
    pub(super) unsafe fn drop_swapchain(&mut self) {
        // SAFETY: the caller says so; each is destroyed once.
        unsafe {
            self.rendered.drain(..).for_each(|s| self.gpu.device.raw.destroy_semaphore(s, None));
            self.calls.destroy_swapchain(self.raw, None);
        }
        self.raw = vk::SwapchainKHR::null();
        self.images.clear();
    }

    /// Takes a picture of the exact size, (row, column, channel), with 1 or 3 channels of 8 bits.
    ///
    /// # Errors
    /// [`EngineError::Mismatch`], or the errors of a lost device.
    pub fn upload(&mut self, picture: &[u8]) -> Result<(), EngineError> {
        let size = [self.extent.height as usize, self.extent.width as usize];
        let pixels = size[0] * size[1];
        if picture.len() != pixels && picture.len() != 3 * pixels {
            let reason =
                format!("a picture has {} bytes, and {pixels} or three times as many were expected", picture.len());
            return Err(EngineError::Mismatch { reason });
        }
        self.wait_for_slot()?;
        self.fill(picture, size, picture.len() / pixels);
        self.taken = true;
        Ok(())
    }

    /// The order of the colors of a pixel that [`take`](Self::take) needs.
    pub(crate) fn pixel_order(&self) -> PixelOrder {
        if self.format == vk::Format::B8G8R8A8_UNORM { PixelOrder::Bgra } else { PixelOrder::Rgba }
    }

    /// Takes a picture of the exact size that an encoder already has on the device, without a copy through the host.
    /// The pictures are in use until this one was read.
    ///
    /// # Errors
    /// [`EngineError::Mismatch`] for pictures of another size, order or device, or the errors of a lost device.
    pub fn take(&mut self, pictures: &Pictures, index: usize) -> Result<(), EngineError> {
        let wanted = ([self.extent.height as usize, self.extent.width as usize], self.pixel_order());
        let is = (pictures.size(), pictures.order());
        if is != wanted || index >= pictures.count() || !pictures.block.is_on(&self.gpu.device) {
            let reason = format!(
                "picture {index} of {} of {is:?} on a device, but the swapchain's own device shows {wanted:?}",
                pictures.count()
            );
            return Err(EngineError::Mismatch { reason });
        }
        self.wait_for_slot()?;
        self.slots[self.next].hold(pictures, index);
        self.taken = true;
        Ok(())
    }

    /// Waits until the next slot is free, and releases pictures that were read.
    fn wait_for_slot(&mut self) -> Result<(), EngineError> {
        self.check_whole()?;
        let (device, done) = (&self.gpu.device, self.slots[self.next].done);
        // SAFETY: the fence is the device's.
        let waited = unsafe { device.raw.wait_for_fences(&[done], true, PATIENCE_NS) };
        self.slots.iter_mut().for_each(|slot| slot.release(device));
        waited.map_err(|e| self.error("vkWaitForFences", e))
    }

    fn check_whole(&self) -> Result<(), EngineError> {
        let reason = || "a picture failed in flight, and its semaphore or fence could not be made again".into();
        let lost = || EngineError::ScreenLost { device: self.gpu.device.report.name.clone(), reason: reason() };
        if self.broken { Err(lost()) } else { Ok(()) }
    }

    /// Queues the picture that was taken last. `id` rises from call to call.
    ///
    /// # Errors
    /// The errors of a window that is gone or has another size, or of a lost device. [`EngineError::Mismatch`] if no
    /// picture was taken since the last call.
    pub fn present(&mut self, id: u64) -> Result<(), EngineError> {
        if !self.taken {
            return Err(EngineError::Mismatch { reason: "no picture was taken in to be presented".into() });
        }
        let image = self.next_image()?;
        let presented = self.submit(image, id)?;
        self.times.presented(id);
        match self.answered("present", presented) {
            Ok(suboptimal) => {
                self.stale |= suboptimal;
                Ok(())
            }
            // The next acquire reports the same error.
            Err(vk::Result::ERROR_OUT_OF_DATE_KHR | vk::Result::ERROR_SURFACE_LOST_KHR) => Ok(()),
            Err(e) => Err(self.error("vkQueuePresentKHR", e)),
        }
    }

    /// Shows a picture of `size` rows and columns, as red, green, blue of 8 bits, if no wait is needed. The result is
    /// true if it was shown. Pixels of the window outside the picture are black. Pixels of the picture outside the
    /// window are not shown.
    ///
    /// # Errors
    /// The errors of a window that is gone or of a lost device, or [`EngineError::Mismatch`].
    pub fn show_newest(&mut self, rgb: &[u8], size: [usize; 2]) -> Result<bool, EngineError> {
        self.check_whole()?;
        if rgb.len() != 3 * size[0] * size[1] {
            let reason = format!("a picture of {}x{} has {} bytes", size[0], size[1], rgb.len());
            return Err(EngineError::Mismatch { reason });
        }
        let resized = (self.extent.height as usize, self.extent.width as usize) != (size[0], size[1]);
        if (self.stale || resized) && !self.make(size)? {
            return Ok(false);
        }
        // SAFETY: the fence is the device's.
        let free = unsafe { self.gpu.device.raw.get_fence_status(self.slots[self.next].done) };
        if !free.map_err(|e| self.error("vkGetFenceStatus", e))? {
            return Ok(false);
        }
        let image = match self.acquire(0) {
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
        self.fill(rgb, size, 3);
        match self.submit(image, 0)? {
            Ok(suboptimal) => self.stale |= suboptimal,
            Err(vk::Result::ERROR_OUT_OF_DATE_KHR) => self.stale = true,
            Err(e) => return Err(self.error("vkQueuePresentKHR", e)),
        }
        Ok(true)
    }

    /// Writes a picture into the next slot, whose fence is signaled.
    fn fill(&mut self, picture: &[u8], size: [usize; 2], channels: usize) {
        let blue_first = self.format == vk::Format::B8G8R8A8_UNORM;
        if let Some(pixels) = &mut self.slots[self.next].pixels {
            fill(pixels.bytes_mut(), self.extent, blue_first, picture, size, channels);
        }
    }

    /// Acquires an image of the swapchain. The flag is true if the swapchain is suboptimal.
    pub(super) fn acquire(&mut self, patience_ns: u64) -> Result<(u32, bool), vk::Result> {
        let start = Instant::now();
        // A test's answer replaces the call, which then had no effect.
        self.answered("acquire", Ok(false))?;
        if self.raw == vk::SwapchainKHR::null() {
            // The last attempt to make it again failed.
            return Err(vk::Result::ERROR_OUT_OF_DATE_KHR);
        }
        let free = self.slots[self.next].acquired;
        // SAFETY: the semaphore is free, since the slot's fence is signalled.
        let image = unsafe { self.calls.acquire_next_image(self.raw, patience_ns, free, vk::Fence::null()) };
        self.times.acquired(start);
        image
    }

    /// Copies the next slot's picture into an acquired image and presents it. The inner result is the driver's answer.
    /// After a failure the image is dropped with its swapchain, and the slot is as if it had never been used.
    fn submit(&mut self, image: u32, id: u64) -> Result<Result<bool, vk::Result>, EngineError> {
        self.taken = false;
        let submitted = self.submit_copy(image, id);
        if submitted.is_err() {
            self.wait()?;
            // SAFETY: the queue is idle, and the image that was acquired was given to nobody.
            unsafe { self.drop_swapchain() };
            self.stale = true;
            self.broken |= !self.slots[self.next].renew(&self.gpu.device);
        }
        submitted
    }

    fn submit_copy(&mut self, image: u32, id: u64) -> Result<Result<bool, vk::Result>, EngineError> {
        let pretended = self.answered("submit", Ok(true));
        let slot = &self.slots[self.next];
        let (Some((from, offset, ready)), Some(rendered)) = (slot.source(), self.rendered.get(image as usize)) else {
            return Err(EngineError::Mismatch { reason: "there is no picture, or no image to copy it into".into() });
        };
        let rendered = [*rendered];
        let begin = vk::CommandBufferBeginInfo::default().flags(vk::CommandBufferUsageFlags::ONE_TIME_SUBMIT);
        let (drawn, value) = ready.map_or((vk::Semaphore::null(), 0), |(timeline, value)| (timeline.raw, *value));
        let (wait, values, waits) = ([slot.acquired, drawn], [0, value], 1 + usize::from(ready.is_some()));
        let (stages, commands) = ([vk::PipelineStageFlags::TRANSFER; 2], [slot.commands]);
        let mut timeline = vk::TimelineSemaphoreSubmitInfo::default()
            .wait_semaphore_values(&values[..waits])
            .signal_semaphore_values(&[0]);
        let submit = vk::SubmitInfo::default()
            .wait_semaphores(&wait[..waits])
            .wait_dst_stage_mask(&stages[..waits])
            .command_buffers(&commands)
            .signal_semaphores(&rendered)
            .push_next(&mut timeline);
        let (chains, indices) = ([self.raw], [image]);
        // The numbers have 32 bits and wrap around. The answer is matched modulo that.
        let times = [vk::PresentTimeGOOGLE::default().present_id(id as u32)];
        let mut times = vk::PresentTimesInfoGOOGLE::default().times(&times);
        let numbers = [present_number(id)];
        let mut id2 = PresentId2 { swapchain_count: 1, present_ids: numbers.as_ptr(), ..PresentId2::default() };
        let mut numbers = vk::PresentIdKHR::default().present_ids(&numbers);
        let request = self.times.request();
        let infos = request.as_ref().map_or(std::ptr::null(), std::ptr::from_ref);
        let mut requests = PresentTimingsInfo { swapchain_count: 1, infos, ..PresentTimingsInfo::default() };
        let mut info =
            vk::PresentInfoKHR::default().wait_semaphores(&rendered).swapchains(&chains).image_indices(&indices);
        info = match self.times.method() {
            TimingMethod::DisplayTiming => info.push_next(&mut times),
            TimingMethod::PresentWait => info.push_next(&mut numbers),
            TimingMethod::PresentTiming(_) if request.is_some() => info.push_next(&mut id2).push_next(&mut requests),
            TimingMethod::PresentTiming(_) | TimingMethod::PresentWait2 => info.push_next(&mut id2),
            TimingMethod::FirstPixel | TimingMethod::Acquire => info,
        };
        let raw = &self.gpu.device.raw;
        // SAFETY: the slot's fence was signalled, so its commands and its semaphore are free. Every handle is of this
        // device, and everything pointed to lives until the calls return. The wait for the acquired image is at the
        // stage of the first barrier.
        let presented = unsafe {
            raw.begin_command_buffer(slot.commands, &begin).map_err(|e| self.error("vkBeginCommandBuffer", e))?;
            record_copy(raw, slot.commands, (from, offset), self.images[image as usize], self.extent);
            raw.end_command_buffer(slot.commands).map_err(|e| self.error("vkEndCommandBuffer", e))?;
            let queue = self.gpu.device.present();
            raw.reset_fences(&[slot.done]).map_err(|e| self.error("vkResetFences", e))?;
            let submitted = pretended.and_then(|_| raw.queue_submit(*queue.lock(), &[submit], slot.done));
            submitted.map_err(|e| self.error("vkQueueSubmit", e))?;
            self.wait_for_copy(slot)?;
            #[cfg(test)]
            self.copied_first.set(raw.get_fence_status(slot.done).ok());
            self.calls.queue_present(*queue.lock(), &info)
        };
        self.next = (self.next + 1) % self.slots.len();
        Ok(presented)
    }

    /// Waits for the copy of a slot if kernels run on the same queue. Some drivers wait for it in `vkQueuePresentKHR`,
    /// and kernels could then not be submitted until it is over. A window of the newest picture never waits.
    fn wait_for_copy(&self, slot: &Slot) -> Result<(), EngineError> {
        let device = &self.gpu.device;
        if !device.shares_queue() || self.policy == Policy::Newest {
            return Ok(());
        }
        // SAFETY: The fence is the device's.
        match unsafe { device.raw.wait_for_fences(&[slot.done], true, device.patience_ns()) } {
            Err(vk::Result::TIMEOUT) => Err(device.give_up("vkWaitForFences", "showing pictures")),
            other => other.map_err(|e| self.error("vkWaitForFences", e)),
        }
    }

    /// The driver's answer, or a test's answer instead.
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

    /// Takes times from other functions than the driver's.
    #[cfg(all(test, target_os = "linux"))]
    pub(super) fn pretend_present_timing(&mut self, calls: TimingCalls, stage: u32) {
        self.times.pretend_present_timing(calls, stage, self.raw);
    }

    /// The next picture with a known time of light. If the source of times requires it, this waits for some
    /// milliseconds at most, once for every presented picture.
    pub fn timing(&mut self) -> Option<PresentTiming> {
        self.times.next(self.raw)
    }

    /// Waits until all submissions are complete, but no longer than the time limit of a device.
    ///
    /// # Errors
    /// [`EngineError::DeviceLost`] if the device did not answer in time, or was already lost. A lost device has no work
    /// in flight. If a device does not answer, the objects that it may still use stay until the process ends.
    pub fn wait(&mut self) -> Result<(), EngineError> {
        let (call, during) = ("vkWaitForFences", "showing pictures");
        let pretended = self.answered("idle", Ok(true));
        let device = &self.gpu.device;
        if device.is_stuck() {
            return Err(device.give_up(call, during));
        }
        // vkQueueWaitIdle is a fence like this one, without a limit.
        // SAFETY: the fence is the device's and no submission has it, and the queue is locked.
        let waited = unsafe {
            device.raw.reset_fences(&[self.idle]).map_err(|e| device.error("vkResetFences", during, e))?;
            let submitted = device.raw.queue_submit(*device.present().lock(), &[], self.idle);
            submitted.map_err(|e| device.error("vkQueueSubmit", during, e))?;
            let waited = device.raw.wait_for_fences(&[self.idle], true, device.patience_ns());
            waited.and_then(|()| pretended.map(drop))
        };
        match waited {
            Err(vk::Result::TIMEOUT) => Err(device.give_up(call, during)),
            other => other.map_err(|e| device.error(call, during, e)),
        }
    }
}

impl Drop for Swapchain {
    fn drop(&mut self) {
        let _ = self.wait();
        if self.gpu.device.is_stuck() {
            // The device may still use the objects, so all of them stay.
            self.surface.leave();
            return;
        }
        // SAFETY: nothing of it is under way, and everything is destroyed once, before what it was made from.
        unsafe {
            self.times.destroy();
            self.drop_swapchain();
            self.slots.iter().for_each(|slot| slot.destroy(&self.gpu.device.raw));
            self.gpu.device.raw.destroy_command_pool(self.pool, None);
            self.gpu.device.raw.destroy_fence(self.idle, None);
        }
    }
}
