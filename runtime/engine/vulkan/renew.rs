//! What a screen does when its swapchain is no longer right: it makes it again where the picture still fits, once, and
//! else says what is the matter.

use super::super::EngineError;
use super::screen::Screen;
use ash::vk;

/// Attempts at an image, the first one counted.
const ATTEMPTS: usize = 3;

impl Screen {
    /// An image to copy into.
    ///
    /// Out of date, it is made again of the same size, or refused where the window has another. A lost surface is made
    /// again where what it was on is still there. An image that does not come in time is asked for once more: after a
    /// suspend the time is over before anybody could answer.
    pub(super) fn next_image(&mut self) -> Result<u32, EngineError> {
        self.check_suboptimal()?;
        let mut last = vk::Result::SUCCESS;
        for _ in 0..ATTEMPTS {
            let before = last;
            last = match self.acquire() {
                Ok((image, suboptimal)) => {
                    self.note(suboptimal);
                    return Ok(image);
                }
                Err(e) => e,
            };
            match last {
                vk::Result::ERROR_OUT_OF_DATE_KHR => self.make_swapchain()?,
                vk::Result::ERROR_SURFACE_LOST_KHR => self.make_surface_again()?,
                vk::Result::TIMEOUT | vk::Result::NOT_READY if before != last => {}
                _ => break,
            }
        }
        Err(self.error("vkAcquireNextImageKHR", last))
    }

    /// What presenting or acquiring said of the swapchain.
    pub(super) fn note(&mut self, suboptimal: bool) {
        self.suboptimal |= suboptimal;
    }

    /// A swapchain that could be better is made again, once: some drivers say so for ever. A window of another size is
    /// refused, for its edge would show something else.
    fn check_suboptimal(&mut self) -> Result<(), EngineError> {
        if !std::mem::take(&mut self.suboptimal) {
            self.tolerated = false;
            return Ok(());
        }
        if std::mem::replace(&mut self.tolerated, true) {
            return self.capabilities().map(drop);
        }
        self.make_swapchain()
    }

    fn make_surface_again(&mut self) -> Result<(), EngineError> {
        // SAFETY: the device is idle before anything is destroyed, each once; the target is as it was in `open`.
        unsafe {
            let _ = self.device.device_wait_idle();
            self.drop_swapchain();
            self.surface_calls.destroy_surface(self.surface, None);
            self.surface = vk::SurfaceKHR::null();
            self.surface = self.target.surface(&self.instance).map_err(|e| match e {
                vk::Result::ERROR_OUT_OF_HOST_MEMORY | vk::Result::ERROR_OUT_OF_DEVICE_MEMORY => {
                    self.error("surface", e)
                }
                _ => self.error("surface", vk::Result::ERROR_SURFACE_LOST_KHR),
            })?;
            let shows =
                self.surface_calls.get_physical_device_surface_support(self.physical, self.family, self.surface);
            if !shows.unwrap_or(false) {
                return Err(self.error("surface", vk::Result::ERROR_SURFACE_LOST_KHR));
            }
        }
        self.make_swapchain()
    }

    /// Why a call did not do what it should.
    pub(super) fn error(&self, call: &'static str, result: vk::Result) -> EngineError {
        let lost = |reason: String| EngineError::ScreenLost { device: self.name.clone(), reason };
        match result {
            vk::Result::ERROR_DEVICE_LOST => EngineError::DeviceLost { device: self.name.clone(), during: call.into() },
            vk::Result::ERROR_SURFACE_LOST_KHR => lost(self.target.gone().into()),
            vk::Result::ERROR_OUT_OF_DATE_KHR => lost(
                "its swapchain is out of date as often as it is made again: something changes it all the time".into(),
            ),
            vk::Result::TIMEOUT | vk::Result::NOT_READY => {
                lost("it takes no pictures any more: the display is off, or the window is hidden".into())
            }
            other => EngineError::Vulkan { device: self.name.clone(), call, result: format!("{other:?}") },
        }
    }
}
