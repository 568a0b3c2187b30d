//! From an entry of the list to dispatches: bindings in the order of the twins' slices, arguments as push constants.

mod photograph;

use super::super::{Buffer, Dispatch, EngineError, Kernel, PupilPass, Shape, Step, Storage};
use super::fft::{Frames, Transform};
use super::layout::{Arenas, Kind, Layout, Slot, Value};
use super::tables::Tables;
use super::views::Views;
use crate::gpu::{Block, Commands, Range};
use bytemuck::Pod;
use eyebox_kernels::fft::Direction;
use eyebox_spirv as spirv;

/// Pixels whose loss a workgroup of `compare` sums.
const SHARE: usize = 2048;
/// Columns or pixels of a workgroup, as all shaders but `compare` and `exposure` have it.
const WIDTH: usize = 64;

/// Workgroups that fill any device a few times over.
const ENOUGH: u32 = 4096;
/// Values, over all sub-frames, that a workgroup of `energy` adds up at once: 4096 to an invocation.
const ENERGY_SHARE: u32 = 4096 * 128;

/// A buffer of the shape.
pub(super) struct Stack {
    pub(super) layout: Layout,
    pub(super) block: Block,
}

/// The buffers of the shape, those that its purpose needs.
#[derive(Default)]
pub(super) struct Stacks(pub(super) [Option<Stack>; 9]);

impl Stacks {
    /// Where a buffer stands, if it is not a pupil pass's.
    pub(super) fn index(buffer: Buffer) -> Option<usize> {
        Some(match buffer {
            Buffer::Phases => 0,
            Buffer::Momentum => 1,
            Buffer::Second => 2,
            Buffer::Field => 3,
            Buffer::Change => 4,
            Buffer::Hits => 5,
            Buffer::Energy => 6,
            Buffer::Shown => 7,
            Buffer::Levels => 8,
            _ => return None,
        })
    }

    /// The phases that make the field.
    fn shown(&self, shape: &Shape) -> Result<&Stack, EngineError> {
        self.get(if shape.quantised { Buffer::Shown } else { Buffer::Phases })
    }

    pub(super) fn get(&self, buffer: Buffer) -> Result<&Stack, EngineError> {
        let stack = Self::index(buffer).and_then(|i| self.0[i].as_ref());
        stack.ok_or_else(|| EngineError::Mismatch { reason: format!("{buffer:?} is not made for this purpose") })
    }
}

/// Sums of the loss that a pupil pass's `compare` leaves.
pub(super) fn loss_parts(pupil_pass: &PupilPass) -> usize {
    pupil_pass.count().div_ceil(SHARE)
}

/// Everything that a recording looks at.
pub(super) struct Work<'a> {
    pub(super) gpu: &'a mut Commands,
    pub(super) transforms: &'a mut dyn Transform,
    pub(super) shape: &'a Shape,
    pub(super) step: &'a Step,
    pub(super) stacks: &'a Stacks,
    pub(super) arenas: &'a Arenas,
    pub(super) tables: &'a Tables,
    pub(super) views: Option<&'a Views>,
    /// Where each pupil pass's sums of the loss start, bytes.
    pub(super) losses: Option<(&'a Block, &'a [u64])>,
}

impl Work<'_> {
    /// Makes the plans and tables of all transforms in these entries.
    pub(super) fn prepare(&mut self, list: &[Dispatch]) -> Result<(), EngineError> {
        let (gh, gw) = (self.shape.place.grid_height as usize, self.shape.place.grid_width as usize);
        let storage = self.shape.storage;
        for dispatch in list {
            match dispatch.kernel {
                Kernel::FieldForward | Kernel::ChangeInverse => self.transforms.prepare(self.gpu, [gh, gw], storage)?,
                Kernel::WindowForward | Kernel::WindowInverse => {
                    for pupil_pass in &self.step.pupil_passes[dispatch.pupil_passes.clone()] {
                        self.transforms.prepare(
                            self.gpu,
                            [pupil_pass.window.rows, pupil_pass.window.columns],
                            storage,
                        )?;
                    }
                }
                _ => {}
            }
        }
        Ok(())
    }

    /// Records one entry of the list; the caller sets the barriers around it.
    pub(super) fn record(&mut self, dispatch: &Dispatch, slots: &[Slot]) -> Result<(), EngineError> {
        let first = dispatch.pupil_passes.start;
        let step = self.step;
        let pupil_passes = || step.pupil_passes[dispatch.pupil_passes.clone()].iter().zip(slots).enumerate();
        match dispatch.kernel {
            Kernel::Clear => self.clear(),
            Kernel::Quantise => self.quantise(),
            Kernel::Modulate => self.modulate(),
            Kernel::FieldForward => self.transform(Buffer::Field, Direction::Forward),
            Kernel::ChangeInverse => self.transform(Buffer::Change, Direction::Inverse),
            Kernel::DivideByOverlap => self.divide_by_overlap(),
            Kernel::Energy => self.energy(),
            Kernel::EqualiseEyebox => self.equalise_eyebox(),
            Kernel::CheckFinite => self.check_finite(),
            Kernel::Project => self.project(),
            Kernel::Adam => self.adam(),
            Kernel::Photograph => self.photograph(dispatch, slots),
            Kernel::Overlap => pupil_passes().try_for_each(|(i, (pupil_pass, _))| self.overlap(first + i, pupil_pass)),
            Kernel::ReturnPupil => {
                pupil_passes().try_for_each(|(i, (pupil_pass, slot))| self.return_pupil(first + i, pupil_pass, slot))
            }
            Kernel::Transfer => {
                pupil_passes().try_for_each(|(i, (pupil_pass, slot))| self.transfer(first + i, pupil_pass, slot))
            }
            Kernel::Taper => {
                pupil_passes().try_for_each(|(i, (pupil_pass, slot))| self.taper(first + i, pupil_pass, slot))
            }
            Kernel::Resample => {
                pupil_passes().try_for_each(|(i, (pupil_pass, slot))| self.resample(first + i, pupil_pass, slot))
            }
            Kernel::PassPupil => {
                pupil_passes().try_for_each(|(i, (pupil_pass, slot))| self.pass_pupil(first + i, pupil_pass, slot))
            }
            Kernel::Compare => {
                pupil_passes().try_for_each(|(i, (pupil_pass, slot))| self.compare(first + i, pupil_pass, slot))
            }
            Kernel::Intensity => {
                pupil_passes().try_for_each(|(_, (pupil_pass, slot))| self.intensity(pupil_pass, slot))
            }
            Kernel::Exposure => pupil_passes().try_for_each(|(_, (pupil_pass, slot))| self.exposure(pupil_pass, slot)),
            Kernel::ApplyFactor => {
                pupil_passes().try_for_each(|(_, (pupil_pass, slot))| self.apply_factor(pupil_pass, slot))
            }
            Kernel::WindowInverse | Kernel::WindowForward => {
                let direction = window_direction(dispatch.kernel);
                pupil_passes()
                    .try_for_each(|(_, (pupil_pass, slot))| self.window_transform(pupil_pass, slot, direction))
            }
        }
    }

    fn clear(&mut self) -> Result<(), EngineError> {
        let stacks = self.stacks;
        for stack in [Buffer::Change, Buffer::Hits].into_iter().filter_map(|b| stacks.get(b).ok()) {
            self.gpu.recorder.clear(stack.block.all());
        }
        Ok(())
    }

    fn quantise(&mut self) -> Result<(), EngineError> {
        let (phases, shown) = (self.stacks.get(Buffer::Phases)?, self.stacks.get(Buffer::Shown)?);
        let levels = self.stacks.get(Buffer::Levels)?;
        for (first, count) in self.chunks(self.shape.frames, &[&phases.layout]) {
            let buffers = [
                phases.layout.range(&phases.block, first, count),
                levels.layout.range(&levels.block, 0, 1),
                shown.layout.range(&shown.block, first, count),
            ];
            let groups = self.along(phases.layout.values, count);
            let more = [phases.layout.stride() as u32];
            self.run(&spirv::QUANTISE, &buffers, &self.step.quantise, &more, groups)?;
        }
        Ok(())
    }

    fn modulate(&mut self) -> Result<(), EngineError> {
        let stacks = self.stacks;
        let (phases, field) = (stacks.shown(self.shape)?, stacks.get(Buffer::Field)?);
        let place = &self.shape.place;
        let strides = [phases, field].map(|s| s.layout.stride() as u32);
        let more = [strides[0], strides[1], self.shape.field_scale().to_bits()];
        self.over_frames(
            self.stored(&spirv::MODULATE),
            &[phases, field],
            place,
            &more,
            place.grid_height,
            place.grid_width,
        )
    }

    fn divide_by_overlap(&mut self) -> Result<(), EngineError> {
        let (hits, change) = (self.stacks.get(Buffer::Hits)?, self.stacks.get(Buffer::Change)?);
        let layout = &change.layout;
        let more = [layout.stride() as u32];
        for (first, count) in self.chunks(layout.frames, &[layout]) {
            let buffers = [hits.layout.range(&hits.block, 0, 1), layout.range(&change.block, first, count)];
            let groups = self.along(layout.values, count);
            self.run(self.stored(&spirv::DIVIDE_BY_OVERLAP), &buffers, &self.step.divide_by_overlap, &more, groups)?;
        }
        Ok(())
    }

    fn energy(&mut self) -> Result<(), EngineError> {
        let (field, energy) = (self.stacks.get(Buffer::Field)?, self.stacks.get(Buffer::Energy)?);
        let layout = &field.layout;
        let place = self.step.equalise_eyebox.place;
        let values = place.rows.div_ceil(place.patches) * place.columns.div_ceil(place.patches);
        for (first, count) in self.chunks(layout.frames, &[layout]) {
            let share = (ENERGY_SHARE / count as u32).max(1);
            for begin in (0..values).step_by(share as usize) {
                let mut args = place;
                let later = first > 0 || begin > 0;
                args.accumulate |= u32::from(later);
                if later {
                    self.gpu.recorder.barrier();
                }
                let buffers = [layout.range(&field.block, first, count), energy.layout.range(&energy.block, 0, 1)];
                let more = [count as u32, layout.stride() as u32, begin, begin.saturating_add(share)];
                self.run(self.stored(&spirv::ENERGY), &buffers, &args, &more, [args.patches * args.patches, 1, 1])?;
            }
        }
        Ok(())
    }

    fn equalise_eyebox(&mut self) -> Result<(), EngineError> {
        let (field, change) = (self.stacks.get(Buffer::Field)?, self.stacks.get(Buffer::Change)?);
        let energy = self.stacks.get(Buffer::Energy)?;
        let place = self.step.equalise_eyebox.place;
        let more = [field.layout.stride() as u32, change.layout.stride() as u32];
        for (first, count) in self.chunks(self.shape.frames, &[&field.layout, &change.layout]) {
            let buffers = [
                energy.layout.range(&energy.block, 0, 1),
                field.layout.range(&field.block, first, count),
                change.layout.range(&change.block, first, count),
            ];
            let groups = self.rows(place.rows, place.columns, count);
            self.run(self.stored(&spirv::EQUALISE_EYEBOX), &buffers, &self.step.equalise_eyebox, &more, groups)?;
        }
        Ok(())
    }

    fn check_finite(&mut self) -> Result<(), EngineError> {
        let change = self.stacks.get(Buffer::Change)?;
        let Some((block, _)) = self.losses else { return Ok(()) };
        let found = block.range(0, 4);
        self.gpu.recorder.clear(found);
        self.gpu.recorder.barrier();
        let layout = &change.layout;
        for (first, count) in self.chunks(layout.frames, &[layout]) {
            if first > 0 {
                self.gpu.recorder.barrier();
            }
            let args = [layout.values as u32, layout.stride() as u32];
            let groups = self.along(layout.values, count);
            self.run(&spirv::CHECK_FINITE, &[layout.range(&change.block, first, count), found], &args, &[], groups)?;
        }
        Ok(())
    }

    fn project(&mut self) -> Result<(), EngineError> {
        let change = self.stacks.get(Buffer::Change)?;
        let (phases, velocity) = (self.stacks.get(Buffer::Phases)?, self.stacks.get(Buffer::Momentum)?);
        let place = &self.shape.place;
        let more = [change.layout.stride() as u32, phases.layout.stride() as u32];
        let stacks = [change, self.stacks.shown(self.shape)?, phases, velocity];
        self.over_frames(self.stored(&spirv::PROJECT), &stacks, &self.step.project, &more, place.height, place.width)
    }

    fn adam(&mut self) -> Result<(), EngineError> {
        let change = self.stacks.get(Buffer::Change)?;
        let (phases, first) = (self.stacks.get(Buffer::Phases)?, self.stacks.get(Buffer::Momentum)?);
        let second = self.stacks.get(Buffer::Second)?;
        let place = &self.shape.place;
        let more = [change.layout.stride() as u32, phases.layout.stride() as u32];
        let stacks = [change, self.stacks.shown(self.shape)?, phases, first, second];
        self.over_frames(self.stored(&spirv::ADAM), &stacks, &self.step.adam, &more, place.height, place.width)
    }

    fn transform(&mut self, buffer: Buffer, direction: Direction) -> Result<(), EngineError> {
        let stack = self.stacks.get(buffer)?;
        let (height, width) = (self.shape.place.grid_height as usize, self.shape.place.grid_width as usize);
        let frames = frames_of(&stack.block, &stack.layout, height, width);
        self.transforms.record(self.gpu, frames, direction, self.step.columns)
    }

    fn window_transform(
        &mut self,
        pupil_pass: &PupilPass,
        slot: &Slot,
        direction: Direction,
    ) -> Result<(), EngineError> {
        let block = self.arenas.range(Kind::Window, slot)?.block;
        let frames = frames_of(block, &slot[Kind::Window as usize], pupil_pass.window.rows, pupil_pass.window.columns);
        self.transforms.record(self.gpu, frames, direction, pupil_pass.columns)
    }

    fn transfer(&mut self, index: usize, pupil_pass: &PupilPass, slot: &Slot) -> Result<(), EngineError> {
        let args = &pupil_pass.transfer;
        let pair = |x: f64| [x as f32, (x - f64::from(x as f32)) as f32];
        let [slope_y, slope_x, turns] = [args.slope_y, args.slope_x, args.turns].map(pair);
        let floats: [f32; 6] = [slope_y[0], slope_y[1], slope_x[0], slope_x[1], turns[0], turns[1]];
        let more = [args.y0 as u32, args.x0 as u32, args.rows, args.columns];
        let spans = self.tables.range(self.tables.pupil_pass(index).spans)?;
        let groups = self.rows(args.rows, args.columns, 1);
        self.run(&spirv::TRANSFER, &[spans, self.arenas.range(Kind::Transfer, slot)?], &floats, &more, groups)
    }

    fn taper(&mut self, index: usize, pupil_pass: &PupilPass, slot: &Slot) -> Result<(), EngineError> {
        let Some(place) = self.tables.pupil_pass(index).taper else { return Ok(()) };
        let (rows, columns) = (pupil_pass.transfer.rows, pupil_pass.transfer.columns);
        let buffers = [self.tables.range(place)?, self.arenas.range(Kind::Transfer, slot)?];
        let groups = self.rows(rows, columns, 1);
        self.run(&spirv::TAPER, &buffers, &[rows, columns], &[], groups)
    }

    fn pass_pupil(&mut self, index: usize, pupil_pass: &PupilPass, slot: &Slot) -> Result<(), EngineError> {
        let field = self.stacks.get(Buffer::Field)?;
        let (tables, arenas) = (self.tables, self.arenas);
        let spans = tables.range(tables.pupil_pass(index).spans)?;
        let window = &slot[Kind::Window as usize];
        let more = [field.layout.stride() as u32, window.stride() as u32];
        for (first, count) in self.chunks(window.frames, &[&field.layout, window]) {
            let buffers = [
                field.layout.range(&field.block, first, count),
                arenas.range(Kind::Transfer, slot)?,
                spans,
                arenas.frames(Kind::Window, slot, first, count)?,
            ];
            let groups = self.rows(pupil_pass.pass.rows, pupil_pass.pass.columns, count);
            self.run(self.stored(&spirv::PASS_PUPIL), &buffers, &pupil_pass.pass, &more, groups)?;
        }
        Ok(())
    }

    fn return_pupil(&mut self, index: usize, pupil_pass: &PupilPass, slot: &Slot) -> Result<(), EngineError> {
        let change = self.stacks.get(Buffer::Change)?;
        let (tables, arenas) = (self.tables, self.arenas);
        let spans = tables.range(tables.pupil_pass(index).spans)?;
        let window = &slot[Kind::Window as usize];
        let more = [change.layout.stride() as u32, window.stride() as u32];
        // Pupil passes add to the same values: one after the other, in their order.
        self.gpu.recorder.barrier();
        for (first, count) in self.chunks(window.frames, &[&change.layout, window]) {
            let buffers = [
                arenas.frames(Kind::Window, slot, first, count)?,
                arenas.range(Kind::Transfer, slot)?,
                spans,
                change.layout.range(&change.block, first, count),
            ];
            let groups = self.rows(pupil_pass.back.rows, pupil_pass.back.columns, count);
            self.run(self.stored(&spirv::RETURN_PUPIL), &buffers, &pupil_pass.back, &more, groups)?;
        }
        Ok(())
    }

    fn overlap(&mut self, index: usize, pupil_pass: &PupilPass) -> Result<(), EngineError> {
        let hits = self.stacks.get(Buffer::Hits)?;
        let spans = self.tables.range(self.tables.pupil_pass(index).spans)?;
        let groups = self.rows(pupil_pass.pass.rows, pupil_pass.pass.columns, 1);
        self.gpu.recorder.barrier();
        self.run(&spirv::OVERLAP, &[spans, hits.layout.range(&hits.block, 0, 1)], &pupil_pass.pass, &[], groups)
    }

    fn intensity(&mut self, pupil_pass: &PupilPass, slot: &Slot) -> Result<(), EngineError> {
        let arenas = self.arenas;
        let window = &slot[Kind::Window as usize];
        let groups = self.along(pupil_pass.count(), 1);
        for (first, count) in self.chunks(window.frames, &[window]) {
            let mut args = pupil_pass.intensity;
            args.frames = count as u32;
            args.accumulate |= u32::from(first > 0);
            if first > 0 {
                self.gpu.recorder.barrier();
            }
            let buffers = [arenas.frames(Kind::Window, slot, first, count)?, arenas.range(Kind::Image, slot)?];
            self.run(self.stored(&spirv::INTENSITY), &buffers, &args, &[window.stride() as u32], groups)?;
        }
        Ok(())
    }

    fn compare(&mut self, index: usize, pupil_pass: &PupilPass, slot: &Slot) -> Result<(), EngineError> {
        let Some((block, offsets)) = self.losses else { return Ok(()) };
        let arenas = self.arenas;
        let parts = loss_parts(pupil_pass);
        if parts > self.gpu.limits().groups[0] as usize {
            return Err(self.too_large("an image", pupil_pass.count()));
        }
        let buffers = [
            arenas.range(Kind::Image, slot)?,
            arenas.range(Kind::Target, slot)?,
            block.range(offsets[index], 4 * parts as u64),
        ];
        self.run(&spirv::COMPARE, &buffers, &pupil_pass.compare, &[], [parts as u32, 1, 1])
    }

    fn exposure(&mut self, pupil_pass: &PupilPass, slot: &Slot) -> Result<(), EngineError> {
        let (arenas, args) = (self.arenas, pupil_pass.exposure(&self.shape.place));
        let parts = args.parts();
        if parts > self.gpu.limits().groups[0] as usize {
            return Err(self.too_large("an image", pupil_pass.count()));
        }
        let buffers = [Kind::Image, Kind::Target, Kind::Sums].map(|kind| arenas.range(kind, slot));
        let [image, target, sums] = buffers;
        self.run(&spirv::EXPOSURE, &[image?, target?, sums?], &args, &[], [parts as u32, 1, 1])
    }

    fn apply_factor(&mut self, pupil_pass: &PupilPass, slot: &Slot) -> Result<(), EngineError> {
        let arenas = self.arenas;
        let window = &slot[Kind::Window as usize];
        let args = [pupil_pass.count() as u32, window.stride() as u32];
        for (first, count) in self.chunks(window.frames, &[window]) {
            let buffers = [arenas.range(Kind::Image, slot)?, arenas.frames(Kind::Window, slot, first, count)?];
            let groups = self.along(pupil_pass.count(), count);
            self.run(self.stored(&spirv::APPLY_FACTOR), &buffers, &args, &[], groups)?;
        }
        Ok(())
    }

    /// The variant of a module for how fields are stored.
    fn stored(&self, module: &'static spirv::Module) -> &'static spirv::Module {
        stored(module, self.shape.storage)
    }

    /// A kernel over rows and columns of all frames of some buffers of the shape.
    fn over_frames(
        &mut self,
        module: &'static spirv::Module,
        stacks: &[&Stack],
        args: &impl Pod,
        more: &[u32],
        rows: u32,
        columns: u32,
    ) -> Result<(), EngineError> {
        let layouts: Vec<&Layout> = stacks.iter().map(|s| &s.layout).collect();
        for (first, count) in self.chunks(self.shape.frames, &layouts) {
            let buffers: Vec<Range<'_>> = stacks.iter().map(|s| s.layout.range(&s.block, first, count)).collect();
            let groups = self.rows(rows, columns, count);
            self.run(module, &buffers, args, more, groups)?;
        }
        Ok(())
    }

    fn run(
        &mut self,
        module: &'static spirv::Module,
        buffers: &[Range<'_>],
        args: &impl Pod,
        more: &[u32],
        groups: [u32; 3],
    ) -> Result<(), EngineError> {
        let (args, more) = (bytemuck::bytes_of(args), bytemuck::cast_slice::<_, u8>(more));
        let mut push = [0u8; crate::gpu::PUSH_BYTES as usize];
        let length = args.len() + more.len();
        push[..args.len()].copy_from_slice(args);
        push[args.len()..length].copy_from_slice(more);
        let limit = self.gpu.limits().storage_range;
        if let Some(large) = buffers.iter().find(|b| b.size > limit) {
            return Err(self.too_large("a buffer of `".to_owned() + module.name + "`", large.size as usize));
        }
        let pipeline = self.gpu.pipeline(module, buffers.len() as u32, &[])?;
        self.gpu.recorder.dispatch(pipeline, buffers, &push[..length], groups)
    }

    fn too_large(&self, what: impl Into<String>, size: usize) -> EngineError {
        EngineError::Unsuitable {
            device: self.gpu.report().name.clone(),
            reason: format!("{} is too large for it ({size}); use a smaller size", what.into()),
        }
    }

    /// Frames (first, count) that a kernel may see at once in all of these buffers.
    fn chunks(&self, frames: usize, layouts: &[&Layout]) -> impl Iterator<Item = (usize, usize)> + use<> {
        let limits = self.gpu.limits();
        let most = layouts.iter().map(|l| l.at_once(limits.storage_range)).min().unwrap_or(1);
        // A single frame that is too large is found, and named, when it is dispatched.
        let most = most.clamp(1, limits.groups[2] as usize);
        (0..frames).step_by(most).map(move |first| (first, most.min(frames - first)))
    }

    /// Workgroups of a kernel over rows and columns.
    fn rows(&self, rows: u32, columns: u32, frames: usize) -> [u32; 3] {
        let across = columns.div_ceil(WIDTH as u32);
        [across, self.shared_out(rows, across * frames as u32, self.gpu.limits().groups[1]), frames as u32]
    }

    /// Workgroups of a kernel over values.
    fn along(&self, count: usize, frames: usize) -> [u32; 3] {
        let pieces = count.div_ceil(WIDTH).min(u32::MAX as usize) as u32;
        [self.shared_out(pieces, frames as u32, self.gpu.limits().groups[0]), 1, frames as u32]
    }

    /// How many workgroups share `pieces` of work, of which there are `times` beside each other: enough to fill the
    /// device, and no more, for each costs something to start.
    fn shared_out(&self, pieces: u32, times: u32, limit: u32) -> u32 {
        let enough = ENOUGH.div_ceil(times.max(1));
        // Equal shares: whole rounds of the kernel's loop.
        let rounds = (pieces / enough).clamp(1, 16);
        pieces.div_ceil(rounds).min(limit)
    }
}

/// The variant of a module for fields stored so.
pub(super) fn stored(module: &'static spirv::Module, storage: Storage) -> &'static spirv::Module {
    match storage {
        Storage::F32 => module,
        Storage::F16 => module.half.unwrap_or(module),
    }
}

fn window_direction(kernel: Kernel) -> Direction {
    if kernel == Kernel::WindowForward { Direction::Forward } else { Direction::Inverse }
}

fn frames_of<'a>(block: &'a Block, layout: &Layout, height: usize, width: usize) -> Frames<'a> {
    let storage = if let Value::Complex(storage) = layout.value { storage } else { Storage::F32 };
    Frames { block, offset: layout.offset, count: layout.frames, height, width, stride: layout.stride(), storage }
}
