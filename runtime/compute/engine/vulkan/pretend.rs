//! What tests have a device pretend.

use super::engine::VulkanEngine;
#[cfg(test)]
use crate::gpu::guards::Guards;
use crate::gpu::{Commands, EngineError, Gpu};

/// What a device cannot do that the tests' device can.
#[derive(Debug, Clone, Copy, Default)]
pub struct LesserDevice {
    /// Transfers are staged, as where the device has its memory for itself.
    pub staged: bool,
    /// Bytes that a kernel may see.
    pub storage_range: Option<u64>,
    /// Only the barriers of Vulkan 1.0.
    pub old_barriers: bool,
}

impl LesserDevice {
    pub(super) fn commands(&self, gpu: &Gpu) -> Result<Commands, EngineError> {
        let mut commands = Commands::new(gpu)?;
        commands.in_place = !self.staged;
        commands.limits.storage_range = self.storage_range.unwrap_or(commands.limits.storage_range);
        if self.old_barriers {
            commands.recorder.modern = None;
        }
        Ok(commands)
    }
}

impl VulkanEngine {
    /// From now on the driver refuses every submission because the device was lost.
    pub fn pretend_lost(&mut self) {
        unsafe extern "system" fn lost(
            _: ash::vk::Queue,
            _: u32,
            _: *const ash::vk::SubmitInfo<'_>,
            _: ash::vk::Fence,
        ) -> ash::vk::Result {
            ash::vk::Result::ERROR_DEVICE_LOST
        }
        self.gpu.recorder.queue_submit = lost;
    }
}

/// From now on the driver takes every submission and does nothing with it, and patience is short.
#[cfg(test)]
pub(super) fn pretend_stuck(commands: &mut Commands) {
    unsafe extern "system" fn nothing(
        _: ash::vk::Queue,
        _: u32,
        _: *const ash::vk::SubmitInfo<'_>,
        _: ash::vk::Fence,
    ) -> ash::vk::Result {
        ash::vk::Result::SUCCESS
    }
    (commands.recorder.queue_submit, commands.recorder.patience_ns) = (nothing, 1_000_000);
}

#[cfg(test)]
impl VulkanEngine {
    /// Makes the largest range that a kernel may see smaller than it is.
    pub(super) fn pretend_range(&mut self, bytes: u64) {
        self.gpu.limits.storage_range = bytes;
    }

    /// Number of allocations alive, and of descriptor pools.
    pub(super) fn held(&self) -> (usize, usize) {
        (self.gpu.device.allocations(), self.gpu.recorder.pools())
    }

    /// From now on dispatches run between guard bands.
    pub(super) fn guard(&mut self) {
        self.gpu.device.pipelines().maker.is_guarded = true;
        self.gpu.recorder.guards = Some(Guards::default());
    }

    pub(super) fn guards(&mut self) -> &mut Guards {
        self.gpu.recorder.guards.as_mut().expect("guards")
    }

    /// From now on kernels see half of what they are bound to: results are wrong, and nothing says so.
    pub(super) fn pretend_wrong(&mut self) {
        self.gpu.recorder.shows_half = true;
    }

    /// From now on lists are cut before every dispatch.
    pub(super) fn pretend_slow(&mut self) {
        self.gpu.recorder.most_moved = 0;
    }

    /// Sets barriers as a device without synchronization2 does.
    pub(super) fn pretend_old(&mut self) {
        self.gpu.recorder.modern = None;
    }
}
