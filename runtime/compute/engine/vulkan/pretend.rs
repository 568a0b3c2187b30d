//! Makes a device behave like a lesser or faulty one, for tests.

use super::engine::VulkanEngine;
#[cfg(test)]
use crate::gpu::Patience;
#[cfg(test)]
use crate::gpu::guards::Guards;
use crate::gpu::{Commands, EngineError, Gpu};

/// The abilities that a lesser device lacks.
#[derive(Debug, Clone, Copy, Default)]
pub struct LesserDevice {
    /// True if transfers are staged, as on a device with its own memory.
    pub staged: bool,
    /// Bytes that a kernel may bind.
    pub storage_range: Option<u64>,
    /// True if only the barriers of Vulkan 1.0 exist.
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
    /// Makes the driver refuse every submission because the device was lost.
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

/// Makes the driver accept every submission and run nothing, with a short time limit.
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
    commands.recorder.queue_submit = nothing;
    commands.recorder.patience = Patience { usual_ns: 1_000_000, first_use_ns: 1_000_000 };
}

#[cfg(test)]
impl VulkanEngine {
    /// Lowers the largest range that a kernel may bind.
    pub(super) fn pretend_range(&mut self, bytes: u64) {
        self.gpu.limits.storage_range = bytes;
    }

    /// Returns the number of live allocations, and of descriptor pools.
    pub(super) fn held(&self) -> (usize, usize) {
        (self.gpu.device.allocations(), self.gpu.recorder.pools())
    }

    /// Runs dispatches between guard bands from now on.
    pub(super) fn guard(&mut self) {
        self.gpu.device.pipelines().maker.is_guarded = true;
        self.gpu.recorder.guards = Some(Guards::default());
    }

    pub(super) fn guards(&mut self) -> &mut Guards {
        self.gpu.recorder.guards.as_mut().expect("guards")
    }

    /// Binds half of each range from now on, so that results are silently wrong.
    pub(super) fn pretend_wrong(&mut self) {
        self.gpu.recorder.shows_half = true;
    }

    /// Cuts lists before every dispatch from now on.
    pub(super) fn pretend_slow(&mut self) {
        self.gpu.recorder.most_moved = 0;
    }

    /// Sets barriers like a device without synchronization2.
    pub(super) fn pretend_old(&mut self) {
        self.gpu.recorder.modern = None;
    }
}
