//! Counts the finished submissions of a recorder on the device.

use super::device::Device;
use super::error::EngineError;
use ash::vk;
use std::sync::Arc;

/// A semaphore whose value is the number of finished submissions.
pub struct Timeline {
    pub raw: vk::Semaphore,
    device: Arc<Device>,
}

impl Timeline {
    pub(super) fn new(device: &Arc<Device>) -> Result<Self, EngineError> {
        let mut kind = vk::SemaphoreTypeCreateInfo::default().semaphore_type(vk::SemaphoreType::TIMELINE);
        let info = vk::SemaphoreCreateInfo::default().push_next(&mut kind);
        // SAFETY: the device is valid and has timeline semaphores. The semaphore is destroyed in `drop`.
        let raw = unsafe { device.raw.create_semaphore(&info, None) };
        let raw = raw.map_err(|e| device.error("vkCreateSemaphore", "setting up", e))?;
        Ok(Self { raw, device: Arc::clone(device) })
    }
}

impl Drop for Timeline {
    fn drop(&mut self) {
        if self.device.is_stuck() {
            return;
        }
        // SAFETY: its recorder waited for its submissions, and those who wait for it hold it. It is destroyed once.
        unsafe { self.device.raw.destroy_semaphore(self.raw, None) };
    }
}
