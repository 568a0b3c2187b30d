//! The engine: buffers, one recording per part of a list, losses and times back.

use super::super::{
    Buffer, Engine, EngineError, Kernel, Memory, PupilPass, Purpose, Resource, Shape, Step, Storage, Timing, misfit,
    not_kept, nothing_kept, promise,
};
use super::check::check;
use super::fft::Transform;
use super::layout::{Arenas, Layout, Slot, Value, slot_layout, slots};
use super::record::{Stack, Stacks, Work};
use super::tables::Tables;
use super::views::Views;
use crate::gpu::{Block, Commands, DeviceKind, Gpu, PhasesOnDevice, add};
use crate::plan::Extent;
use crate::scene::Pyramid;
use gpu_allocator::MemoryLocation;
use std::collections::HashMap;
use std::ops::Range;
use std::sync::Arc;

/// Bytes from one place in `Losses` to the next: any device's alignment.
const PLACE: u64 = 256;

/// Sums of the loss, on the device and where the host sees them.
struct Losses {
    device: Block,
    host: Block,
}

/// Runs lists of kernels on a Vulkan device.
pub struct VulkanEngine {
    // Dropped in this order: the device last.
    stacks: Stacks,
    /// Phases that are kept.
    kept: Option<Stack>,
    arenas: Arenas,
    tables: Tables,
    views: Option<Views>,
    losses: Option<Losses>,
    transforms: Box<dyn Transform + Send>,
    shape: Shape,
    /// Where the pupil pass buffers of the last step lie.
    slots: Vec<Slot>,
    /// Pupil pass buffers that were written since: they find their place when a step says where.
    written: HashMap<Buffer, Vec<f32>>,
    clock: [(u64, f64); Kernel::ALL.len()],
    gpu: Commands,
}

impl VulkanEngine {
    /// On a device. [`load`](Engine::load) makes the buffers.
    ///
    /// # Errors
    /// The device's.
    pub fn new(gpu: &Gpu) -> Result<Self, EngineError> {
        let gpu = Commands::new(gpu)?;
        let place = bytemuck::Zeroable::zeroed();
        Ok(Self {
            stacks: Stacks::default(),
            kept: None,
            arenas: Arenas::default(),
            tables: Tables::default(),
            views: None,
            losses: None,
            transforms: super::fft::transforms(),
            shape: Shape { frames: 0, place, purpose: Purpose::View, quantised: false, storage: Storage::F32 },
            slots: Vec::new(),
            written: HashMap::new(),
            clock: [(0, 0.0); Kernel::ALL.len()],
            gpu,
        })
    }

    /// The device.
    pub fn gpu(&self) -> &Gpu {
        &self.gpu.shared
    }

    /// Makes the largest range that a kernel may see smaller than it is.
    #[cfg(test)]
    pub(super) fn pretend_range(&mut self, bytes: u64) {
        self.gpu.limits.storage_range = bytes;
    }

    /// Number of allocations alive, and of descriptor pools.
    #[cfg(test)]
    pub(super) fn held(&self) -> (usize, usize) {
        (self.gpu.device.allocations(), self.gpu.recorder.pools())
    }

    /// From now on the driver answers to every submission that the device was lost.
    #[cfg(test)]
    pub(super) fn pretend_lost(&mut self) {
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

    /// From now on the driver takes every submission and does nothing with it, and patience is short.
    #[cfg(test)]
    pub(super) fn pretend_stuck(&mut self) {
        unsafe extern "system" fn nothing(
            _: ash::vk::Queue,
            _: u32,
            _: *const ash::vk::SubmitInfo<'_>,
            _: ash::vk::Fence,
        ) -> ash::vk::Result {
            ash::vk::Result::SUCCESS
        }
        (self.gpu.recorder.queue_submit, self.gpu.recorder.patience_ns) = (nothing, 1_000_000);
    }

    /// Sets barriers as a device without synchronization2 does.
    #[cfg(test)]
    pub(super) fn pretend_old(&mut self) {
        self.gpu.recorder.modern = None;
    }

    fn stack(&self, layout: Layout, what: &str) -> Result<Option<Stack>, EngineError> {
        if layout.values == 0 || layout.frames == 0 {
            return Ok(None);
        }
        let limit = self.gpu.limits().storage_range;
        if layout.at_once(limit) == 0 {
            let bytes = layout.frame_bytes();
            return Err(EngineError::Unsuitable {
                device: self.gpu.report().name.clone(),
                reason: format!("one frame of the {what} takes {bytes} bytes, a kernel may see {limit}"),
            });
        }
        Ok(Some(Stack { layout, block: self.gpu.block(layout.bytes(), what)? }))
    }

    fn fill_moments(&mut self) {
        for moment in [Buffer::Momentum, Buffer::Second] {
            if let Ok(stack) = self.stacks.get(moment) {
                self.gpu.recorder.clear(stack.block.all());
            }
        }
    }

    /// Puts the pupil pass buffers that were written by hand into the slots of `group`.
    fn place_written(&mut self, group: &[Slot]) -> Result<(), EngineError> {
        for (buffer, data) in std::mem::take(&mut self.written) {
            let Some((resource, at, index)) = pupil_pass_buffer(buffer) else { continue };
            let Some(layout) = group.get(index).map(|slot| slot[at]) else {
                return Err(EngineError::Mismatch {
                    reason: format!("{buffer:?} was written, and no pupil_pass uses it"),
                });
            };
            if layout.floats() != data.len() {
                return Err(misfit(buffer, layout.floats(), data.len()));
            }
            if let Some(block) = self.arenas.block(resource).filter(|_| !data.is_empty()) {
                layout.write(&mut self.gpu, block, &data)?;
            }
        }
        Ok(())
    }

    /// Places for the sums of each pupil pass's loss, behind one for what `check_finite` finds; they are as far apart as the device
    /// wants.
    fn place_losses(&mut self, step: &Step) -> Result<Vec<u64>, EngineError> {
        let mut end = PLACE;
        let place = |pupil_pass: &PupilPass| {
            let at = end;
            end += (4 * pupil_pass.compare.parts() as u64).next_multiple_of(PLACE);
            at
        };
        let offsets: Vec<u64> = step.pupil_passes.iter().map(place).collect();
        if end > self.losses.as_ref().map_or(0, |l| l.device.size) {
            self.losses = None;
            let size = end.next_power_of_two();
            let device = self.gpu.block(size, "losses")?;
            let host = Block::new(&self.gpu.device, size, MemoryLocation::GpuToCpu, "losses")?;
            self.losses = Some(Losses { device, host });
        }
        Ok(offsets)
    }

    fn record(&mut self, step: &Step, part: Range<usize>, offsets: &[u64]) -> Result<Vec<f64>, EngineError> {
        let list = &step.list[part];
        let Self { stacks, arenas, tables, views, losses, transforms, shape, gpu, .. } = self;
        let views = views.as_ref();
        let sums = losses.as_ref().map(|l| (&l.device, offsets));
        let transforms = &mut **transforms;
        let mut work = Work { gpu, transforms, shape, step, stacks, arenas, tables, views, losses: sums };
        work.prepare(list)?;
        work.gpu.recorder.begin(list.len())?;
        tables.record(work.gpu);
        let mut group: (Range<usize>, Vec<Slot>) = (0..0, Vec::new());
        for dispatch in list {
            if !dispatch.pupil_passes.is_empty() && dispatch.pupil_passes != group.0 {
                group =
                    (dispatch.pupil_passes.clone(), slots(&step.pupil_passes[dispatch.pupil_passes.clone()], shape));
            }
            work.gpu.recorder.barrier();
            work.record(dispatch, &group.1)?;
            work.gpu.recorder.mark(dispatch.kernel as usize);
        }
        let answers = |resource| list.iter().filter(move |d| d.kernel.writes().any(|r| r == resource));
        let compared: Vec<Range<usize>> = answers(Resource::Losses).map(|d| d.pupil_passes.clone()).collect();
        let compared = || compared.iter().cloned().flatten();
        let checked = answers(Resource::NotFinite).next().is_some();
        if let Some(losses) = losses.as_ref() {
            work.gpu.recorder.barrier();
            let of_pupil_pass = |i: usize| (offsets[i], offsets[i], 4 * step.pupil_passes[i].compare.parts() as u64);
            let pieces = checked.then_some((0, 0, 4)).into_iter().chain(compared().map(of_pupil_pass));
            work.gpu.recorder.copy(&losses.device, &losses.host, pieces);
        }
        let during = list.iter().map(|d| d.kernel.name()).collect::<Vec<_>>();
        let during = match during[..] {
            [] => return Ok(vec![0.0; step.pupil_passes.len()]),
            [one] => one.to_owned(),
            [first, .., last] => format!("{first} to {last}"),
        };
        for &(kernel, seconds) in work.gpu.recorder.submit(&during)? {
            self.clock[kernel].0 += 1;
            self.clock[kernel].1 += seconds;
        }
        let mut result = vec![0.0; step.pupil_passes.len()];
        if let Some(losses) = self.losses.as_ref().filter(|_| !self.gpu.device.record_only) {
            let bytes = losses.host.bytes();
            for i in compared() {
                let sums = &bytes[offsets[i] as usize..][..4 * step.pupil_passes[i].compare.parts()];
                result[i] = bytemuck::pod_collect_to_vec::<u8, f32>(sums).into_iter().map(f64::from).sum();
            }
            if checked && bytes[..4] != [0; 4] {
                result.fill(f64::NAN);
            }
        }
        if !group.1.is_empty() {
            self.slots = group.1;
        }
        Ok(result)
    }
}

impl Engine for VulkanEngine {
    fn describe(&self) -> String {
        let r = self.gpu.report();
        format!("Vulkan {}, {} ({}), {}", r.api, r.name, r.kind, r.driver)
    }

    fn memory(&self) -> Memory {
        match self.gpu.report().kind {
            DeviceKind::Cpu | DeviceKind::Integrated => Memory::Shared,
            _ => Memory::Device,
        }
    }

    fn load(&mut self, shape: &Shape, views: Option<Arc<Pyramid>>) -> Result<(), EngineError> {
        if self.memory() != Memory::Device {
            promise(shape, shape.storage.bytes() as u64)?;
        }
        // What was there goes first: both may not fit.
        (self.stacks, self.kept) = (Stacks::default(), None);
        (self.arenas, self.views) = (Arenas::default(), None);
        self.slots.clear();
        self.written.clear();
        self.shape = *shape;
        if let Some(views) = views {
            self.views = Some(Views::new(&mut self.gpu, &views)?);
        }
        for (at, resource) in Resource::OF_SHAPE.into_iter().enumerate() {
            let Extent { frames, values, complex } = shape.extent(resource);
            let value = if complex { Value::Complex(shape.storage) } else { Value::Real };
            self.stacks.0[at] = self.stack(Layout { offset: 0, frames, values, value }, &resource.name())?;
        }
        self.gpu.recorder.begin(0)?;
        for stack in self.stacks.0.iter().flatten() {
            self.gpu.recorder.clear(stack.block.all());
        }
        self.gpu.recorder.submit("clearing").map(drop)
    }

    fn write(&mut self, buffer: Buffer, data: &[f32]) -> Result<(), EngineError> {
        if pupil_pass_buffer(buffer).is_some() {
            self.written.insert(buffer, data.to_vec());
            return Ok(());
        }
        let Stack { layout, block } = self.stacks.get(buffer)?;
        if layout.floats() != data.len() {
            return Err(misfit(buffer, layout.floats(), data.len()));
        }
        layout.write(&mut self.gpu, block, data)
    }

    fn read(&mut self, buffer: Buffer) -> Result<Vec<f32>, EngineError> {
        let Some((resource, at, index)) = pupil_pass_buffer(buffer) else {
            let Stack { layout, block } = self.stacks.get(buffer)?;
            if buffer == Buffer::Phases {
                add(&self.gpu.device.counters.phases_read_back, layout.bytes());
            }
            return layout.read(&mut self.gpu, block);
        };
        if let Some(data) = self.written.get(&buffer) {
            return Ok(data.clone());
        }
        let never = || EngineError::Mismatch { reason: format!("{buffer:?} was never written") };
        let layout = self.slots.get(index).ok_or_else(never)?[at];
        if layout.floats() == 0 {
            return Ok(Vec::new());
        }
        layout.read(&mut self.gpu, self.arenas.block(resource).ok_or_else(never)?)
    }

    fn keep(&mut self, buffer: Buffer) -> Result<(), EngineError> {
        if !matches!(buffer, Buffer::Phases | Buffer::Shown) {
            return Err(not_kept(buffer));
        }
        let layout = self.stacks.get(buffer)?.layout;
        if self.kept.is_none() {
            self.kept = self.stack(layout, "phases that are kept")?;
        }
        let (Some(kept), from) = (&self.kept, self.stacks.get(buffer)?) else { return Err(nothing_kept()) };
        self.gpu.recorder.begin(0)?;
        self.gpu.recorder.copy(&from.block, &kept.block, [(0, 0, layout.bytes())]);
        self.gpu.recorder.submit("keeping phases").map(drop)
    }

    fn kept(&mut self) -> Result<Vec<f32>, EngineError> {
        let Stack { layout, block } = self.kept.as_ref().ok_or_else(nothing_kept)?;
        add(&self.gpu.device.counters.phases_read_back, layout.bytes());
        layout.read(&mut self.gpu, block)
    }

    fn restore(&mut self) -> Result<(), EngineError> {
        let kept = self.kept.as_ref().ok_or_else(nothing_kept)?;
        let phases = self.stacks.get(Buffer::Phases)?;
        self.gpu.recorder.begin(0)?;
        self.gpu.recorder.copy(&kept.block, &phases.block, [(0, 0, phases.layout.bytes())]);
        self.fill_moments();
        self.gpu.recorder.submit("beginning again").map(drop)
    }

    fn clear_moments(&mut self) -> Result<(), EngineError> {
        self.gpu.recorder.begin(0)?;
        self.fill_moments();
        self.gpu.recorder.submit("forgetting velocities").map(drop)
    }

    fn phases_on_device(&self) -> Option<PhasesOnDevice<'_>> {
        let Stack { layout, block } = self.stacks.get(Buffer::Phases).ok()?;
        Some(PhasesOnDevice { block, frames: layout.frames, values: layout.values })
    }

    fn run_part(&mut self, step: &Step, part: Range<usize>) -> Result<Vec<f64>, EngineError> {
        check(step, &part, &self.shape, self.views.as_ref())?;
        if self.shape.frames == 0 {
            return Ok(vec![0.0; step.pupil_passes.len()]);
        }
        self.arenas.fit(&self.gpu, step, &self.shape)?;
        if let Some(first) = step.list[part.clone()].iter().find(|d| !d.pupil_passes.is_empty()) {
            let group = slots(&step.pupil_passes[first.pupil_passes.clone()], &self.shape);
            self.place_written(&group)?;
        }
        self.tables.pack(&self.gpu, &step.pupil_passes, self.views.as_ref())?;
        let offsets = self.place_losses(step)?;
        self.record(step, part, &offsets)
    }

    fn timings(&self) -> Vec<Timing> {
        let one = |kernel: Kernel| {
            let (calls, seconds) = self.clock[kernel as usize];
            Timing { kernel, calls, seconds }
        };
        Kernel::ALL.into_iter().map(one).filter(|t| t.calls > 0).collect()
    }

    fn reset_timings(&mut self) {
        self.clock = Default::default();
    }
}

/// Place in a slot, and slot, of a pupil pass buffer.
fn pupil_pass_buffer(buffer: Buffer) -> Option<(Resource, usize, usize)> {
    let (resource, slot) = buffer.resource();
    Some((resource, slot_layout(resource)?, slot?))
}
