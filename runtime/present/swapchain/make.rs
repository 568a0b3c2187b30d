//! Makes a swapchain and replaces it, completely or not at all.

#![allow(unsafe_code)]

use super::{Policy, Swapchain};
use ash::{ext, vk};
use eyebox_compute::gpu::EngineError;

impl Swapchain {
    /// The size of pictures on the surface. It is `wanted` if the surface leaves the choice. It has no pixels while a
    /// window is minimized.
    pub(crate) fn extent_now(
        &self,
        wanted: [usize; 2],
    ) -> Result<(vk::Extent2D, vk::SurfaceCapabilitiesKHR), EngineError> {
        let can =
            self.surface.capabilities(self.gpu.device.physical).map_err(|e| self.error("surface capabilities", e))?;
        let ([height, width], is) = (wanted.map(|n| n as u32), can.current_extent);
        let extent = match (self.policy, is.width == u32::MAX) {
            (Policy::Exact(_), false) if (is.height, is.width) != (height, width) => {
                return Err(self.unsuitable(format!(
                    "the window is {}x{} pixels, and a video frame has {height}x{width}: pictures are not scaled, so \
                     make them equal",
                    is.height, is.width
                )));
            }
            (Policy::Newest, true) => {
                let (least, most) = (can.min_image_extent, can.max_image_extent);
                let within = |n: u32, least: u32, most: u32| n.min(most).max(least);
                vk::Extent2D {
                    width: within(width, least.width, most.width),
                    height: within(height, least.height, most.height),
                }
            }
            (Policy::Exact(_), _) => vk::Extent2D { width, height },
            (Policy::Newest, false) => is,
        };
        Ok((extent, can))
    }

    fn unsuitable(&self, reason: impl Into<String>) -> EngineError {
        EngineError::Unsuitable { device: self.gpu.device.report.name.clone(), reason: reason.into() }
    }

    /// Makes the swapchain, or makes it again. The result is false if the window has no pixels now.
    pub(crate) fn make(&mut self, wanted: [usize; 2]) -> Result<bool, EngineError> {
        let (extent, can) = self.extent_now(wanted)?;
        if extent.width == 0 || extent.height == 0 {
            return Ok(false);
        }
        let physical = self.gpu.device.physical;
        let format =
            self.surface.plain_format(physical).map_err(|e| self.error("surface formats", e))?.ok_or_else(|| {
                self.unsuitable("the window offers no UNORM format of 8 bits, and others change the levels")
            })?;
        if !can.supported_usage_flags.contains(vk::ImageUsageFlags::TRANSFER_DST) {
            return Err(self.unsuitable("pictures cannot be copied into its window"));
        }
        let opaque = [vk::CompositeAlphaFlagsKHR::OPAQUE, vk::CompositeAlphaFlagsKHR::INHERIT];
        let alpha = opaque.into_iter().find(|a| can.supported_composite_alpha.contains(*a));
        let alpha = alpha.ok_or_else(|| self.unsuitable("its window cannot be opaque"))?;
        let most = if can.max_image_count == 0 { u32::MAX } else { can.max_image_count };
        let mut exclusive =
            vk::SurfaceFullScreenExclusiveInfoEXT::default().full_screen_exclusive(vk::FullScreenExclusiveEXT::ALLOWED);
        let mut info = vk::SwapchainCreateInfoKHR::default()
            .flags(self.times.method().flags())
            .surface(self.surface.raw)
            .min_image_count((can.min_image_count + 1).min(most))
            .image_format(format.format)
            .image_color_space(format.color_space)
            .image_extent(extent)
            .image_array_layers(1)
            .image_usage(vk::ImageUsageFlags::TRANSFER_DST)
            .image_sharing_mode(vk::SharingMode::EXCLUSIVE)
            .pre_transform(can.current_transform)
            .composite_alpha(alpha)
            .present_mode(self.present_mode()?)
            .clipped(true)
            .old_swapchain(self.raw);
        // On Windows, the driver may then show pictures without the compositor, which adds a video frame of latency.
        if matches!(self.policy, Policy::Exact(_)) && self.gpu.device.has(ext::full_screen_exclusive::NAME) {
            info = info.push_next(&mut exclusive);
        }
        (self.format, self.extent) = (format.format, extent);
        self.wait()?;
        self.times.renewed();
        if let Err(error) = self.make_images(&info, 4 * u64::from(extent.width) * u64::from(extent.height)) {
            self.stale = true;
            // SAFETY: nothing of it is under way, because no image of it was ever acquired.
            unsafe { self.drop_swapchain() };
            return Err(error);
        }
        self.stale = false;
        Ok(true)
    }

    /// Replaces the swapchain, its images, and the room for pictures of this number of bytes. The work of the old and
    /// the new one is complete.
    fn make_images(&mut self, info: &vk::SwapchainCreateInfoKHR<'_>, bytes: u64) -> Result<(), EngineError> {
        let pretended = self.answered("create", Ok(true));
        // SAFETY: nothing of the old swapchain is under way when it is destroyed, and all handles are valid.
        unsafe {
            let made = pretended.and_then(|_| self.calls.create_swapchain(info, None));
            self.drop_swapchain();
            self.raw = made.map_err(|e| self.error("vkCreateSwapchainKHR", e))?;
            self.times.begin(self.raw);
            let images = self.calls.get_swapchain_images(self.raw);
            self.images = images.map_err(|e| self.error("vkGetSwapchainImagesKHR", e))?;
            for _ in 0..self.images.len() {
                let semaphore = self.gpu.device.raw.create_semaphore(&vk::SemaphoreCreateInfo::default(), None);
                self.rendered.push(semaphore.map_err(|e| self.error("vkCreateSemaphore", e))?);
            }
        }
        // A picture that was taken for the old size may be too short to read.
        self.taken &= self.slots.iter().all(|slot| slot.has_room(bytes));
        self.slots.iter_mut().try_for_each(|slot| slot.reserve(&self.gpu.device, bytes))
    }

    /// MAILBOX may leave a picture out. The newest policy accepts that, to avoid waits. Every device has FIFO.
    fn present_mode(&self) -> Result<vk::PresentModeKHR, EngineError> {
        let fifo = vk::PresentModeKHR::FIFO;
        if self.policy != Policy::Newest {
            return Ok(fifo);
        }
        let modes = self.surface.present_modes(self.gpu.device.physical).map_err(|e| self.error("present modes", e))?;
        let newest = [vk::PresentModeKHR::MAILBOX, vk::PresentModeKHR::IMMEDIATE];
        Ok(newest.into_iter().find(|m| modes.contains(m)).unwrap_or(fifo))
    }
}
