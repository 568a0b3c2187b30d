//! Replaces a swapchain of exact size that is out of date, once, if the picture still fits.
//!
//! Otherwise it reports the reason.

#![allow(unsafe_code)]

use super::swapchain::{PATIENCE_NS, Swapchain};
use ash::vk;
use eyebox_compute::gpu::EngineError;

/// Attempts to acquire an image, including the first.
const ATTEMPTS: usize = 3;

impl Swapchain {
    /// Acquires an image to copy into.
    ///
    /// A swapchain that is out of date is made again with the same size, or rejected if the window has another size. A
    /// lost surface is made again if its target is still there. An image that does not come in time is requested once
    /// more, because after a suspend the time limit has passed before the driver could answer.
    pub(super) fn next_image(&mut self) -> Result<u32, EngineError> {
        self.check_suboptimal()?;
        let mut last = vk::Result::SUCCESS;
        for _ in 0..ATTEMPTS {
            let before = last;
            last = match self.acquire(PATIENCE_NS) {
                Ok((image, suboptimal)) => {
                    self.stale |= suboptimal;
                    return Ok(image);
                }
                Err(e) => e,
            };
            match last {
                vk::Result::ERROR_OUT_OF_DATE_KHR => self.remake()?,
                vk::Result::ERROR_SURFACE_LOST_KHR => self.recreate_surface()?,
                vk::Result::TIMEOUT | vk::Result::NOT_READY if before != last => {}
                _ => break,
            }
        }
        Err(self.error("vkAcquireNextImageKHR", last))
    }

    fn size(&self) -> [usize; 2] {
        [self.extent.height as usize, self.extent.width as usize]
    }

    /// Makes the swapchain again with the same size.
    pub(super) fn remake(&mut self) -> Result<(), EngineError> {
        self.make(self.size()).map(drop)
    }

    /// Makes a suboptimal swapchain again, once, because some drivers report it forever. A window of another size is
    /// rejected, because its edge would show something else.
    fn check_suboptimal(&mut self) -> Result<(), EngineError> {
        if !std::mem::take(&mut self.stale) {
            self.tolerated = false;
            return Ok(());
        }
        if std::mem::replace(&mut self.tolerated, true) {
            return self.extent_now(self.size()).map(drop);
        }
        self.remake()
    }

    fn recreate_surface(&mut self) -> Result<(), EngineError> {
        self.wait()?;
        // SAFETY: nothing of the swapchain is under way, and it goes before its surface.
        let made = unsafe {
            self.drop_swapchain();
            self.surface.recreate()
        };
        let lost = vk::Result::ERROR_SURFACE_LOST_KHR;
        made.map_err(|e| match e {
            vk::Result::ERROR_OUT_OF_HOST_MEMORY | vk::Result::ERROR_OUT_OF_DEVICE_MEMORY => self.error("surface", e),
            _ => self.error("surface", lost),
        })?;
        if !self.surface.shows(self.gpu.device.physical, self.gpu.device.present().family) {
            return Err(self.error("surface", lost));
        }
        self.remake()
    }

    /// The error for a failed call.
    pub(super) fn error(&self, call: &'static str, result: vk::Result) -> EngineError {
        let device = || self.gpu.device.report.name.clone();
        let lost = |reason: &str| EngineError::ScreenLost { device: device(), reason: reason.into() };
        match result {
            vk::Result::ERROR_DEVICE_LOST => self.gpu.device.error(call, call, result),
            vk::Result::ERROR_SURFACE_LOST_KHR => lost(self.surface.gone()),
            vk::Result::ERROR_OUT_OF_DATE_KHR => {
                lost("its swapchain is out of date again after each replacement: something changes it all the time")
            }
            vk::Result::TIMEOUT | vk::Result::NOT_READY => {
                lost("it no longer takes pictures: the display is off, or the window is hidden")
            }
            other => EngineError::Vulkan { device: device(), call, result: format!("{other:?}") },
        }
    }
}
