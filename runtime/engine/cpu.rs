//! The CPU engine: RustFFT, all cores, SIMD. The embedded default where there is no GPU, and what the Vulkan engine
//! is compared with.
//!
//! Neighbouring kernels of one scope run depth first: a sub-frame (or a pupil) goes through all of them while it is in
//! the cache. Pupils, and the sub-frames of a large pupil, run in parallel; sums are in a fixed order, so the result is
//! the same bits for any number of threads.
//!
//! Fields stored as halves are for comparison: values stay float32 in memory and are rounded to halves wherever a kernel
//! stores them, between the axes of a transform too. That takes longer than float32 and saves nothing.

mod pupil_pass;

use super::{
    Buffer, Dispatch, Engine, EngineError, Kernel, PupilPass, Purpose, Scope, Shape, Step, Storage, Timing, misfit,
};
use crate::scene::Pyramid;
use eyebox_kernels::{
    Complex32, ZERO, adam,
    apply_factor::apply_factor,
    check_finite::check_finite,
    divide_by_overlap, energy, equalise_eyebox,
    fft::{Direction, Plans, Store},
    half,
    modulate::modulate,
    overlap::overlap,
    pass_pupil::pass_pupil,
    project::project,
    quantise::{self, quantise},
    return_pupil::return_pupil,
};
use pupil_pass::run_pupil_pass;
use rayon::prelude::*;
use std::sync::{
    Arc,
    atomic::{AtomicU64, Ordering::Relaxed},
};
use std::time::Instant;

/// Buffers of one pupil, grown to the largest that it has held.
#[derive(Default)]
struct Slot {
    transfer: Vec<Complex32>,
    window: Vec<Complex32>,
    image: Vec<f32>,
    target: Vec<f32>,
    accumulator: Vec<f32>,
    sums: Vec<f32>,
    scratch: Vec<f32>,
    loss: f64,
}

/// Calls and nanoseconds per kernel.
#[derive(Default)]
struct Clock([(AtomicU64, AtomicU64); Kernel::ALL.len()]);

impl Clock {
    fn time<R>(&self, kernel: Kernel, work: impl FnOnce() -> R) -> R {
        let start = Instant::now();
        let result = work();
        let (calls, nanoseconds) = &self.0[kernel as usize];
        calls.fetch_add(1, Relaxed);
        nanoseconds.fetch_add(start.elapsed().as_nanos() as u64, Relaxed);
        result
    }
}

/// Runs lists of kernels on the CPU.
pub struct CpuEngine {
    shape: Shape,
    views: Option<Arc<Pyramid>>,
    phases: Vec<f32>,
    shown: Vec<f32>,
    levels: Vec<f32>,
    momentum: Vec<f32>,
    second: Vec<f32>,
    field: Vec<Complex32>,
    change: Vec<Complex32>,
    hits: Vec<f32>,
    energy: Vec<f32>,
    slots: Vec<Slot>,
    plans: Plans,
    clock: Clock,
}

/// Windows with fewer values in all than this are not worth splitting over threads.
const SPLIT: usize = 1 << 15;
/// Values of the buffer `Energy`.
const ENERGIES: usize = (energy::MOST * energy::MOST) as usize;

impl CpuEngine {
    /// An engine without buffers: [`load`](Engine::load) makes them.
    pub fn new() -> Self {
        let place = bytemuck::Zeroable::zeroed();
        Self {
            shape: Shape { frames: 0, place, purpose: Purpose::View, quantised: false, storage: Storage::F32 },
            views: None,
            phases: Vec::new(),
            shown: Vec::new(),
            levels: Vec::new(),
            momentum: Vec::new(),
            second: Vec::new(),
            field: Vec::new(),
            change: Vec::new(),
            hits: Vec::new(),
            energy: Vec::new(),
            slots: Vec::new(),
            plans: Plans::default(),
            clock: Clock::default(),
        }
    }

    /// Frame by frame through all of `group`.
    fn run_frames(&mut self, step: &Step, group: &[Dispatch]) {
        let Self {
            shape,
            phases,
            shown,
            levels,
            momentum,
            second,
            field,
            change,
            hits,
            energy,
            slots,
            plans,
            clock,
            ..
        } = self;
        let (pixels, points) = (shape.pixels(), shape.points());
        let wide = shape.frames < rayon::current_num_threads() && points >= SPLIT;
        // Buffers that this purpose lacks, and those that none of these kernels writes, become empty frames.
        let frames = shape.frames;
        let phases = frames_of(phases, pixels, frames);
        let shown = frames_of(shown, pixels, frames);
        let momentum = frames_of(momentum, pixels, frames);
        let second = frames_of(second, pixels, frames);
        let field = frames_of(field, points, frames);
        let change = frames_of(change, points, frames);
        let mut all: Vec<_> = phases.into_iter().zip(shown).zip(momentum).zip(second).zip(field).zip(change).collect();
        let (levels, hits, energy, slots) = (&*levels, &*hits, &*energy, &*slots);
        let (store, scale) = (storing(shape.storage), shape.field_scale());
        let run = |f: usize,
                   (((((phases, shown), momentum), second), field), change): FrameBuffers,
                   turned: &mut Vec<Complex32>| {
            let (gh, gw) = (shape.place.grid_height as usize, shape.place.grid_width as usize);
            let mut fft = |frame: &mut [Complex32], direction| {
                if wide {
                    plans.fft_wide(frame, gh, gw, direction, step.columns, turned, store);
                } else {
                    plans.fft(frame, gh, gw, direction, step.columns, store);
                }
            };
            for dispatch in group {
                clock.time(dispatch.kernel, || match dispatch.kernel {
                    Kernel::Quantise => quantise(&step.quantise, phases, levels, shown),
                    Kernel::Modulate if shape.quantised => modulate(&shape.place, scale, shown, field),
                    Kernel::Modulate => modulate(&shape.place, scale, phases, field),
                    Kernel::FieldForward => fft(field, Direction::Forward),
                    Kernel::ReturnPupil => {
                        for (pupil_pass, slot) in step.pupil_passes[dispatch.pupil_passes.clone()].iter().zip(slots) {
                            let window = &slot.window[f * pupil_pass.count()..][..pupil_pass.count()];
                            return_pupil(&pupil_pass.back, window, &slot.transfer, &pupil_pass.spans, change);
                            // Each pupil adds to what is stored.
                            pupil_pass
                                .back
                                .pieces(&pupil_pass.spans, |at, _, length| store(&mut change[at..at + length]));
                        }
                    }
                    Kernel::DivideByOverlap => {
                        divide_by_overlap::divide_by_overlap(&step.divide_by_overlap, hits, change)
                    }
                    Kernel::EqualiseEyebox => {
                        let patches = step.equalise_eyebox.place.patches as usize;
                        equalise_eyebox::equalise_eyebox(
                            &step.equalise_eyebox,
                            &energy[..patches * patches],
                            field,
                            change,
                        );
                    }
                    Kernel::ChangeInverse => fft(change, Direction::Inverse),
                    Kernel::Project => {
                        project(&step.project, change, shape.quantised.then_some(&*shown), phases, momentum)
                    }
                    Kernel::Adam => {
                        let shown = shape.quantised.then_some(&*shown);
                        adam::adam(&step.adam, change, shown, phases, momentum, second);
                    }
                    other => unreachable!("{} does not run over frames", other.name()),
                });
                match dispatch.kernel {
                    Kernel::Modulate => store(field),
                    Kernel::DivideByOverlap | Kernel::EqualiseEyebox => store(change),
                    _ => {}
                }
            }
        };
        if wide {
            let mut turned = Vec::new();
            for (f, buffers) in all.into_iter().enumerate() {
                run(f, buffers, &mut turned);
            }
        } else {
            all.par_drain(..).enumerate().for_each(|(f, buffers)| run(f, buffers, &mut Vec::new()));
        }
    }

    /// Pupil pass by pupil pass through all of `group`, which has one range of pupil passes.
    fn run_pupil_passes(&mut self, step: &Step, group: &[Dispatch]) -> Result<(), EngineError> {
        let pupil_passes = &step.pupil_passes[group[0].pupil_passes.clone()];
        if self.slots.len() < pupil_passes.len() {
            self.slots.resize_with(pupil_passes.len(), Slot::default);
        }
        let views = match &self.views {
            None if group.iter().any(|d| d.kernel == Kernel::Photograph) => {
                return Err(EngineError::Mismatch {
                    reason: "a photograph is asked for and no views were loaded".into(),
                });
            }
            views => views.as_deref(),
        };
        let Self { shape, field, slots, plans, clock, .. } = self;
        let (frames, points, field) = (shape.frames, shape.points(), &*field);
        let store = storing(shape.storage);
        slots.par_iter_mut().zip(pupil_passes).for_each(|(slot, pupil_pass)| {
            let mut rest = group;
            while let [first, ..] = rest {
                // Kernels that take one sub-frame at a time run depth first as well.
                let framewise = rest.iter().take_while(|d| is_framewise(d.kernel)).count();
                if framewise == 0 {
                    clock.time(first.kernel, || run_pupil_pass(first.kernel, pupil_pass, slot, shape, views));
                    rest = &rest[1..];
                    continue;
                }
                let (now, later) = rest.split_at(framewise);
                rest = later;
                let count = pupil_pass.count();
                grow(&mut slot.window, frames * count);
                let Slot { transfer, window, image, .. } = slot;
                let work = |f: usize, window: &mut [Complex32]| {
                    for dispatch in now {
                        clock.time(dispatch.kernel, || match dispatch.kernel {
                            Kernel::PassPupil => {
                                let spectrum = &field[f * points..][..points];
                                pass_pupil(&pupil_pass.pass, spectrum, transfer, &pupil_pass.spans, window);
                                store(window);
                            }
                            Kernel::WindowInverse => window_fft(plans, pupil_pass, window, Direction::Inverse, store),
                            Kernel::WindowForward => window_fft(plans, pupil_pass, window, Direction::Forward, store),
                            _ => {
                                apply_factor(image, window);
                                store(window);
                            }
                        });
                    }
                };
                if frames * count >= SPLIT {
                    window.par_chunks_exact_mut(count).enumerate().for_each(|(f, w)| work(f, w));
                } else {
                    window.chunks_exact_mut(count).enumerate().for_each(|(f, w)| work(f, w));
                }
            }
        });
        Ok(())
    }

    /// Whether what `check_finite` looks at is in order; true for the other kernels.
    fn run_whole(&mut self, step: &Step, dispatch: &Dispatch) -> bool {
        let mut sound = true;
        let Self { field, change, hits, energy, clock, .. } = self;
        clock.time(dispatch.kernel, || match dispatch.kernel {
            Kernel::Clear => {
                hits.fill(0.0);
                change.par_chunks_mut(1 << 16).for_each(|part| part.fill(ZERO));
            }
            Kernel::CheckFinite => sound = !change.par_chunks(1 << 16).any(check_finite),
            Kernel::Energy => {
                let patches = step.equalise_eyebox.place.patches as usize;
                energy::energy(&step.equalise_eyebox.place, field, &mut energy[..patches * patches]);
            }
            _ => {
                for pupil_pass in &step.pupil_passes[dispatch.pupil_passes.clone()] {
                    overlap(&pupil_pass.pass, &pupil_pass.spans, hits);
                }
            }
        });
        sound
    }

    fn state(&self, buffer: Buffer) -> Option<&[f32]> {
        Some(match buffer {
            Buffer::Phases => &self.phases,
            Buffer::Shown => &self.shown,
            Buffer::Levels => &self.levels,
            Buffer::Momentum => &self.momentum,
            Buffer::Second => &self.second,
            Buffer::Field => bytemuck::cast_slice(&self.field),
            Buffer::Change => bytemuck::cast_slice(&self.change),
            Buffer::Hits => &self.hits,
            Buffer::Energy => &self.energy,
            Buffer::Transfer(i) => bytemuck::cast_slice(&self.slots.get(i)?.transfer),
            Buffer::Window(i) => bytemuck::cast_slice(&self.slots.get(i)?.window),
            Buffer::Image(i) => &self.slots.get(i)?.image,
            Buffer::Target(i) => &self.slots.get(i)?.target,
            Buffer::Accumulator(i) => &self.slots.get(i)?.accumulator,
            Buffer::Sums(i) => &self.slots.get(i)?.sums,
        })
    }
}

impl Default for CpuEngine {
    fn default() -> Self {
        Self::new()
    }
}

type FrameBuffers<'a> =
    (((((&'a mut [f32], &'a mut [f32]), &'a mut [f32]), &'a mut [f32]), &'a mut [Complex32]), &'a mut [Complex32]);

fn frames_of<T>(buffer: &mut [T], size: usize, frames: usize) -> Vec<&mut [T]> {
    if buffer.is_empty() {
        (0..frames).map(|_| Default::default()).collect()
    } else {
        buffer.chunks_exact_mut(size).collect()
    }
}

fn is_framewise(kernel: Kernel) -> bool {
    matches!(kernel, Kernel::PassPupil | Kernel::WindowInverse | Kernel::ApplyFactor | Kernel::WindowForward)
}

fn window_fft(plans: &Plans, pupil_pass: &PupilPass, window: &mut [Complex32], direction: Direction, store: Store) {
    plans.fft(window, pupil_pass.window.rows, pupil_pass.window.columns, direction, pupil_pass.columns, store);
}

/// What happens to complex values when they are stored.
fn storing(storage: Storage) -> Store {
    match storage {
        Storage::F32 => |_| {},
        Storage::F16 => half::round,
    }
}

impl Engine for CpuEngine {
    fn describe(&self) -> String {
        format!("CPU, {} threads, {}", rayon::current_num_threads(), eyebox_kernels::simd_name())
    }

    fn load(&mut self, shape: &Shape, views: Option<Arc<Pyramid>>) -> Result<(), EngineError> {
        let (pixels, points) = (shape.frames * shape.pixels(), shape.frames * shape.points());
        let descends = shape.purpose != Purpose::View;
        self.slots.clear();
        self.views = views;
        self.shape = *shape;
        renew(&mut self.phases, pixels, "phases")?;
        renew(&mut self.shown, if shape.quantised { pixels } else { 0 }, "shown")?;
        renew(&mut self.levels, if shape.quantised { quantise::MOST } else { 0 }, "levels")?;
        renew(&mut self.momentum, if descends { pixels } else { 0 }, "momentum")?;
        renew(&mut self.second, if shape.purpose == Purpose::Adam { pixels } else { 0 }, "second moment")?;
        renew(&mut self.field, points, "field")?;
        renew(&mut self.change, if descends { points } else { 0 }, "change")?;
        renew(&mut self.hits, if descends { shape.points() } else { 0 }, "hits")?;
        renew(&mut self.energy, if descends { ENERGIES } else { 0 }, "energy")
    }

    fn write(&mut self, buffer: Buffer, data: &[f32]) -> Result<(), EngineError> {
        let Self { phases, shown, levels, momentum, second, field, change, hits, energy, slots, .. } = self;
        let slot = |i: usize, slots: &mut Vec<Slot>| {
            if slots.len() <= i {
                slots.resize_with(i + 1, Slot::default);
            }
        };
        let store = storing(self.shape.storage);
        let complex = |to: &mut Vec<Complex32>, fixed: bool| {
            if fixed && 2 * to.len() != data.len() {
                return Err((2 * to.len(), data.len()));
            }
            let Ok(data) = bytemuck::try_cast_slice(data) else { return Err((2 * to.len(), data.len())) };
            // In place: writing a large buffer again and again touches no new memory.
            to.clear();
            to.extend_from_slice(data);
            if !matches!(buffer, Buffer::Transfer(_)) {
                store(to);
            }
            Ok(())
        };
        let real = |to: &mut Vec<f32>, fixed: bool| {
            if fixed && to.len() != data.len() {
                return Err((to.len(), data.len()));
            }
            to.clear();
            to.extend_from_slice(data);
            Ok(())
        };
        let done = match buffer {
            Buffer::Phases => real(phases, true),
            Buffer::Shown => real(shown, true),
            Buffer::Levels => real(levels, true),
            Buffer::Momentum => real(momentum, true),
            Buffer::Second => real(second, true),
            Buffer::Hits => real(hits, true),
            Buffer::Energy => real(energy, true),
            Buffer::Field => complex(field, true),
            Buffer::Change => complex(change, true),
            Buffer::Transfer(i)
            | Buffer::Window(i)
            | Buffer::Image(i)
            | Buffer::Target(i)
            | Buffer::Accumulator(i)
            | Buffer::Sums(i) => {
                slot(i, slots);
                let slot = &mut slots[i];
                match buffer {
                    Buffer::Transfer(_) => complex(&mut slot.transfer, false),
                    Buffer::Window(_) => complex(&mut slot.window, false),
                    Buffer::Image(_) => real(&mut slot.image, false),
                    Buffer::Target(_) => real(&mut slot.target, false),
                    Buffer::Accumulator(_) => real(&mut slot.accumulator, false),
                    _ => real(&mut slot.sums, false),
                }
            }
        };
        done.map_err(|(has, given)| misfit(buffer, has, given))
    }

    fn read(&mut self, buffer: Buffer) -> Result<Vec<f32>, EngineError> {
        match self.state(buffer) {
            Some(data) => Ok(data.to_vec()),
            None => Err(EngineError::Mismatch { reason: format!("{buffer:?} was never written") }),
        }
    }

    fn read_into(&mut self, buffer: Buffer, to: &mut [f32]) -> Result<(), EngineError> {
        match self.state(buffer) {
            Some(data) if data.len() == to.len() => {
                to.copy_from_slice(data);
                Ok(())
            }
            Some(data) => Err(misfit(buffer, data.len(), to.len())),
            None => Err(EngineError::Mismatch { reason: format!("{buffer:?} was never written") }),
        }
    }

    fn run_part(&mut self, step: &Step, part: std::ops::Range<usize>) -> Result<Vec<f64>, EngineError> {
        let mut losses = vec![0.0; step.pupil_passes.len()];
        let mut rest = &step.list[part];
        while let [first, ..] = rest {
            let scope = first.kernel.scope();
            let same = |d: &&Dispatch| {
                d.kernel.scope() == scope && (scope != Scope::PupilPasses || d.pupil_passes == first.pupil_passes)
            };
            let count = if scope == Scope::Whole { 1 } else { rest.iter().take_while(same).count() };
            let (group, later) = rest.split_at(count);
            rest = later;
            match scope {
                Scope::Whole => {
                    if !self.run_whole(step, first) {
                        losses.fill(f64::NAN);
                    }
                }
                Scope::Frames => self.run_frames(step, group),
                Scope::PupilPasses => {
                    self.run_pupil_passes(step, group)?;
                    if group.iter().any(|d| d.kernel == Kernel::Compare) {
                        for (loss, slot) in losses[first.pupil_passes.clone()].iter_mut().zip(&self.slots) {
                            *loss = slot.loss;
                        }
                    }
                }
            }
        }
        Ok(losses)
    }

    fn timings(&self) -> Vec<Timing> {
        let one = |kernel: Kernel| {
            let (calls, nanoseconds) = &self.clock.0[kernel as usize];
            Timing { kernel, calls: calls.load(Relaxed), seconds: nanoseconds.load(Relaxed) as f64 * 1e-9 }
        };
        Kernel::ALL.into_iter().map(one).filter(|t| t.calls > 0).collect()
    }

    fn reset_timings(&mut self) {
        self.clock = Clock::default();
    }
}

/// Makes room for `length` values. What was there is gone where it has to grow: the old room is given back first, so that
/// pupils of growing size leave no trail of blocks behind.
fn grow<T: Clone + bytemuck::Zeroable>(buffer: &mut Vec<T>, length: usize) {
    if length > buffer.capacity() {
        *buffer = Vec::new();
        buffer.reserve_exact(length);
    }
    buffer.resize(length, T::zeroed());
}

fn renew<T: Clone + bytemuck::Zeroable>(buffer: &mut Vec<T>, length: usize, what: &str) -> Result<(), EngineError> {
    buffer.clear();
    buffer.shrink_to(length);
    let wanted = Some((length as u64).saturating_mul(size_of::<T>() as u64));
    buffer.try_reserve_exact(length).map_err(|_| EngineError::OutOfMemory {
        device: "host".into(),
        what: what.into(),
        wanted,
    })?;
    buffer.resize(length, T::zeroed());
    Ok(())
}
