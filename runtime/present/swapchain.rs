//! One swapchain for all that is shown: bytes as they are (UNORM), on the shared device.
//!
//! Its [`Policy`] says what it is for. A display shows every picture, in order and on time, at exactly its size; a window
//! shows the newest when there is room for it, so that a thread that has something better to do can serve it in passing.

#![allow(unsafe_code)]

mod make;

use super::copy::{fill, record_copy};
use super::slot::Slot;
use super::surface::{Surface, Target, WindowHandle};
use super::timing::{PresentTiming, TimingMethod, TimingSource, present_number};
use ash::{khr, vk};
use eyebox_compute::gpu::{EngineError, Gpu, Pictures, PixelOrder};
use std::sync::Arc;
use std::time::Instant;

/// What a swapchain is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Policy {
    /// Every picture of exactly so many rows and columns, first in first out, nothing scaled; a window of another size is
    /// refused.
    Exact([usize; 2]),
    /// The newest picture, in a window that may be resized; nobody waits.
    Newest,
}

/// How long the display may take for a picture before it counts as lost.
pub(super) const PATIENCE_NS: u64 = 2_000_000_000;

/// The swapchain of a window, or of a display that no desktop drives, and what feeds it.
pub struct Swapchain {
    pub(super) gpu: Gpu,
    policy: Policy,
    pool: vk::CommandPool,
    /// Signalled once all that was handed over before is over.
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
    /// The swapchain is not, or could be better: it is made again.
    pub(super) stale: bool,
    /// A picture lies in the next slot, whose fence is signalled.
    taken: bool,
    /// What waited for an image could not be made anew: nothing is shown any more.
    broken: bool,
    /// It was made again for being less than best, and is no better.
    pub(super) tolerated: bool,
    /// What a test has the driver answer, call by call.
    #[cfg(test)]
    pub(super) pretended: std::collections::VecDeque<(&'static str, vk::Result)>,
    // After all that was made of it.
    pub(super) surface: Surface,
}

impl Swapchain {
    /// On a window, from this device, or from another one of its instance where this one cannot show there: see
    /// [`gpu`](Self::gpu).
    ///
    /// # Errors
    /// [`EngineError::NoDevice`]; [`EngineError::Unsuitable`] where no device can show bytes as they are, where the device
    /// was not opened to present, and where the window has another size; [`EngineError::Vulkan`].
    ///
    /// # Safety
    /// The handles are those of a window that outlives the swapchain.
    pub unsafe fn open(gpu: &Gpu, window: WindowHandle, policy: Policy) -> Result<Self, EngineError> {
        // SAFETY: the caller vouches for the handles.
        unsafe { Self::on(gpu, Target::Window(window), policy) }
    }

    /// # Safety
    /// The handles of a window are those of one that outlives the swapchain.
    pub(super) unsafe fn on(gpu: &Gpu, target: Target, policy: Policy) -> Result<Self, EngineError> {
        // SAFETY: the caller vouches for the handles.
        let surface = unsafe { Surface::new(&gpu.device.instance, target) }?;
        let gpu = gpu.that_shows(|physical, family| surface.shows(physical, family))?;
        let (device, instance) = (Arc::clone(&gpu.device), Arc::clone(&gpu.device.instance));
        let display = surface.display().map_or(vk::DisplayKHR::null(), |d| d.1);
        let method = match policy {
            Policy::Exact(_) => TimingMethod::best(|extension| device.has(extension), surface.display().is_some()),
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
            surface,
            gpu,
        };
        swapchain.make_slots(if policy == Policy::Newest { 1 } else { 2 })?;
        if let Policy::Exact(size) = policy {
            swapchain.make(size)?;
        }
        Ok(swapchain)
    }

    /// The device that it shows from.
    pub fn gpu(&self) -> &Gpu {
        &self.gpu
    }

    /// The device, and how it is known when pictures light up.
    pub fn describe(&self) -> String {
        let name = &self.gpu.device.report.name;
        match self.policy {
            Policy::Exact(_) => format!("{name} ({:?}, first in first out, timed by {})", self.format, self.timed_by()),
            Policy::Newest => name.clone(),
        }
    }

    /// How it is known when pictures light up.
    pub fn timed_by(&self) -> &'static str {
        self.times.method().name()
    }

    fn make_slots(&mut self, count: usize) -> Result<(), EngineError> {
        let device = &self.gpu.device;
        let pool = vk::CommandPoolCreateInfo::default()
            .queue_family_index(device.present().family)
            .flags(vk::CommandPoolCreateFlags::RESET_COMMAND_BUFFER);
        // SAFETY: the device is valid; the pool is kept at once and destroyed with this.
        let pool = unsafe { device.raw.create_command_pool(&pool, None) };
        self.pool = pool.map_err(|e| self.error("vkCreateCommandPool", e))?;
        // SAFETY: as above.
        let idle = unsafe { device.raw.create_fence(&vk::FenceCreateInfo::default(), None) };
        self.idle = idle.map_err(|e| self.error("vkCreateFence", e))?;
        Slot::make(&mut self.slots, count, &self.gpu.device, self.pool)
    }

    /// # Safety
    /// Nothing of it is under way.
    pub(super) unsafe fn drop_swapchain(&mut self) {
        // SAFETY: the caller says so; each is destroyed once.
        unsafe {
            self.rendered.drain(..).for_each(|s| self.gpu.device.raw.destroy_semaphore(s, None));
            self.calls.destroy_swapchain(self.raw, None);
        }
        self.raw = vk::SwapchainKHR::null();
        self.images.clear();
    }

    /// Takes in a picture of the exact size, (row, column, channel), 1 or 3 channels of 8 bits.
    ///
    /// # Errors
    /// [`EngineError::Mismatch`]; a lost device.
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

    /// In which order [`take`](Self::take) wants the colours of a pixel.
    pub(crate) fn pixel_order(&self) -> PixelOrder {
        if self.format == vk::Format::B8G8R8A8_UNORM { PixelOrder::Bgra } else { PixelOrder::Rgba }
    }

    /// Takes in a picture of the exact size that an encoder has on the device already: nothing of it goes by the host. The
    /// pictures are in use until this one was read.
    ///
    /// # Errors
    /// [`EngineError::Mismatch`] for pictures of another size, order or device; a lost device.
    pub fn take(&mut self, pictures: &Pictures, index: usize) -> Result<(), EngineError> {
        let wanted = ([self.extent.height as usize, self.extent.width as usize], self.pixel_order());
        let is = (pictures.size(), pictures.order());
        if is != wanted || index >= pictures.count() || !pictures.block.is_on(&self.gpu.device) {
            let reason = format!(
                "picture {index} of {} of {is:?} on a device, where the swapchain's own device shows {wanted:?}",
                pictures.count()
            );
            return Err(EngineError::Mismatch { reason });
        }
        self.wait_for_slot()?;
        self.slots[self.next].hold(pictures, index);
        self.taken = true;
        Ok(())
    }

    /// The next slot is free after this, and pictures that were read are let go.
    fn wait_for_slot(&mut self) -> Result<(), EngineError> {
        self.check_whole()?;
        let (device, done) = (&self.gpu.device, self.slots[self.next].done);
        // SAFETY: the fence is the device's.
        let waited = unsafe { device.raw.wait_for_fences(&[done], true, PATIENCE_NS) };
        self.slots.iter_mut().for_each(|slot| slot.release(device));
        waited.map_err(|e| self.error("vkWaitForFences", e))
    }

    fn check_whole(&self) -> Result<(), EngineError> {
        let reason = || "a picture failed on its way, and what it waited for could not be made anew".into();
        let lost = || EngineError::ScreenLost { device: self.gpu.device.report.name.clone(), reason: reason() };
        if self.broken { Err(lost()) } else { Ok(()) }
    }

    /// Puts the picture taken in last in line. `id` rises.
    ///
    /// # Errors
    /// The window is gone, or has another size; a lost device; [`EngineError::Mismatch`] where no picture was taken in since
    /// the last one was put in line.
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
            // Told again when the next image is acquired.
            Err(vk::Result::ERROR_OUT_OF_DATE_KHR | vk::Result::ERROR_SURFACE_LOST_KHR) => Ok(()),
            Err(e) => Err(self.error("vkQueuePresentKHR", e)),
        }
    }

    /// Shows a picture of `size` rows and columns, red, green, blue of 8 bits, if that can be done without waiting: whether
    /// it was. What the window has more than the picture is black; what the picture has more is not shown.
    ///
    /// # Errors
    /// The window is gone; a lost device; [`EngineError::Mismatch`].
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

    /// Writes a picture into the next slot, whose fence is signalled.
    fn fill(&mut self, picture: &[u8], size: [usize; 2], channels: usize) {
        let blue_first = self.format == vk::Format::B8G8R8A8_UNORM;
        if let Some(pixels) = &mut self.slots[self.next].pixels {
            fill(pixels.bytes_mut(), self.extent, blue_first, picture, size, channels);
        }
    }

    /// An image of the swapchain, and whether it could be better.
    pub(super) fn acquire(&mut self, patience_ns: u64) -> Result<(u32, bool), vk::Result> {
        let start = Instant::now();
        // A test's answer comes without the call, which then did nothing.
        self.answered("acquire", Ok(false))?;
        if self.raw == vk::SwapchainKHR::null() {
            // It could not be made again the last time.
            return Err(vk::Result::ERROR_OUT_OF_DATE_KHR);
        }
        let free = self.slots[self.next].acquired;
        // SAFETY: the semaphore is free, since the slot's fence is signalled.
        let image = unsafe { self.calls.acquire_next_image(self.raw, patience_ns, free, vk::Fence::null()) };
        self.times.acquired(start);
        image
    }

    /// Copies the next slot's picture into an image that was acquired, and presents it: what the driver answers to that. Where
    /// that fails, the image goes with its swapchain, and the slot is as if it had never been.
    fn submit(&mut self, image: u32, id: u64) -> Result<Result<bool, vk::Result>, EngineError> {
        self.taken = false;
        let submitted = self.submit_copy(image, id);
        if submitted.is_err() {
            self.wait()?;
            // SAFETY: the queue is idle; the image that was acquired was given to nobody.
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
        // Numbers of 32 bits, which go round; the answer is matched modulo that.
        let times = [vk::PresentTimeGOOGLE::default().present_id(id as u32)];
        let mut times = vk::PresentTimesInfoGOOGLE::default().times(&times);
        let numbers = [present_number(id)];
        let mut numbers = vk::PresentIdKHR::default().present_ids(&numbers);
        let mut info =
            vk::PresentInfoKHR::default().wait_semaphores(&rendered).swapchains(&chains).image_indices(&indices);
        info = match self.times.method() {
            TimingMethod::DisplayTiming => info.push_next(&mut times),
            TimingMethod::PresentWait => info.push_next(&mut numbers),
            TimingMethod::FirstPixel | TimingMethod::Acquire => info,
        };
        let raw = &self.gpu.device.raw;
        // SAFETY: the slot's fence was signalled, so its commands and its semaphore are free; every handle is of this
        // device, and everything pointed to lives until the calls return. The wait for the acquired image is at the stage
        // of the first barrier.
        let presented = unsafe {
            raw.begin_command_buffer(slot.commands, &begin).map_err(|e| self.error("vkBeginCommandBuffer", e))?;
            record_copy(raw, slot.commands, (from, offset), self.images[image as usize], self.extent);
            raw.end_command_buffer(slot.commands).map_err(|e| self.error("vkEndCommandBuffer", e))?;
            let queue = self.gpu.device.present().lock();
            raw.reset_fences(&[slot.done]).map_err(|e| self.error("vkResetFences", e))?;
            let submitted = pretended.and_then(|_| raw.queue_submit(*queue, &[submit], slot.done));
            submitted.map_err(|e| self.error("vkQueueSubmit", e))?;
            self.calls.queue_present(*queue, &info)
        };
        self.next = (self.next + 1) % self.slots.len();
        Ok(presented)
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

    /// When the next picture lit up of which that is known. Waits for it for some milliseconds at most, where that is the
    /// way to know, and once for every picture that was presented.
    pub fn timing(&mut self) -> Option<PresentTiming> {
        self.times.next(self.raw)
    }

    /// Waits until everything that was handed over is with the display, but no longer than a device may take.
    ///
    /// # Errors
    /// [`EngineError::DeviceLost`]: it did not answer in time, or was lost before. Nothing of it is under way on a lost
    /// device; what one that does not answer may still use stays until the process ends.
    pub fn wait(&mut self) -> Result<(), EngineError> {
        let (call, during) = ("vkWaitForFences", "showing pictures");
        let pretended = self.answered("idle", Ok(true));
        let device = &self.gpu.device;
        if device.is_stuck() {
            return Err(device.give_up(call, during));
        }
        // vkQueueWaitIdle is a fence like this one, without a limit.
        // SAFETY: the fence is the device's and no submission has it; the queue is locked.
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
            // A device that may still be at work on it: all of it stays.
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
