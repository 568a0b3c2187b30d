//! Records submissions of dispatches, copies, barriers and timestamps, up to two in flight.
//!
//! While one submission runs, the next is recorded. Command buffers are reused, and so are descriptor pools, which
//! are reset, and query pools, which grow.

use super::block::{Block, Range};
use super::device::{Device, Patience};
use super::error::EngineError;
use super::groups::Groups;
use super::pipelines::{PUSH_BYTES, Pipeline};
use super::slot::{IN_FLIGHT, Slot, Time};
use super::timeline::Timeline;
use crate::plan::{Entry, Move, SUBMISSION_BYTES};
use ash::{khr, vk};
use std::cell::Cell;
use std::collections::HashSet;
use std::sync::Arc;
use std::sync::atomic::Ordering;

/// Most buffers that a kernel may bind.
const MOST_BUFFERS: usize = 16;

/// The label for the time of a whole recording.
pub(crate) const END: usize = usize::MAX;

/// Source offset, target offset and number of bytes of a copy.
pub(crate) type Piece = (u64, u64, u64);

pub(crate) struct Recorder {
    /// The recording slots, used in turn.
    slots: [Slot; IN_FLIGHT],
    /// Index of the slot in use, or of the last one.
    at: usize,
    /// Rises with every finished submission.
    done: Arc<Timeline>,
    submitted: u64,
    /// The last submission that is certainly finished.
    over: u64,
    /// True if kernels bind half of their ranges, in tests of the code that detects that.
    #[cfg(test)]
    pub(crate) shows_half: bool,
    /// Bands around the ranges of dispatches, in tests that want them.
    #[cfg(test)]
    pub(crate) guards: Option<super::guards::Guards>,
    /// The fault that a test's driver returns from a number of submissions on.
    #[cfg(any(test, feature = "test-hooks"))]
    fails_from: Option<(u64, vk::Result)>,
    /// Longest time of a submission, nanoseconds.
    pub(crate) patience: Patience,
    /// Pipelines that were dispatched.
    used: HashSet<vk::Pipeline>,
    /// True if the recording has a pipeline that was never dispatched before.
    uses_new: bool,
    /// The last submission with such a pipeline.
    first_use: u64,
    /// Times of finished submissions, until someone takes them. In the steady state nothing is allocated.
    pub(crate) times: Vec<Time>,
    regions: Vec<vk::BufferCopy>,
    recording: bool,
    /// True if long recordings are submitted in parts. `moved` is the number of bytes recorded since the last part.
    pub(crate) is_cut: bool,
    /// Bytes after which the next part begins.
    pub(crate) most_moved: u64,
    moved: Cell<u64>,
    /// Bytes of the last dispatch, included in `moved`.
    moved_last: Cell<u64>,
    /// True if the next dispatch must be in the same part as the work before.
    pub(crate) is_held: bool,
    /// The driver's `vkQueueSubmit`, which first reports that the device was lost.
    pub(crate) queue_submit: vk::PFN_vkQueueSubmit,
    /// The newer barriers, if the device has them.
    pub(crate) modern: Option<khr::synchronization2::Device>,
    pub(super) device: Arc<Device>,
}

impl Recorder {
    pub(crate) fn new(device: &Arc<Device>) -> Result<Self, EngineError> {
        Ok(Self {
            slots: [Slot::new(device)?, Slot::new(device)?],
            at: 0,
            done: Arc::new(Timeline::new(device)?),
            submitted: 0,
            over: 0,
            #[cfg(any(test, feature = "test-hooks"))]
            fails_from: None,
            #[cfg(test)]
            guards: None,
            #[cfg(test)]
            shows_half: false,
            patience: device.patience(),
            used: HashSet::new(),
            uses_new: false,
            first_use: 0,
            times: Vec::new(),
            regions: Vec::new(),
            recording: false,
            is_cut: false,
            most_moved: SUBMISSION_BYTES,
            moved: Cell::new(0),
            moved_last: Cell::new(0),
            is_held: false,
            queue_submit: device.raw.fp_v1_0().queue_submit,
            modern: device.synchronization2.clone(),
            device: Arc::clone(device),
        })
    }

    /// Returns the signal that the last submission is over, for any queue.
    pub(crate) fn last(&self) -> (Arc<Timeline>, u64) {
        (Arc::clone(&self.done), self.submitted)
    }

    /// Returns the number of descriptor pools.
    #[cfg(test)]
    pub(crate) fn pools(&self) -> usize {
        self.slots.iter().map(Slot::pools).sum()
    }

    /// Makes the driver return this fault after `submissions` more submissions.
    #[cfg(any(test, feature = "test-hooks"))]
    pub(crate) fn fail_after(&mut self, submissions: u64, fault: vk::Result) {
        self.fails_from = Some((self.submitted + submissions, fault));
    }

    /// Starts a recording with room for `marks` timestamps, after all work in flight. A recording that was not
    /// submitted is discarded.
    pub(crate) fn begin(&mut self, marks: usize) -> Result<(), EngineError> {
        if self.device.is_stuck() {
            return Err(self.device.give_up("vkBeginCommandBuffer", "recording"));
        }
        let next = (self.at + 1) % IN_FLIGHT;
        self.wait_for(self.slots[next].submission, "earlier work")?;
        self.at = next;
        self.slots[next].begin(marks)?;
        self.moved.set(0);
        self.is_held = false;
        // Pipelines of a discarded recording did not run.
        if std::mem::take(&mut self.uses_new) {
            self.used.clear();
        }
        self.recording = true;
        if self.over < self.submitted {
            self.barrier();
        }
        Ok(())
    }

    fn command(&self) -> vk::CommandBuffer {
        self.slots[self.at].command
    }

    /// Returns the longest time to wait for submissions, nanoseconds.
    pub(crate) fn patience_ns(&self) -> u64 {
        self.patience.ns(self.first_use > self.over)
    }

    /// Runs `groups` workgroups of a pipeline over these buffers. Without a barrier, it may run at the same time as
    /// its neighbors.
    pub(crate) fn dispatch<'g>(
        &mut self,
        pipeline: Pipeline,
        buffers: &[Range<'_>],
        push: &[u8],
        groups: impl Into<Groups<'g>>,
    ) -> Result<(), EngineError> {
        self.moved_last.set(0);
        debug_assert!(self.recording && push.len() <= PUSH_BYTES as usize && push.len().is_multiple_of(4));
        debug_assert!(buffers.len() == pipeline.bindings as usize && buffers.len() <= MOST_BUFFERS);
        let groups = groups.into();
        if pipeline.raw == vk::Pipeline::null() {
            return Ok(());
        }
        if matches!(groups, Groups::These(groups) if groups.contains(&0)) {
            return Ok(());
        }
        if !std::mem::take(&mut self.is_held) {
            self.cut_if_due()?;
        }
        #[cfg(test)]
        if self.guards.is_some() {
            return self.dispatch_guarded(pipeline, buffers, push, groups);
        }
        self.bind_and_dispatch(pipeline, buffers, push, groups)
    }

    pub(super) fn bind_and_dispatch(
        &mut self,
        pipeline: Pipeline,
        buffers: &[Range<'_>],
        push: &[u8],
        groups: Groups<'_>,
    ) -> Result<(), EngineError> {
        self.uses_new |= self.used.insert(pipeline.raw);
        let set = self.set(pipeline.set_layout)?;
        let command = self.command();
        let mut infos = [[vk::DescriptorBufferInfo::default()]; MOST_BUFFERS];
        for (info, b) in infos.iter_mut().zip(buffers) {
            debug_assert!(b.offset.is_multiple_of(self.device.report.limits.offset_alignment));
            debug_assert!(b.size <= self.device.report.limits.storage_range);
            let range = b.size.min(self.device.storage_range);
            #[cfg(test)]
            let range = if self.shows_half { range / 8 * 4 } else { range };
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
        // SAFETY: the set is fresh from its pool. Blocks outlive the submission, which is waited for.
        unsafe {
            raw.update_descriptor_sets(writes, &[]);
            raw.cmd_bind_pipeline(command, vk::PipelineBindPoint::COMPUTE, pipeline.raw);
            let point = vk::PipelineBindPoint::COMPUTE;
            raw.cmd_bind_descriptor_sets(command, point, pipeline.layout, 0, &[set], &[]);
            if !push.is_empty() {
                raw.cmd_push_constants(command, pipeline.layout, vk::ShaderStageFlags::COMPUTE, 0, push);
            }
            match groups {
                Groups::These([x, y, z]) => raw.cmd_dispatch(command, x, y, z),
                Groups::At(at) => raw.cmd_dispatch_indirect(command, at.block.raw, at.offset),
            }
        }
        self.device.record(|r| r.push(Entry::Work { moves: Vec::new(), dispatch: true }));
        Ok(())
    }

    /// Reports the moves of the last dispatch, to a device that only records and to the division of long lists.
    pub(crate) fn moved(&self, moves: impl FnOnce() -> Vec<Move>) {
        if self.is_cut || self.device.record_only {
            let moves = moves();
            // An earlier report for the same dispatch is replaced.
            let bytes = moves.iter().map(|m| m.bytes).sum();
            self.moved.set(self.moved.get() + bytes - self.moved_last.replace(bytes));
            self.device.record(|r| r.moved(moves));
        }
    }

    /// Submits the work recorded since the last submission if it is large, and continues the recording.
    fn cut_if_due(&mut self) -> Result<(), EngineError> {
        if !self.is_cut || self.moved.get() <= self.most_moved {
            return Ok(());
        }
        self.moved.set(0);
        let submission = self.hand_over("a part of a list", Entry::Cut)?;
        self.slots[self.at].go_on(submission)
    }

    /// Makes following work wait until earlier work is finished and visible.
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
                let read = Access::SHADER_STORAGE_READ | Access::TRANSFER_READ | Access::INDIRECT_COMMAND_READ;
                (work | Stage::DRAW_INDIRECT, written | read)
            };
            let barrier = [vk::MemoryBarrier2::default()
                .src_stage_mask(work)
                .src_access_mask(written)
                .dst_stage_mask(after)
                .dst_access_mask(read)];
            let info = vk::DependencyInfo::default().memory_barriers(&barrier);
            // SAFETY: the command buffer is being recorded, and the feature is on.
            unsafe { modern.cmd_pipeline_barrier2(self.command(), &info) };
        } else {
            use vk::{AccessFlags as Access, PipelineStageFlags as Stage};
            let work = Stage::COMPUTE_SHADER | Stage::TRANSFER;
            let written = Access::SHADER_WRITE | Access::TRANSFER_WRITE;
            let (after, read) = if host {
                (Stage::HOST, Access::HOST_READ)
            } else {
                let read = Access::SHADER_READ | Access::TRANSFER_READ | Access::INDIRECT_COMMAND_READ;
                (work | Stage::DRAW_INDIRECT, written | read)
            };
            let barrier = [vk::MemoryBarrier::default().src_access_mask(written).dst_access_mask(read)];
            let none = vk::DependencyFlags::empty();
            // SAFETY: the command buffer is being recorded.
            unsafe { raw.cmd_pipeline_barrier(self.command(), work, after, none, &barrier, &[], &[]) };
        }
    }

    /// Makes data that another process wrote to a shared block visible to following work.
    #[cfg(target_os = "linux")]
    pub(crate) fn take_over(&mut self, block: &Block) {
        self.pass(block, vk::QUEUE_FAMILY_EXTERNAL, self.device.compute.family);
    }

    /// Releases a shared block to the other process.
    #[cfg(target_os = "linux")]
    pub(crate) fn hand_back(&mut self, block: &Block) {
        self.pass(block, self.device.compute.family, vk::QUEUE_FAMILY_EXTERNAL);
    }

    #[cfg(target_os = "linux")]
    fn pass(&mut self, block: &Block, from: u32, to: u32) {
        use vk::{AccessFlags as Access, PipelineStageFlags as Stage};
        let work = Stage::COMPUTE_SHADER | Stage::TRANSFER;
        let access = Access::SHADER_READ | Access::TRANSFER_READ | Access::TRANSFER_WRITE;
        let ours = |family: u32| if family == vk::QUEUE_FAMILY_EXTERNAL { Access::empty() } else { access };
        let barrier = [vk::BufferMemoryBarrier::default()
            .buffer(block.raw)
            .size(vk::WHOLE_SIZE)
            .src_queue_family_index(from)
            .dst_queue_family_index(to)
            .src_access_mask(ours(from))
            .dst_access_mask(ours(to))];
        let (raw, none) = (&self.device.raw, vk::DependencyFlags::empty());
        // SAFETY: the command buffer is being recorded, and the block's memory was made to be shared.
        unsafe { raw.cmd_pipeline_barrier(self.command(), work, work, none, &[], &barrier, &[]) };
    }

    /// Fills a range with zeros.
    pub(crate) fn clear(&mut self, range: Range<'_>) {
        // SAFETY: the command buffer is being recorded. Offset and size are multiples of 4.
        unsafe { self.device.raw.cmd_fill_buffer(self.command(), range.block.raw, range.offset, range.size, 0) };
        self.moved.set(self.moved.get() + range.size);
        self.device.record(|r| r.push(Entry::Work { moves: vec![range.writes(range.size)], dispatch: false }));
    }

    /// Copies these pieces from one block to another.
    pub(crate) fn copy(&mut self, from: &Block, to: &Block, pieces: impl IntoIterator<Item = Piece>) {
        self.regions.clear();
        let region = |(src_offset, dst_offset, size)| vk::BufferCopy { src_offset, dst_offset, size };
        self.regions.extend(pieces.into_iter().filter(|p| p.2 > 0).map(region));
        if !self.regions.is_empty() {
            // SAFETY: the command buffer is being recorded, and the pieces are inside the blocks.
            unsafe { self.device.raw.cmd_copy_buffer(self.command(), from.raw, to.raw, &self.regions) };
            let bytes = self.regions.iter().map(|r| r.size).sum();
            self.moved.set(self.moved.get() + 2 * bytes);
            let moves = || vec![from.all().reads(bytes), to.all().writes(bytes)];
            self.device.record(|r| r.push(Entry::Work { moves: moves(), dispatch: false }));
        }
    }

    /// Assigns the time since the last mark to `label`, if this recording has timestamps.
    pub(crate) fn mark(&mut self, label: usize) {
        self.device.record(|r| r.push(Entry::Mark(label)));
        self.slots[self.at].mark(label);
    }

    /// Labels the work since the last mark, without timing it.
    pub(crate) fn note(&self, label: usize) {
        self.device.record(|r| r.push(Entry::Mark(label)));
    }

    /// Assigns the time since the beginning to [`END`].
    pub(crate) fn mark_end(&mut self) {
        self.slots[self.at].mark(END);
    }

    /// Runs the recording and waits for it. A device that does not answer in time is lost. `during` names the work in
    /// errors.
    pub(crate) fn submit(&mut self, during: &str) -> Result<(), EngineError> {
        let submission = self.send(during)?;
        self.wait_for(submission, during)
    }

    /// Runs the recording after all earlier work and returns its number. Its resources must not change until it was
    /// [waited for](Self::wait_for).
    pub(crate) fn send(&mut self, during: &str) -> Result<u64, EngineError> {
        self.wait(true);
        self.recording = false;
        let submission = self.hand_over(during, Entry::Submit)?;
        self.slots[self.at].sent(submission);
        Ok(submission)
    }

    /// Returns the index of the current part of a list, and keeps the next dispatch in it. Data that the host writes
    /// from now on is visible to this part and to later ones.
    pub(crate) fn hold_part(&mut self) -> Result<usize, EngineError> {
        self.cut_if_due()?;
        self.is_held = true;
        Ok(self.slots[self.at].part)
    }

    /// Ends the current command buffer and submits it.
    fn hand_over(&mut self, during: &str, as_what: Entry) -> Result<u64, EngineError> {
        let raw = &self.device.raw;
        let device = &self.device;
        let error = |call| move |e| device.error(call, during, e);
        let commands = [self.command()];
        let next = self.submitted + 1;
        let (semaphores, values) = ([self.done.raw], [next]);
        let mut timeline = vk::TimelineSemaphoreSubmitInfo::default().signal_semaphore_values(&values);
        let info = [vk::SubmitInfo::default()
            .command_buffers(&commands)
            .signal_semaphores(&semaphores)
            .push_next(&mut timeline)];
        // SAFETY: the queue is locked during the submission. All recorded objects live until the submission was
        // waited for.
        unsafe {
            raw.end_command_buffer(self.command()).map_err(error("vkEndCommandBuffer"))?;
            if device.record_only {
                device.record(|r| r.push(as_what));
            } else {
                let submitted = (self.queue_submit)(*device.compute.lock(), 1, info.as_ptr(), vk::Fence::null());
                submitted.result().map_err(error("vkQueueSubmit"))?;
            }
        }
        device.count(|counts| counts.submissions += 1);
        self.submitted = next;
        if std::mem::take(&mut self.uses_new) {
            if self.first_use <= self.over {
                device.first_uses.fetch_add(1, Ordering::Relaxed);
            }
            self.first_use = next;
        }
        #[cfg(any(test, feature = "test-hooks"))]
        if let Some((_, fault)) = self.fails_from.filter(|(from, _)| next > *from) {
            self.wait_for(next, during)?;
            return Err(self.device.error("vkQueueSubmit", during, fault));
        }
        Ok(next)
    }

    /// Waits for a submission, for a limited time, and reads its times.
    pub(crate) fn wait_for(&mut self, submission: u64, during: &str) -> Result<(), EngineError> {
        let device = &self.device;
        if submission > self.over {
            if submission == self.submitted {
                device.count(|counts| counts.stalls += 1);
                device.record(|r| r.push(Entry::Stall));
            }
            let (semaphores, values) = ([self.done.raw], [submission]);
            let wait = vk::SemaphoreWaitInfo::default().semaphores(&semaphores).values(&values);
            if !device.record_only {
                if device.is_stuck() {
                    return Err(device.give_up("vkWaitSemaphores", during));
                }
                // SAFETY: the semaphore is this recorder's, and the submission that signals it was made.
                match unsafe { device.raw.wait_semaphores(&wait, self.patience_ns()) } {
                    Err(vk::Result::TIMEOUT) => return Err(device.give_up("vkWaitSemaphores", during)),
                    other => other.map_err(|e| device.error("vkWaitSemaphores", during, e))?,
                }
            }
            if (self.over + 1..=submission).contains(&self.first_use) {
                device.first_uses.fetch_sub(1, Ordering::Relaxed);
            }
            self.over = submission;
        }
        let times = &mut self.times;
        self.slots.iter_mut().filter(|slot| slot.submission <= self.over).try_for_each(|slot| slot.read_times(times))
    }

    /// Waits until all submissions are over.
    pub(crate) fn idle(&mut self) -> Result<(), EngineError> {
        self.wait_for(self.submitted, "earlier work")
    }

    fn set(&mut self, layout: vk::DescriptorSetLayout) -> Result<vk::DescriptorSet, EngineError> {
        if self.slots[self.at].is_used_up() {
            // Each slot gets one, so that the next recording has as many as this one needed.
            self.slots.iter_mut().try_for_each(Slot::add_pool)?;
        }
        self.slots[self.at].set(layout)
    }
}

impl Drop for Recorder {
    fn drop(&mut self) {
        if self.device.is_stuck() || self.device.record_only {
            return;
        }
        let (semaphores, values) = ([self.done.raw], [self.submitted]);
        let wait = vk::SemaphoreWaitInfo::default().semaphores(&semaphores).values(&values);
        // SAFETY: all submissions are over after the wait (or the device is lost, and nothing runs either).
        if unsafe { self.device.raw.wait_semaphores(&wait, self.patience_ns()) } == Err(vk::Result::TIMEOUT) {
            // Objects that the device may still use are not destroyed.
            let _ = self.device.give_up("vkWaitSemaphores", "closing");
        }
        if self.first_use > self.over {
            self.device.first_uses.fetch_sub(1, Ordering::Relaxed);
        }
    }
}
