//! Runs lists of kernels on the CPU, with SIMD and all cores.
//!
//! It is the embedded default without a GPU, and the reference of the Vulkan engine.
//!
//! Neighboring kernels of one scope run depth first. A sub-frame, or a pupil, goes through all of them while it is in
//! the cache. Pupils, and the sub-frames of a large pupil, run in parallel. Sums have a fixed order, so the result
//! has the same bits for any number of threads.
//!
//! Fields stored as halves are for comparison. Values stay float32 in memory and are rounded to halves wherever a
//! kernel stores them, also between the axes of a transform. That takes longer than float32 and saves nothing.

mod account;
mod buffers;
mod clock;
mod floats;
mod frames;
mod pupil_pass;
mod twins;
mod waves;

use super::{
    Buffer, Dispatch, Engine, EngineError, Kernel, LookUp, ModelTables, ParallelTime, PupilPass, Resource, Scope,
    Shape, Step, Timing, misfit, not_kept, nothing_kept,
};
use crate::scene::Pyramid;
use buffers::{Buffers, ModelView, SPLIT, Slot, complex, complex_mut, storing, storing_drives};
use clock::Clock;
use eyebox_kernels::{Complex32, fft::Plans};
use frames::{Frame, FrameFft, Whole};
use pupil_pass::{Pass, WindowFrame};
use rayon::prelude::*;
use std::ops::Range;
use std::sync::Arc;
use twins::{Twin, twin};

/// Runs lists of kernels on the CPU.
pub struct CpuEngine {
    shape: Shape,
    views: Option<Arc<Pyramid>>,
    /// The model whose tables the buffers hold.
    model: Option<Arc<ModelTables>>,
    buffers: Buffers,
    plans: Plans,
    /// Scratch of transforms that use all threads together, and returned lists of losses.
    wide: Vec<Complex32>,
    spare: Vec<Vec<f64>>,
    clock: Clock,
    /// Runs before each part of a list. It may wait, count or fail.
    #[cfg(any(test, feature = "test-hooks"))]
    before_part: Option<Box<dyn FnMut() -> Result<(), EngineError> + Send>>,
}

/// Sub-frames under way at once.
const AT_ONCE: usize = 64;

/// Returns true if a kernel can use all threads for one sub-frame. The others use a thread per sub-frame.
fn uses_all_threads(kernel: Kernel) -> bool {
    use Kernel::{
        ChangeInverse, CrosstalkColumns, CrosstalkColumnsBack, CrosstalkRows, CrosstalkRowsBack, FieldForward,
        FromMask, SubpixelsForward, SubpixelsInverse, ToMask,
    };
    let blurs = [CrosstalkRows, CrosstalkColumns, CrosstalkColumnsBack, CrosstalkRowsBack];
    let transforms = [FieldForward, ChangeInverse, ToMask, FromMask, SubpixelsForward, SubpixelsInverse];
    blurs.contains(&kernel) || transforms.contains(&kernel)
}

impl CpuEngine {
    /// Makes an engine without buffers. [`load`](Engine::load) makes them.
    pub fn new() -> Self {
        Self {
            shape: Shape::empty(),
            views: None,
            model: None,
            buffers: Buffers::default(),
            plans: Plans::default(),
            wide: Vec::new(),
            spare: Vec::new(),
            clock: Clock::new(false),
            #[cfg(any(test, feature = "test-hooks"))]
            before_part: None,
        }
    }

    /// Makes an engine that runs `before_part` before each part of a list. It may wait, count or fail.
    #[cfg(any(test, feature = "test-hooks"))]
    pub fn watched(before_part: impl FnMut() -> Result<(), EngineError> + Send + 'static) -> Self {
        Self { before_part: Some(Box::new(before_part)), ..Self::new() }
    }

    /// Runs each frame through all of `group`.
    fn run_frames(&mut self, step: &Step, group: &[Dispatch]) {
        let Self { shape, buffers, plans, clock, wide: scratch, .. } = self;
        let (pixels, points) = (shape.pixels().max(1), shape.points().max(1));
        let wide = shape.frames < rayon::current_num_threads() && points >= SPLIT;
        let store = storing(shape.storage);
        let size = [shape.place.grid_height as usize, shape.place.grid_width as usize];
        let Buffers { phases, shown, levels, momentum, second, field, change, hits, energy, slots, .. } = buffers;
        let Buffers { wave, blurred, subpixels, pixels: table, crosstalk, offsets, mask, mask_transfer, .. } = buffers;
        let tables = ModelView::new(shape, table, crosstalk, offsets, [mask, mask_transfer]);
        let p = shape.subpixels();
        let [mut wave, mut blurred] =
            [(wave, p * p), (blurred, p)].map(|(buffer, planes)| buffer.chunks_exact_mut(planes * pixels));
        let mut subpixels = complex_mut(subpixels).chunks_exact_mut(p * p * points);
        let [mut phases, mut shown, mut momentum, mut second] =
            [phases, shown, momentum, second].map(|buffer| buffer.chunks_exact_mut(pixels));
        let [mut field, mut change] = [field, change].map(|buffer| complex_mut(buffer).chunks_exact_mut(points));
        let frame = |index| Frame {
            index,
            step,
            shape,
            passes: &[],
            slots,
            phases: phases.next().unwrap_or_default(),
            shown: shown.next().unwrap_or_default(),
            momentum: momentum.next().unwrap_or_default(),
            second: second.next().unwrap_or_default(),
            field: field.next().unwrap_or_default(),
            change: change.next().unwrap_or_default(),
            wave: wave.next().unwrap_or_default(),
            blurred: blurred.next().unwrap_or_default(),
            subpixels: subpixels.next().unwrap_or_default(),
            tables,
            crosstalk: shape.crosstalk(),
            levels,
            hits,
            energy,
            fft: FrameFft { plans, size, columns: step.columns, wide, scratch: Vec::new(), store },
            store,
            store_drives: storing_drives(shape.storage),
        };
        let mut frames = (0..shape.frames).map(frame);
        let run = |frame: &mut Frame<'_>, group: &[Dispatch]| {
            for dispatch in group {
                frame.passes = &frame.step.pupil_passes[dispatch.pupil_passes.clone()];
                if let Twin::Frames(twin) = twin(dispatch.kernel) {
                    clock.time(dispatch.kernel, || twin(frame));
                }
            }
        };
        loop {
            // These are on the stack, because a list would be allocated for every group of kernels.
            let mut some: [Option<Frame<'_>>; AT_ONCE] = std::array::from_fn(|_| frames.next());
            let count = some.iter().flatten().count();
            let mut rest = group;
            while let [first, ..] = rest {
                let one_by_one = |d: &Dispatch| wide && uses_all_threads(d.kernel);
                let alike = rest.iter().take_while(|d| one_by_one(d) == one_by_one(first)).count();
                let (now, later) = rest.split_at(alike);
                rest = later;
                if !one_by_one(first) {
                    clock.region(count, || {
                        some[..count].par_iter_mut().flatten().for_each(|frame| run(frame, now));
                    });
                    continue;
                }
                for frame in some.iter_mut().flatten() {
                    std::mem::swap(&mut frame.fft.scratch, scratch);
                    clock.region(size[0], || run(frame, now));
                    std::mem::swap(&mut frame.fft.scratch, scratch);
                }
            }
            if count < AT_ONCE {
                return;
            }
        }
    }

    /// Runs each pupil pass through all of `group`, which has one range of pupil passes.
    fn run_pupil_passes(&mut self, step: &Step, group: &[Dispatch]) -> Result<(), EngineError> {
        let pupil_passes = &step.pupil_passes[group[0].pupil_passes.clone()];
        let Self { shape, buffers: Buffers { slots, field, relay, .. }, plans, clock, views, .. } = self;
        if slots.len() < pupil_passes.len() {
            slots.resize_with(pupil_passes.len(), Slot::default);
        }
        let (views, relay) = (views.as_deref(), complex(relay));
        let looks = |d: &Dispatch| d.kernel.binds().iter().any(|(_, resource)| *resource == Resource::Views);
        if views.is_none() && group.iter().any(looks) {
            return Err(EngineError::mismatch("a step needs target images, but no views were loaded"));
        }
        let (frames, points, field) = (shape.frames, shape.points(), complex(field));
        let store = storing(shape.storage);
        let relays = |d: &Dispatch| d.kernel == Kernel::Relay;
        let odd = pupil_passes.iter().find(|pass| pass.last_source_mode() >= shape.model.relay);
        if let Some(pass) = odd.filter(|_| group.iter().any(relays)) {
            return Err(super::other_source(pass.last_source_mode() + 1, shape.model.relay));
        }
        let parts = |pass: &PupilPass| {
            let all = pass.mode_count() * frames;
            if all * pass.count() >= SPLIT { all } else { 1 }
        };
        let tasks = pupil_passes.iter().map(parts).sum();
        let each = |(slot, pass): (&mut Slot, &PupilPass)| {
            let mut rest = group;
            while let [first, ..] = rest {
                // Kernels that take one sub-frame at a time also run depth first.
                let framewise = rest.iter().take_while(|d| d.kernel.scope() == Scope::Windows).count();
                let (now, later) = rest.split_at(framewise.max(1));
                rest = later;
                now.iter().for_each(|dispatch| slot.fit(dispatch.kernel, pass, shape));
                if let Twin::PupilPasses(twin) = twin(first.kernel) {
                    clock.time(first.kernel, || twin(&mut Pass { pass, slot, shape, views, relay }));
                    continue;
                }
                let count = pass.count();
                let Slot { transfer, window, image, .. } = &mut *slot;
                let (transfer, window) = (complex(transfer), complex_mut(window));
                // Each index is one sub-frame of one mode of the source.
                let work = |i: usize, window: &mut [Complex32]| {
                    let (mode, index) = (i / frames, i % frames);
                    let (field, pass) = (&field[index * points..][..points], pass.mode(mode));
                    let transfer = &transfer[mode * count..][..count];
                    let mut frame = WindowFrame { index, pass, field, transfer, image, window, plans, store };
                    for dispatch in now {
                        if let Twin::Windows(twin) = twin(dispatch.kernel) {
                            clock.time(dispatch.kernel, || twin(&mut frame));
                        }
                    }
                };
                if window.len() >= SPLIT {
                    window.par_chunks_exact_mut(count).enumerate().for_each(|(f, w)| work(f, w));
                } else {
                    window.chunks_exact_mut(count).enumerate().for_each(|(f, w)| work(f, w));
                }
            }
        };
        clock.region(tasks, || slots.par_iter_mut().zip(pupil_passes).for_each(each));
        Ok(())
    }

    /// Runs these entries of a step's list, with neighbors of one scope together.
    fn run_list(&mut self, step: &Step, mut rest: &[Dispatch], losses: &mut [f64]) -> Result<(), EngineError> {
        while let [first, ..] = rest {
            let scope = first.kernel.scope();
            let same = |d: &&Dispatch| match scope {
                Scope::Whole => false,
                Scope::Frames => d.kernel.scope() == scope,
                _ => d.kernel.scope().is_per_pupil() && d.pupil_passes == first.pupil_passes,
            };
            let count = rest.iter().take_while(same).count().max(1);
            let (group, later) = rest.split_at(count);
            rest = later;
            group.iter().for_each(|dispatch| self.clock.account(dispatch, step, &self.shape));
            match scope {
                Scope::Whole => {
                    if !self.run_whole(step, first) {
                        losses.fill(f64::NAN);
                    }
                }
                Scope::Frames => self.run_frames(step, group),
                Scope::Windows | Scope::PupilPasses => {
                    self.run_pupil_passes(step, group)?;
                    if group.iter().any(|d| d.kernel.writes().any(|resource| resource == Resource::Losses)) {
                        for (loss, slot) in losses[first.pupil_passes.clone()].iter_mut().zip(&self.buffers.slots) {
                            *loss = slot.loss;
                        }
                    }
                }
            }
        }
        Ok(())
    }

    /// Runs once for all sub-frames. Returns false if a checked value is not finite.
    fn run_whole(&mut self, step: &Step, dispatch: &Dispatch) -> bool {
        let Buffers { field, change, hits, energy, wave, .. } = &mut self.buffers;
        let passes = &step.pupil_passes[dispatch.pupil_passes.clone()];
        let ([field, change], shape) = ([field, change].map(|buffer| complex_mut(buffer)), &self.shape);
        let mut whole = Whole { step, shape, passes, field, change, wave, hits, energy, finite: true };
        if let Twin::Whole(twin) = twin(dispatch.kernel) {
            // The threads share parts of all sub-frames.
            self.clock.region(usize::MAX, || self.clock.time(dispatch.kernel, || twin(&mut whole)));
        }
        whole.finite
    }
}

impl Default for CpuEngine {
    fn default() -> Self {
        Self::new()
    }
}

impl Engine for CpuEngine {
    fn lists(&self) -> &'static str {
        "neighboring kernels depth first"
    }

    fn describe(&self) -> String {
        format!("CPU, {} threads, {}", rayon::current_num_threads(), eyebox_kernels::simd_name())
    }

    fn load(&mut self, shape: &Shape, views: Option<Arc<Pyramid>>) -> Result<(), EngineError> {
        super::check_shape(shape, 8)?;
        (self.views, self.model) = (views.map(|views| super::on_host(&views)).transpose()?, None);
        self.shape = *shape;
        self.buffers.load(shape)
    }

    fn take_views(&mut self, views: Arc<Pyramid>) -> Result<(), EngineError> {
        self.views = Some(super::on_host(&views)?);
        Ok(())
    }

    fn write(&mut self, buffer: Buffer, data: &[f32]) -> Result<(), EngineError> {
        self.buffers.write(buffer, data, &self.shape)
    }

    fn read(&mut self, buffer: Buffer) -> Result<Vec<f32>, EngineError> {
        self.buffers.read(buffer).map(<[f32]>::to_vec)
    }

    fn read_into(&mut self, buffer: Buffer, to: &mut [f32]) -> Result<(), EngineError> {
        let data = self.buffers.read(buffer)?;
        if data.len() != to.len() {
            return Err(misfit(buffer, data.len(), to.len()));
        }
        to.copy_from_slice(data);
        Ok(())
    }

    fn keep(&mut self, buffer: Buffer) -> Result<(), EngineError> {
        let from = match buffer {
            Buffer::Phases => &self.buffers.phases,
            Buffer::Shown => &self.buffers.shown,
            _ => return Err(not_kept(buffer)),
        };
        self.buffers.kept.set(from);
        Ok(())
    }

    fn kept(&mut self) -> Result<Vec<f32>, EngineError> {
        if self.buffers.kept.is_empty() { Err(nothing_kept()) } else { Ok(self.buffers.kept.to_vec()) }
    }

    fn restore(&mut self) -> Result<(), EngineError> {
        let Buffers { phases, kept, .. } = &mut self.buffers;
        if kept.is_empty() {
            return Err(nothing_kept());
        }
        phases.copy_from_slice(kept);
        self.clear_moments()
    }

    fn look_up(&mut self, of: &LookUp) -> Result<(), EngineError> {
        // The phases are whole binary angles, which every shape stores exactly.
        let phases = &mut self.buffers.phases;
        if phases.len() != of.count() {
            return Err(misfit(Buffer::Phases, phases.len(), of.count()));
        }
        of.phases_into(phases)
    }

    fn clear_moments(&mut self) -> Result<(), EngineError> {
        let Buffers { momentum, second, .. } = &mut self.buffers;
        [momentum, second].into_iter().for_each(|of| of.par_chunks_mut(SPLIT).for_each(|some| some.fill(0.0)));
        Ok(())
    }

    fn run_part(&mut self, step: &Step, part: Range<usize>) -> Result<Vec<f64>, EngineError> {
        #[cfg(any(test, feature = "test-hooks"))]
        self.before_part.as_mut().map_or(Ok(()), |before| before())?;
        if let Some(model) = step.model.as_ref().filter(|m| self.model.as_ref().is_none_or(|had| !Arc::ptr_eq(had, m)))
        {
            model.buffers().try_for_each(|(buffer, table)| self.write(buffer, table))?;
            self.model = Some(Arc::clone(model));
        }
        let mut losses = self.spare.pop().unwrap_or_default();
        losses.clear();
        losses.resize(step.pupil_passes.len(), 0.0);
        let list = &step.list[part];
        if !list.is_empty() {
            // The list runs on the computing threads from here, so that they receive it once and not kernel by
            // kernel.
            rayon::scope(|_| self.run_list(step, list, &mut losses))?;
        }
        Ok(losses)
    }

    fn recycle(&mut self, losses: Vec<f64>) {
        self.spare.push(losses);
    }

    /// Makes plans of transforms, and reserves room for any of these pupil passes. The room takes no memory before
    /// its use.
    fn prepare(&mut self, steps: &mut dyn Iterator<Item = Step>, at_once: Option<usize>) -> Result<(), EngineError> {
        for step in steps {
            let count = at_once.unwrap_or(0);
            let Self { shape, buffers, plans, .. } = self;
            if buffers.slots.len() < count {
                buffers.slots.resize_with(count, Slot::default);
            }
            for pass in &step.pupil_passes {
                plans.prepare([pass.window.rows, pass.window.columns]);
                buffers.slots[..count].iter_mut().for_each(|slot| slot.reserve(pass, shape));
            }
        }
        Ok(())
    }

    fn time_kernels(&mut self, on: bool) {
        self.clock.accounts = on;
    }

    fn timings(&self) -> Vec<Timing> {
        self.clock.timings()
    }

    fn parallel_time(&self) -> Option<ParallelTime> {
        Some(self.clock.parallel_time())
    }

    fn reset_timings(&mut self) {
        self.clock = Clock::new(self.clock.accounts);
    }
}
