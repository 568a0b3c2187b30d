//! Records one kernel over as much as the device may bind at once.
//!
//! Bindings are in the order of the table, and arguments are push constants.

use super::super::fft::{Along, Fft, Frames};
use super::super::flight::Guarded;
use super::super::layout::{Arenas, Layout, Slot, Value, slot_layout};
use super::super::tables::Tables;
use super::super::views::Views;
use super::hazards::Hazards;
use super::stacks::Stacks;
use crate::engine::{Dispatch, EngineError, Kernel, PupilPass, Resource, Shape, Step, Storage};
use crate::gpu::{Block, Commands, PUSH_BYTES, Range};
use crate::plan::{Access, PerFrame, moved};
use bytemuck::Pod;
use eyebox_kernels::WIDTH;
use eyebox_kernels::fft::{Columns, Direction};
use eyebox_spirv::Module;
use std::fmt::Display;

/// Workgroups that fill any device a few times over.
const ENOUGH: u32 = 4096;

/// The state of a recording.
pub(in super::super) struct Work<'a> {
    pub(in super::super) gpu: &'a mut Commands,
    pub(in super::super) transforms: &'a mut Fft,
    pub(in super::super) shape: &'a Shape,
    pub(in super::super) step: &'a Step,
    pub(in super::super) stacks: &'a Stacks,
    pub(in super::super) arenas: &'a Arenas,
    pub(in super::super) tables: &'a Tables,
    pub(in super::super) views: Option<&'a Views>,
    /// The dispatches that change phases only if losses are finite, if any do.
    pub(in super::super) guarded: Option<Guarded<'a>>,
    /// The block of losses, and the starts of each pupil pass's sums in bytes. It begins with the result of
    /// `check_finite`.
    pub(in super::super) losses: Option<(&'a Block, &'a [u64])>,
    pub(in super::super) hazards: Hazards,
}

/// A kernel over the step, or over one of its pupil passes.
pub(super) struct Call<'w, 'a> {
    pub(super) work: &'w mut Work<'a>,
    pub(super) step: &'a Step,
    pub(super) shape: &'a Shape,
    pub(super) kernel: Kernel,
    pub(super) module: Option<&'static Module>,
    pub(super) dispatch: &'w Dispatch,
    /// Slots of the dispatch's pupil passes.
    pub(super) slots: &'w [Slot],
    /// Index in the dispatch's pupil passes.
    pub(super) at: usize,
    /// Index in the source's modes of that pupil pass.
    pub(super) mode: usize,
}

impl Work<'_> {
    /// Records a barrier if the next bindings depend on the work since the last barrier.
    pub(in super::super) fn before(&mut self, binds: &[(Access, Resource)]) {
        if self.hazards.meets(binds, self.shape) {
            self.gpu.recorder.barrier();
        }
    }
}

/// The domain of a kernel.
#[derive(Clone, Copy)]
pub(super) enum Grid {
    /// Rows and columns of each sub-frame.
    Rows(u32, u32),
    /// Values of each sub-frame.
    Values(usize),
    /// Values, each of which is a sum over the sub-frames.
    Summed(usize),
    /// Workgroups, each with its own part.
    Parts(usize),
}

impl<'a> Call<'_, 'a> {
    /// Runs over rows and columns, with these arguments and the strides of the bindings.
    pub(super) fn rows(&mut self, rows: u32, columns: u32, args: &impl Pod) -> Result<(), EngineError> {
        self.over(Grid::Rows(rows, columns), |_, _| *args, &[])
    }

    /// Runs over `count` values.
    pub(super) fn values(&mut self, count: usize, args: &impl Pod) -> Result<(), EngineError> {
        self.over(Grid::Values(count), |_, _| *args, &[])
    }

    /// Runs by parts, one per workgroup.
    pub(super) fn parts(&mut self, parts: usize, args: &impl Pod) -> Result<(), EngineError> {
        if parts > self.work.gpu.limits.groups[0] as usize {
            return Err(self.work.too_large("an image", parts));
        }
        self.over(Grid::Parts(parts), |_, _| *args, &[])
    }

    /// Runs over as many sub-frames at once as the device allows. `args` returns the arguments for (first, count).
    /// Push constants are the arguments, the strides, and `tail`.
    pub(super) fn over<A: Pod>(
        &mut self,
        grid: Grid,
        args: impl Fn(usize, usize) -> A,
        tail: &[u32],
    ) -> Result<(), EngineError> {
        let binds = self.kernel.binds();
        let framed = self.framed()?;
        let frames = if framed.is_empty() { 1 } else { self.shape.frames };
        // Each kind of frames has one stride. The shape's kinds come first, in the order of the bindings, then the
        // windows'.
        let mut kinds: Vec<PerFrame> = Vec::with_capacity(2);
        let mut more = Vec::with_capacity(4);
        for last in [false, true] {
            for (kind, layout) in framed.iter().filter(|(kind, _)| (*kind == PerFrame::Window) == last) {
                if !kinds.contains(kind) {
                    kinds.push(*kind);
                    more.push(layout.stride() as u32);
                }
            }
        }
        more.extend(tail);
        // All sub-frames add to such a resource.
        let adds = self.kernel.writes().any(|resource| resource.per_frame().is_none());
        let most = framed.iter().map(|(_, layout)| self.work.at_once(layout)).min().unwrap_or(1);
        let most = most.min(self.work.in_time(framed.iter().map(|(_, layout)| 2 * layout.step()).sum()));
        for (first, count) in self.work.chunks(frames, most) {
            let mut buffers = Vec::with_capacity(binds.len());
            for (_, resource) in binds {
                match self.range(*resource, first, count)? {
                    Some(range) => buffers.push(range),
                    None => return Ok(()),
                }
            }
            if adds && first > 0 {
                self.work.gpu.recorder.barrier();
            }
            let groups = match grid {
                Grid::Rows(rows, columns) => self.work.rows(rows, columns, count),
                Grid::Values(values) => self.work.along(values, count),
                Grid::Summed(values) => self.work.along(values, 1),
                Grid::Parts(parts) => [parts as u32, 1, 1],
            };
            self.run(&buffers, &args(first, count), &more, groups)?;
        }
        Ok(())
    }

    /// Returns the bindings of which each sub-frame has its own.
    fn framed(&self) -> Result<Vec<(PerFrame, Layout)>, EngineError> {
        let mut framed = Vec::with_capacity(4);
        for (_, resource) in self.kernel.binds() {
            if let Some(kind) = resource.per_frame() {
                framed.push((kind, self.layout(*resource)?));
            }
        }
        Ok(framed)
    }

    /// Returns the layout of a buffer. If nothing is quantized, `Shown` is the phases.
    pub(super) fn layout(&self, resource: Resource) -> Result<Layout, EngineError> {
        match resource.is_shared() {
            false => self.layout_of(resource, self.at).map(|layout| self.of_mode(resource, layout)),
            true => Ok(self.work.stacks.find(self.shape.alias(resource)).ok_or_else(|| self.missing(resource))?.layout),
        }
    }

    /// Returns the mode's part of a buffer that holds all modes.
    fn of_mode(&self, resource: Resource, layout: Layout) -> Layout {
        let frames = match resource {
            Resource::Window => self.shape.frames,
            Resource::Transfer => 1,
            _ => return layout,
        };
        Layout { offset: layout.offset + (self.mode * frames) as u64 * layout.step(), frames, ..layout }
    }

    /// Returns the layout of a buffer of one of the dispatch's pupil passes, with all modes.
    pub(super) fn layout_of(&self, resource: Resource, at: usize) -> Result<Layout, EngineError> {
        let slot = slot_layout(resource).zip(self.slots.get(at));
        slot.map(|(kind, slot)| slot[kind]).ok_or_else(|| self.missing(resource))
    }

    /// Returns one of the dispatch's pupil passes.
    pub(super) fn pass(&self, at: usize) -> &'a PupilPass {
        &self.step.pupil_passes[self.dispatch.pupil_passes.start + at]
    }

    /// Returns the bound range, or none if the step lacks this resource, so that the kernel has nothing to do.
    pub(super) fn range(
        &self,
        resource: Resource,
        first: usize,
        count: usize,
    ) -> Result<Option<Range<'a>>, EngineError> {
        let Work { stacks, arenas, tables, losses, .. } = &*self.work;
        let index = self.dispatch.pupil_passes.start + self.at;
        match resource {
            Resource::Spans | Resource::EyeTerms | Resource::TaperWeights | Resource::Moments => {
                tables.bound(tables.place(index, self.mode), resource).transpose()
            }
            // Kernels over several pupils find these in their own tables.
            Resource::Views | Resource::Taps | Resource::RowWeights | Resource::ColumnWeights => Ok(None),
            Resource::Losses => {
                let parts = self.step.pupil_passes[index].loss_parts() as u64;
                Ok(losses.map(|(block, offsets)| block.range(offsets[index], 4 * parts)))
            }
            Resource::NotFinite => Ok(losses.map(|(block, _)| block.range(0, 4))),
            _ => {
                let (first, count) = if resource.per_frame().is_some() { (first, count) } else { (0, 1) };
                if slot_layout(resource).is_some() {
                    let block = arenas.block(resource).ok_or_else(|| self.missing(resource))?;
                    return Ok(Some(self.layout(resource)?.range(block, first, count)));
                }
                // Each mode of the source has its own table of the relay.
                let own = || self.step.pupil_passes[index].mode(self.mode).source_mode;
                let first = if resource == Resource::Relay { own() } else { first };
                let stack = stacks.find(self.shape.alias(resource)).ok_or_else(|| self.missing(resource))?;
                Ok(Some(stack.layout.range(&stack.block, first, count)))
            }
        }
    }

    pub(super) fn missing(&self, resource: Resource) -> EngineError {
        EngineError::mismatch(format!("{} has no {resource:?}", self.kernel.name()))
    }

    /// Records one dispatch over these buffers.
    pub(super) fn run(
        &mut self,
        buffers: &[Range<'_>],
        args: &impl Pod,
        more: &[u32],
        groups: [u32; 3],
    ) -> Result<(), EngineError> {
        let missing = || EngineError::mismatch(format!("{} has no shader", self.kernel.name()));
        let module = self.module.ok_or_else(missing)?.stored(self.shape.halves());
        let (args, more) = (bytemuck::bytes_of(args), bytemuck::cast_slice::<_, u8>(more));
        let mut push = [0u8; PUSH_BYTES as usize];
        let length = args.len() + more.len();
        push[..args.len()].copy_from_slice(args);
        push[args.len()..length].copy_from_slice(more);
        let gpu = &mut *self.work.gpu;
        let limit = gpu.limits.storage_range;
        if let Some(large) = buffers.iter().find(|b| b.size > limit) {
            return Err(self.work.too_large(format!("a buffer of `{}`", module.name), large.size as usize));
        }
        // Kernels that read or write phases have a constant for their storage.
        let phases = |(_, r): &(Access, Resource)| r.per_frame() == Some(PerFrame::Pixels);
        let angles = self.shape.binary_angles && self.kernel.binds().iter().any(phases);
        let pipeline = gpu.pipeline(module, buffers.len() as u32, if angles { &[1] } else { &[] })?;
        let changes = self.kernel.writes().any(|resource| resource == Resource::Phases);
        let groups = self.work.guarded(groups, changes)?;
        let gpu = &mut *self.work.gpu;
        gpu.recorder.dispatch(pipeline, buffers, &push[..length], groups)?;
        self.say_moved(buffers);
        Ok(())
    }

    /// Reports the moves of the last dispatch. The number of frames follows from its ranges.
    fn say_moved(&self, buffers: &[Range<'_>]) {
        self.work.gpu.recorder.moved(|| {
            let pass = self.kernel.takes_pupil_passes().then(|| self.pass(self.at).mode(self.mode));
            let mut moves = Vec::new();
            for (range, bound) in buffers.iter().zip(self.kernel.binds()) {
                let frames = self.layout(bound.1).map_or(1, |layout| layout.frames_in(range.size));
                let whole = [range.size, 0];
                let [read, written] = moved(self.kernel, *bound, self.step, self.shape, pass, frames).unwrap_or(whole);
                moves.extend(range.moves(read, written));
            }
            moves
        });
    }

    /// Transforms the buffers that the kernel changes, over the grid.
    pub(super) fn grid_transform(&mut self, direction: Direction) -> Result<(), EngineError> {
        self.grid_transform_of(direction, self.step.columns)
    }

    /// Transforms them in these columns.
    pub(super) fn grid_transform_of(&mut self, direction: Direction, columns: Columns) -> Result<(), EngineError> {
        let place = &self.shape.place;
        let size = [place.grid_height as usize, place.grid_width as usize];
        for resource in self.kernel.writes() {
            let stack = self.work.stacks.find(resource).ok_or_else(|| self.missing(resource))?;
            let frames = frames_of(&stack.block, &stack.layout, size);
            self.work.transforms.record(self.work.gpu, frames, direction, columns, Along::Both)?;
        }
        Ok(())
    }

    /// Transforms a pupil pass's windows.
    pub(super) fn window_transform(&mut self, pass: &PupilPass, direction: Direction) -> Result<(), EngineError> {
        self.window_lines(pass, direction, Along::Both)
    }

    /// Transforms their rows, their columns, or both.
    pub(super) fn window_lines(
        &mut self,
        pass: &PupilPass,
        direction: Direction,
        along: Along,
    ) -> Result<(), EngineError> {
        let layout = self.layout(Resource::Window)?;
        let Some(range) = self.range(Resource::Window, 0, layout.frames)? else { return Ok(()) };
        let frames = frames_of(range.block, &layout, [pass.window.rows, pass.window.columns]);
        self.work.transforms.record(self.work.gpu, frames, direction, pass.columns, along)
    }
}

impl<'a> Work<'a> {
    pub(super) fn too_large(&self, what: impl Display, size: usize) -> EngineError {
        self.gpu.unsuitable(format!("{what} is too large for it ({size}). Use a smaller size"))
    }

    /// Returns the frames of a buffer that a kernel may bind at once.
    pub(super) fn at_once(&self, layout: &Layout) -> usize {
        layout.at_once(self.gpu.limits.storage_range)
    }

    /// Returns the number of frames, or rows, for one dispatch if each moves `bytes` bytes.
    pub(super) fn in_time(&self, bytes: u64) -> usize {
        usize::try_from(self.gpu.dispatch_bytes() / bytes.max(1)).unwrap_or(usize::MAX).max(1)
    }

    /// Returns chunks (first, count) of frames, of which a kernel may bind `most` at once.
    pub(super) fn chunks(&self, frames: usize, most: usize) -> impl Iterator<Item = (usize, usize)> + use<> {
        // A single frame that is too large is refused by name at its dispatch.
        let most = most.clamp(1, self.gpu.limits.groups[2] as usize);
        (0..frames).step_by(most).map(move |first| (first, most.min(frames - first)))
    }

    /// Returns the workgroups of a kernel over rows and columns.
    pub(super) fn rows(&self, rows: u32, columns: u32, frames: usize) -> [u32; 3] {
        let across = columns.div_ceil(WIDTH);
        [across, self.shared_out(rows, across * frames as u32, self.gpu.limits.groups[1]), frames as u32]
    }

    /// Returns the workgroups of a kernel over values.
    pub(super) fn along(&self, count: usize, frames: usize) -> [u32; 3] {
        let pieces = count.div_ceil(WIDTH as usize).min(u32::MAX as usize) as u32;
        [self.shared_out(pieces, frames as u32, self.gpu.limits.groups[0]), 1, frames as u32]
    }

    /// Returns the number of workgroups that share `pieces` of work, if `times` such loads run at once. They fill the
    /// device, and no more are used because each costs something to start.
    fn shared_out(&self, pieces: u32, times: u32, limit: u32) -> u32 {
        let enough = ENOUGH.div_ceil(times.max(1));
        // Shares are equal, in whole rounds of the kernel's loop.
        let rounds = (pieces / enough).clamp(1, 16);
        pieces.div_ceil(rounds).min(limit)
    }
}

pub(super) fn frames_of<'a>(block: &'a Block, layout: &Layout, [height, width]: [usize; 2]) -> Frames<'a> {
    let storage = if let Value::Complex(storage) = layout.value { storage } else { Storage::F32 };
    Frames { block, offset: layout.offset, count: layout.frames, height, width, stride: layout.stride(), storage }
}
