//! Records one submission: dispatches, copies, barriers and timestamps, then runs it and waits.
//!
//! Everything in here is used again: one command buffer, descriptor pools that are reset, a query pool that grows.

use super::block::{Block, Range};
use super::counters::add;
use super::device::Device;
use super::error::EngineError;
use super::pipelines::{PUSH_BYTES, Pipeline};
use crate::plan::{Entry, Move};
use ash::{khr, vk};
use std::sync::Arc;

/// Buffers that a kernel sees at most.
const MOST_BUFFERS: usize = 16;

/// Bytes to be copied: from where, to where, how many.
pub(crate) type Piece = (u64, u64, u64);

/// Descriptor sets per pool.
const SETS: u32 = 512;

/// A semaphore whose value is the number of submissions that are over.
pub(crate) struct Timeline {
    pub(crate) raw: vk::Semaphore,
    device: Arc<Device>,
}

impl Timeline {
    fn new(device: &Arc<Device>) -> Result<Self, EngineError> {
        let mut kind = vk::SemaphoreTypeCreateInfo::default().semaphore_type(vk::SemaphoreType::TIMELINE);
        let info = vk::SemaphoreCreateInfo::default().push_next(&mut kind);
        // SAFETY: the device is valid and has timeline semaphores; it is destroyed in `drop`.
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
        // SAFETY: the recorder that signals it waited for its submissions, and who waits for it holds it; destroyed once.
        unsafe { self.device.raw.destroy_semaphore(self.raw, None) };
    }
}

pub(crate) struct Recorder {
    commands: vk::CommandPool,
    command: vk::CommandBuffer,
    /// Rises with every submission that is over.
    done: Arc<Timeline>,
    pub(crate) submitted: u64,
    /// What a test's driver says from a number of submissions on.
    #[cfg(test)]
    pub(crate) fails_from: Option<(u64, vk::Result)>,
    /// How long a submission may take, nanoseconds.
    pub(crate) patience_ns: u64,
    sets: Vec<vk::DescriptorPool>,
    /// The pool in use, and how many sets it gave.
    used: (usize, u32),
    queries: vk::QueryPool,
    capacity: u32,
    marks: Vec<usize>,
    /// Kept from submission to submission, so that the steady state allocates nothing.
    ticks: Vec<u64>,
    times: Vec<(usize, f64)>,
    regions: Vec<vk::BufferCopy>,
    recording: bool,
    /// The driver's `vkQueueSubmit`: where it first says that the device was lost.
    pub(crate) queue_submit: vk::PFN_vkQueueSubmit,
    /// The newer barriers, where the device has them.
    pub(crate) modern: Option<khr::synchronization2::Device>,
    device: Arc<Device>,
}

impl Recorder {
    pub(crate) fn new(device: &Arc<Device>) -> Result<Self, EngineError> {
        let mut recorder = Self {
            commands: vk::CommandPool::null(),
            command: vk::CommandBuffer::null(),
            done: Arc::new(Timeline::new(device)?),
            submitted: 0,
            #[cfg(test)]
            fails_from: None,
            patience_ns: device.patience_ns(),
            sets: Vec::new(),
            used: (0, 0),
            queries: vk::QueryPool::null(),
            capacity: 0,
            marks: Vec::new(),
            ticks: Vec::new(),
            times: Vec::new(),
            regions: Vec::new(),
            recording: false,
            queue_submit: device.raw.fp_v1_0().queue_submit,
            modern: device.synchronization2.clone(),
            device: Arc::clone(device),
        };
        let error = |call| move |e| device.error(call, "setting up", e);
        let info = vk::CommandPoolCreateInfo::default().queue_family_index(device.compute.family);
        // SAFETY: the device is valid; what is made is destroyed in `drop`.
        unsafe {
            recorder.commands = device.raw.create_command_pool(&info, None).map_err(error("vkCreateCommandPool"))?;
            let info = vk::CommandBufferAllocateInfo::default()
                .command_pool(recorder.commands)
                .level(vk::CommandBufferLevel::PRIMARY)
                .command_buffer_count(1);
            let made = device.raw.allocate_command_buffers(&info).map_err(error("vkAllocateCommandBuffers"))?;
            recorder.command = made[0];
        }
        Ok(recorder)
    }

    /// What says that the last submission is over, on any queue.
    pub(crate) fn last(&self) -> (Arc<Timeline>, u64) {
        (Arc::clone(&self.done), self.submitted)
    }

    /// Number of descriptor pools.
    #[cfg(test)]
    pub(crate) fn pools(&self) -> usize {
        self.sets.len()
    }

    /// Starts a recording with room for `marks` timestamps. A recording that was not submitted is thrown away.
    pub(crate) fn begin(&mut self, marks: usize) -> Result<(), EngineError> {
        let device = &self.device;
        let error = |call| move |e| device.error(call, "recording", e);
        if device.is_stuck() {
            return Err(device.give_up("vkBeginCommandBuffer", "recording"));
        }
        let raw = &self.device.raw;
        let wanted = marks as u32 + 1;
        // SAFETY: what was submitted before has been waited for, so pools may be reset and queries replaced.
        unsafe {
            raw.reset_command_pool(self.commands, vk::CommandPoolResetFlags::empty())
                .map_err(error("vkResetCommandPool"))?;
            for pool in &self.sets {
                raw.reset_descriptor_pool(*pool, vk::DescriptorPoolResetFlags::empty())
                    .map_err(error("vkResetDescriptorPool"))?;
            }
            self.used = (0, 0);
            if self.has_timestamps() && wanted > self.capacity {
                raw.destroy_query_pool(self.queries, None);
                (self.queries, self.capacity) = (vk::QueryPool::null(), 0);
                let count = wanted.next_power_of_two().max(64);
                let info = vk::QueryPoolCreateInfo::default().query_type(vk::QueryType::TIMESTAMP).query_count(count);
                self.queries = raw.create_query_pool(&info, None).map_err(error("vkCreateQueryPool"))?;
                self.capacity = count;
            }
            let once = vk::CommandBufferBeginInfo::default().flags(vk::CommandBufferUsageFlags::ONE_TIME_SUBMIT);
            raw.begin_command_buffer(self.command, &once).map_err(error("vkBeginCommandBuffer"))?;
            self.marks.clear();
            if self.has_timestamps() && marks > 0 {
                raw.cmd_reset_query_pool(self.command, self.queries, 0, self.capacity);
                raw.cmd_write_timestamp(self.command, vk::PipelineStageFlags::BOTTOM_OF_PIPE, self.queries, 0);
            }
        }
        self.recording = true;
        Ok(())
    }

    /// Runs `groups` workgroups of a pipeline over these buffers. Without a barrier, it may run beside its neighbours.
    pub(crate) fn dispatch(
        &mut self,
        pipeline: Pipeline,
        buffers: &[Range<'_>],
        push: &[u8],
        groups: [u32; 3],
    ) -> Result<(), EngineError> {
        debug_assert!(self.recording && push.len() <= PUSH_BYTES as usize && push.len().is_multiple_of(4));
        debug_assert!(buffers.len() == pipeline.bindings as usize && buffers.len() <= MOST_BUFFERS);
        if groups.contains(&0) {
            return Ok(());
        }
        let set = self.set(pipeline.set_layout)?;
        let mut infos = [[vk::DescriptorBufferInfo::default()]; MOST_BUFFERS];
        for (info, b) in infos.iter_mut().zip(buffers) {
            debug_assert!(b.offset.is_multiple_of(self.device.report.limits.offset_alignment));
            debug_assert!(b.size <= self.device.report.limits.storage_range);
            let range = b.size.min(self.device.storage_range);
            *info = [vk::DescriptorBufferInfo { buffer: b.block.raw, offset: b.offset, range }];
        }
        let mut writes = [vk::WriteDescriptorSet::default(); MOST_BUFFERS];
        for ((i, write), info) in writes.iter_mut().enumerate().zip(&infos) {
            *write = vk::WriteDescriptorSet::default()
                .dst_set(set)
                .dst_binding(i as u32)
                .descriptor_type(vk::DescriptorType::STORAGE_BUFFER)
                .buffer_info(info);
        }
        let writes = &writes[..buffers.len().min(MOST_BUFFERS)];
        let raw = &self.device.raw;
        // SAFETY: the set is fresh from its pool; blocks outlive the submission, which is waited for.
        unsafe {
            raw.update_descriptor_sets(writes, &[]);
            raw.cmd_bind_pipeline(self.command, vk::PipelineBindPoint::COMPUTE, pipeline.raw);
            let point = vk::PipelineBindPoint::COMPUTE;
            raw.cmd_bind_descriptor_sets(self.command, point, pipeline.layout, 0, &[set], &[]);
            if !push.is_empty() {
                raw.cmd_push_constants(self.command, pipeline.layout, vk::ShaderStageFlags::COMPUTE, 0, push);
            }
            raw.cmd_dispatch(self.command, groups[0], groups[1], groups[2]);
        }
        self.device.record(|r| r.push(Entry::Work { moves: Vec::new(), dispatch: true }));
        Ok(())
    }

    /// Says what the last dispatch moves, to a device that only records.
    pub(crate) fn moved(&self, moves: impl FnOnce() -> Vec<Move>) {
        self.device.record(|r| r.moved(moves()));
    }

    /// What was recorded before is finished, and seen, before what follows starts.
    pub(crate) fn barrier(&mut self) {
        self.wait(false);
    }

    fn wait(&mut self, host: bool) {
        if !host {
            self.device.record(|r| r.push(Entry::Barrier));
        }
        let raw = &self.device.raw;
        if let Some(modern) = &self.modern {
            use vk::{AccessFlags2 as Access, PipelineStageFlags2 as Stage};
            let work = Stage::COMPUTE_SHADER | Stage::ALL_TRANSFER;
            let written = Access::SHADER_STORAGE_WRITE | Access::TRANSFER_WRITE;
            let (after, read) = if host {
                (Stage::HOST, Access::HOST_READ)
            } else {
                (work, written | Access::SHADER_STORAGE_READ | Access::TRANSFER_READ)
            };
            let barrier = [vk::MemoryBarrier2::default()
                .src_stage_mask(work)
                .src_access_mask(written)
                .dst_stage_mask(after)
                .dst_access_mask(read)];
            let info = vk::DependencyInfo::default().memory_barriers(&barrier);
            // SAFETY: the command buffer is being recorded; the feature is on.
            unsafe { modern.cmd_pipeline_barrier2(self.command, &info) };
        } else {
            use vk::{AccessFlags as Access, PipelineStageFlags as Stage};
            let work = Stage::COMPUTE_SHADER | Stage::TRANSFER;
            let written = Access::SHADER_WRITE | Access::TRANSFER_WRITE;
            let (after, read) = if host {
                (Stage::HOST, Access::HOST_READ)
            } else {
                (work, written | Access::SHADER_READ | Access::TRANSFER_READ)
            };
            let barrier = [vk::MemoryBarrier::default().src_access_mask(written).dst_access_mask(read)];
            let none = vk::DependencyFlags::empty();
            // SAFETY: the command buffer is being recorded.
            unsafe { raw.cmd_pipeline_barrier(self.command, work, after, none, &barrier, &[], &[]) };
        }
    }

    /// Fills a range with zeros.
    pub(crate) fn clear(&mut self, range: Range<'_>) {
        // SAFETY: the command buffer is being recorded; offset and size are multiples of 4.
        unsafe { self.device.raw.cmd_fill_buffer(self.command, range.block.raw, range.offset, range.size, 0) };
        self.device.record(|r| r.push(Entry::Work { moves: vec![range.writes(range.size)], dispatch: false }));
    }

    /// Copies pieces.
    pub(crate) fn copy(&mut self, from: &Block, to: &Block, pieces: impl IntoIterator<Item = Piece>) {
        self.regions.clear();
        let region = |(src_offset, dst_offset, size)| vk::BufferCopy { src_offset, dst_offset, size };
        self.regions.extend(pieces.into_iter().filter(|p| p.2 > 0).map(region));
        if !self.regions.is_empty() {
            // SAFETY: the command buffer is being recorded; the pieces lie inside the blocks.
            unsafe { self.device.raw.cmd_copy_buffer(self.command, from.raw, to.raw, &self.regions) };
            let bytes = self.regions.iter().map(|r| r.size).sum();
            let moves = || vec![from.all().reads(bytes), to.all().writes(bytes)];
            self.device.record(|r| r.push(Entry::Work { moves: moves(), dispatch: false }));
        }
    }

    /// The time since the mark before belongs to `label`.
    pub(crate) fn mark(&mut self, label: usize) {
        self.marks.push(label);
        self.device.record(|r| r.push(Entry::Mark(label)));
        if self.has_timestamps() {
            debug_assert!((self.marks.len() as u32) < self.capacity);
            let (stage, at) = (vk::PipelineStageFlags::BOTTOM_OF_PIPE, self.marks.len() as u32);
            // SAFETY: the query was reset at the start of the recording, and is written once.
            unsafe { self.device.raw.cmd_write_timestamp(self.command, stage, self.queries, at) };
        }
    }

    /// Runs what was recorded and waits, for a while: a device that does not answer is lost. Returns (label, seconds) per mark;
    /// `during` is what an error names.
    pub(crate) fn submit(&mut self, during: &str) -> Result<&[(usize, f64)], EngineError> {
        self.wait(true);
        self.recording = false;
        let raw = &self.device.raw;
        let device = &self.device;
        let error = |call| move |e| device.error(call, during, e);
        let commands = [self.command];
        let (semaphores, values) = ([self.done.raw], [self.submitted + 1]);
        let mut timeline = vk::TimelineSemaphoreSubmitInfo::default().signal_semaphore_values(&values);
        let info = [vk::SubmitInfo::default()
            .command_buffers(&commands)
            .signal_semaphores(&semaphores)
            .push_next(&mut timeline)];
        let wait = vk::SemaphoreWaitInfo::default().semaphores(&semaphores).values(&values);
        // SAFETY: the queue is locked while it is submitted to; all that was recorded lives until the wait is over.
        unsafe {
            raw.end_command_buffer(self.command).map_err(error("vkEndCommandBuffer"))?;
            if device.record_only {
                device.record(|r| r.push(Entry::Submit));
                add(&device.counters.submissions, 1);
                self.times.clear();
                return Ok(&self.times);
            }
            let submitted = (self.queue_submit)(*device.compute.lock(), 1, info.as_ptr(), vk::Fence::null());
            submitted.result().map_err(error("vkQueueSubmit"))?;
            self.submitted += 1;
            add(&device.counters.submissions, 1);
            #[cfg(test)]
            if let Some((_, fault)) = self.fails_from.filter(|(from, _)| self.submitted > *from) {
                let _ = raw.wait_semaphores(&wait, u64::MAX);
                return Err(device.error("vkQueueSubmit", during, fault));
            }
            match raw.wait_semaphores(&wait, self.patience_ns) {
                Err(vk::Result::TIMEOUT) => return Err(device.give_up("vkWaitSemaphores", during)),
                other => other.map_err(error("vkWaitSemaphores"))?,
            }
        }
        self.read_times().map_err(|e| self.device.error("vkGetQueryPoolResults", during, e))?;
        Ok(&self.times)
    }

    fn read_times(&mut self) -> Result<(), vk::Result> {
        self.times.clear();
        if self.marks.is_empty() {
            return Ok(());
        }
        self.ticks.clear();
        self.ticks.resize(self.marks.len() + 1, 0);
        if self.has_timestamps() {
            let flags = vk::QueryResultFlags::TYPE_64 | vk::QueryResultFlags::WAIT;
            // SAFETY: these queries were written by the submission that was just waited for.
            unsafe { self.device.raw.get_query_pool_results(self.queries, 0, &mut self.ticks, flags)? };
        }
        let period = f64::from(self.device.report.limits.timestamp_period) * 1e-9;
        let seconds = self.ticks.windows(2).map(|t| t[1].saturating_sub(t[0]) as f64 * period);
        self.times.extend(self.marks.iter().copied().zip(seconds));
        Ok(())
    }

    fn has_timestamps(&self) -> bool {
        self.device.report.limits.timestamp_period > 0.0
    }

    fn set(&mut self, layout: vk::DescriptorSetLayout) -> Result<vk::DescriptorSet, EngineError> {
        let raw = &self.device.raw;
        let device = &self.device;
        let error = |call| move |e| device.error(call, "descriptor sets", e);
        if self.used.1 == SETS {
            self.used = (self.used.0 + 1, 0);
        }
        if self.used.0 == self.sets.len() {
            // Kernels see 4 buffers on average or fewer; some of the transform's see more.
            let sizes = [vk::DescriptorPoolSize { ty: vk::DescriptorType::STORAGE_BUFFER, descriptor_count: 8 * SETS }];
            let info = vk::DescriptorPoolCreateInfo::default().max_sets(SETS).pool_sizes(&sizes);
            // SAFETY: `info` is valid for the call.
            let pool = unsafe { raw.create_descriptor_pool(&info, None) }.map_err(error("vkCreateDescriptorPool"))?;
            self.sets.push(pool);
            add(&device.counters.pools, 1);
        }
        let layouts = [layout];
        let info =
            vk::DescriptorSetAllocateInfo::default().descriptor_pool(self.sets[self.used.0]).set_layouts(&layouts);
        let mut set = vk::DescriptorSet::null();
        // Not through ash, which makes a list of the one.
        let allocate = raw.fp_v1_0().allocate_descriptor_sets;
        // SAFETY: the pool has room for this set, and one is asked for.
        unsafe { allocate(raw.handle(), &info, &mut set) }.result().map_err(error("vkAllocateDescriptorSets"))?;
        self.used.1 += 1;
        Ok(set)
    }
}

impl Drop for Recorder {
    fn drop(&mut self) {
        if self.device.is_stuck() {
            return;
        }
        let raw = &self.device.raw;
        let (semaphores, values) = ([self.done.raw], [self.submitted]);
        let wait = vk::SemaphoreWaitInfo::default().semaphores(&semaphores).values(&values);
        // SAFETY: what was submitted is over after the wait (or the device lost, when nothing runs either); each is
        // destroyed once.
        unsafe {
            let _ = raw.wait_semaphores(&wait, u64::MAX);
            raw.destroy_query_pool(self.queries, None);
            for pool in &self.sets {
                raw.destroy_descriptor_pool(*pool, None);
            }
            raw.destroy_command_pool(self.commands, None);
        }
    }
}
