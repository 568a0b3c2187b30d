//! Holds the command buffer, descriptor pools and timestamps of one submission, and reuses them later.

use super::device::Device;
use super::error::EngineError;
use ash::vk;
use std::sync::Arc;

/// Submissions of a recorder that may be under way at once.
pub(crate) const IN_FLIGHT: usize = 2;

/// Descriptor sets per pool.
const SETS: u32 = 512;

/// Seconds between a mark and the one before it, in the submission with this number.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Time {
    pub(crate) submission: u64,
    pub(crate) label: usize,
    pub(crate) seconds: f64,
}

pub(super) struct Slot {
    commands: vk::CommandPool,
    /// The command buffer that is recorded into.
    pub(super) command: vk::CommandBuffer,
    /// All command buffers, which a recording in parts takes one after the other. `part` is the index of the current
    /// one.
    parts: Vec<vk::CommandBuffer>,
    pub(super) part: usize,
    /// The last submission that used it.
    pub(super) submission: u64,
    pools: Vec<vk::DescriptorPool>,
    /// Index of the current pool, and the number of sets taken from it.
    used: (usize, u32),
    queries: vk::QueryPool,
    capacity: u32,
    /// Labels of the timestamps after the first.
    marks: Vec<usize>,
    timed: bool,
    /// True if the last recording was submitted.
    is_sent: bool,
    ticks: Vec<u64>,
    device: Arc<Device>,
}

impl Slot {
    pub(super) fn new(device: &Arc<Device>) -> Result<Self, EngineError> {
        let mut slot = Self {
            commands: vk::CommandPool::null(),
            command: vk::CommandBuffer::null(),
            parts: Vec::new(),
            part: 0,
            submission: 0,
            pools: Vec::new(),
            used: (0, 0),
            queries: vk::QueryPool::null(),
            capacity: 0,
            marks: Vec::new(),
            timed: false,
            is_sent: false,
            ticks: Vec::new(),
            device: Arc::clone(device),
        };
        let error = |call| move |e| device.error(call, "setting up", e);
        let info = vk::CommandPoolCreateInfo::default().queue_family_index(device.compute.family);
        // SAFETY: the device is valid. Everything made here is destroyed in `drop`.
        unsafe {
            slot.commands = device.raw.create_command_pool(&info, None).map_err(error("vkCreateCommandPool"))?;
        }
        slot.take_part(0)?;
        Ok(slot)
    }

    /// Directs recordings to the command buffer with this index.
    fn take_part(&mut self, part: usize) -> Result<(), EngineError> {
        let device = &self.device;
        if part == self.parts.len() {
            let info = vk::CommandBufferAllocateInfo::default()
                .command_pool(self.commands)
                .level(vk::CommandBufferLevel::PRIMARY)
                .command_buffer_count(1);
            // SAFETY: the pool is this slot's, and lives as long as the buffers from it.
            let made = unsafe { device.raw.allocate_command_buffers(&info) };
            self.parts.extend(made.map_err(|e| device.error("vkAllocateCommandBuffers", "setting up", e))?);
        }
        (self.part, self.command) = (part, self.parts[part]);
        Ok(())
    }

    /// Continues in another command buffer, after the recorded part was submitted with this number.
    pub(super) fn go_on(&mut self, submission: u64) -> Result<(), EngineError> {
        self.submission = submission;
        self.take_part(self.part + 1)?;
        self.begin_part()
    }

    /// Starts recording into the current command buffer.
    fn begin_part(&self) -> Result<(), EngineError> {
        let once = vk::CommandBufferBeginInfo::default().flags(vk::CommandBufferUsageFlags::ONE_TIME_SUBMIT);
        // SAFETY: it is unused since its pool was reset.
        let begun = unsafe { self.device.raw.begin_command_buffer(self.command, &once) };
        begun.map_err(|e| self.device.error("vkBeginCommandBuffer", "recording", e))
    }

    #[cfg(test)]
    pub(super) fn pools(&self) -> usize {
        self.pools.len()
    }

    /// Starts a recording with room for `marks` timestamps. The previous recording here is over.
    pub(super) fn begin(&mut self, marks: usize) -> Result<(), EngineError> {
        self.timed = marks > 0 && self.device.report.limits.timestamp_period > 0.0;
        self.marks.clear();
        self.is_sent = false;
        self.take_part(0)?;
        let (device, raw) = (&self.device, &self.device.raw);
        let error = |call| move |e| device.error(call, "recording", e);
        // SAFETY: submissions from here were waited for, so pools may be reset and queries replaced.
        unsafe {
            raw.reset_command_pool(self.commands, vk::CommandPoolResetFlags::empty())
                .map_err(error("vkResetCommandPool"))?;
            let touched = self.pools.iter().take(if self.used == (0, 0) { 0 } else { self.used.0 + 1 });
            for pool in touched {
                raw.reset_descriptor_pool(*pool, vk::DescriptorPoolResetFlags::empty())
                    .map_err(error("vkResetDescriptorPool"))?;
            }
            self.used = (0, 0);
            let wanted = marks as u32 + 1;
            if self.timed && wanted > self.capacity {
                raw.destroy_query_pool(self.queries, None);
                (self.queries, self.capacity) = (vk::QueryPool::null(), 0);
                let count = wanted.next_power_of_two().max(64);
                let info = vk::QueryPoolCreateInfo::default().query_type(vk::QueryType::TIMESTAMP).query_count(count);
                self.queries = raw.create_query_pool(&info, None).map_err(error("vkCreateQueryPool"))?;
                self.capacity = count;
            }
            self.begin_part()?;
            if self.timed {
                raw.cmd_reset_query_pool(self.command, self.queries, 0, wanted);
                raw.cmd_write_timestamp(self.command, vk::PipelineStageFlags::BOTTOM_OF_PIPE, self.queries, 0);
            }
        }
        Ok(())
    }

    /// Assigns the time since the last mark to `label`.
    pub(super) fn mark(&mut self, label: usize) {
        if !self.timed {
            return;
        }
        self.marks.push(label);
        debug_assert!((self.marks.len() as u32) < self.capacity);
        let (stage, at) = (vk::PipelineStageFlags::BOTTOM_OF_PIPE, self.marks.len() as u32);
        // SAFETY: the query was reset at the start of the recording, and is written once.
        unsafe { self.device.raw.cmd_write_timestamp(self.command, stage, self.queries, at) };
    }

    /// Records that the recording became this submission.
    pub(super) fn sent(&mut self, submission: u64) {
        (self.submission, self.is_sent) = (submission, true);
    }

    /// Reads the times of a finished submission, once.
    pub(super) fn read_times(&mut self, times: &mut Vec<Time>) -> Result<(), EngineError> {
        if self.marks.is_empty() || !self.is_sent || self.device.record_only {
            return Ok(());
        }
        self.ticks.clear();
        self.ticks.resize(self.marks.len() + 1, 0);
        let flags = vk::QueryResultFlags::TYPE_64 | vk::QueryResultFlags::WAIT;
        // SAFETY: these queries were written by a submission that was waited for.
        let read = unsafe { self.device.raw.get_query_pool_results(self.queries, 0, &mut self.ticks, flags) };
        read.map_err(|e| self.device.error("vkGetQueryPoolResults", "timestamps", e))?;
        let period = f64::from(self.device.report.limits.timestamp_period) * 1e-9;
        let seconds = self.ticks.windows(2).map(|t| t[1].saturating_sub(t[0]) as f64 * period);
        let submission = self.submission;
        times.extend(self.marks.iter().zip(seconds).map(|(&label, seconds)| Time { submission, label, seconds }));
        self.marks.clear();
        Ok(())
    }

    /// Returns true if the next set needs another pool.
    pub(super) fn is_used_up(&self) -> bool {
        self.used.0 + usize::from(self.used.1 == SETS) >= self.pools.len()
    }

    /// Adds a pool for descriptor sets.
    pub(super) fn add_pool(&mut self) -> Result<(), EngineError> {
        let device = &self.device;
        // Kernels bind 4 buffers on average or fewer, but some of the transform's bind more.
        let sizes = [vk::DescriptorPoolSize { ty: vk::DescriptorType::STORAGE_BUFFER, descriptor_count: 8 * SETS }];
        let info = vk::DescriptorPoolCreateInfo::default().max_sets(SETS).pool_sizes(&sizes);
        // SAFETY: `info` is valid for the call.
        let pool = unsafe { device.raw.create_descriptor_pool(&info, None) };
        self.pools.push(pool.map_err(|e| device.error("vkCreateDescriptorPool", "descriptor sets", e))?);
        device.count(|counts| counts.pools += 1);
        Ok(())
    }

    /// Allocates a descriptor set. A pool with room for it exists.
    pub(super) fn set(&mut self, layout: vk::DescriptorSetLayout) -> Result<vk::DescriptorSet, EngineError> {
        let device = &self.device;
        if self.used.1 == SETS {
            self.used = (self.used.0 + 1, 0);
        }
        let layouts = [layout];
        let info =
            vk::DescriptorSetAllocateInfo::default().descriptor_pool(self.pools[self.used.0]).set_layouts(&layouts);
        let mut set = vk::DescriptorSet::null();
        // This bypasses ash, which would allocate a list for the one set.
        let allocate = device.raw.fp_v1_0().allocate_descriptor_sets;
        // SAFETY: the pool has room for this set, and one is requested.
        let made = unsafe { allocate(device.raw.handle(), &info, &mut set) }.result();
        made.map_err(|e| device.error("vkAllocateDescriptorSets", "descriptor sets", e))?;
        self.used.1 += 1;
        Ok(set)
    }
}

impl Drop for Slot {
    fn drop(&mut self) {
        if self.device.is_stuck() {
            return;
        }
        let raw = &self.device.raw;
        // SAFETY: the recorder has waited for all submissions from here, and each object is destroyed once.
        unsafe {
            raw.destroy_query_pool(self.queries, None);
            for pool in &self.pools {
                raw.destroy_descriptor_pool(*pool, None);
            }
            raw.destroy_command_pool(self.commands, None);
        }
    }
}
