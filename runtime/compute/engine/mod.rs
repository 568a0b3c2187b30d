//! Runs lists of kernels over buffers on the [`cpu`], on [`vulkan`], or on both in turn ([`Handover`]).
//!
//! A [`Step`] is plain data. It is a short list of named kernels ([`Dispatch`]), with the arguments and tables that
//! each pupil needs ([`PupilPass`]). Every engine runs the same list and keeps the same buffers ([`Buffer`]). To find
//! a wrong kernel, run the list on one engine up to it and on the other after it.

mod choose;
pub mod cpu;
mod handover;
mod look_up;
mod threads;
#[cfg(feature = "vulkan")]
pub mod vulkan;

pub use crate::gpu::{EngineError, PhasesOnDevice};
pub use crate::plan::{
    Buffer, Dispatch, Kernel, ModelParts, ModelTables, PupilPass, Purpose, Resource, Scope, Shape, Shot, Step, Storage,
    Timing,
};
pub use choose::{Backend, Choice, open, reason};
pub use eyebox_kernels::machine::{MachineRates, machine_rates};
pub use handover::{At, Handover};
pub use look_up::LookUp;
pub use threads::{pool, prepare_threads};

use crate::scene::{Pyramid, SplatDrawer};
use std::ops::Range;
use std::sync::Arc;
use std::time::Instant;

/// Location of an engine's buffers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Memory {
    /// The host's memory, as part of the program.
    Host,
    /// The host's memory behind a driver. Data that the host passes to it exists twice.
    Shared,
    /// The device's own memory.
    Device,
}

#[cfg(feature = "vulkan")]
impl Memory {
    /// Returns the location for a device of this kind.
    pub fn of(kind: crate::gpu::DeviceKind) -> Self {
        use crate::gpu::DeviceKind::{Cpu, Integrated};
        if matches!(kind, Cpu | Integrated) { Self::Shared } else { Self::Device }
    }
}

/// The time in regions whose tasks the threads share.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ParallelTime {
    /// Time of the regions in seconds.
    pub seconds: f64,
    /// The sum of the times of the regions, each divided by its tasks or by the threads, whichever are fewer. If one
    /// core runs all threads, this is the time on as many cores as threads, for tasks of equal size.
    pub shared_seconds: f64,
}

/// The result of a step.
#[derive(Debug, Clone, PartialEq)]
pub struct StepResult {
    /// Loss of each pupil pass, a sum over its pixels. If one is not finite, the phases did not change.
    pub losses: Vec<f64>,
    /// Duration in seconds, by the device's clock if it has one.
    pub seconds: f64,
}

/// A started step, which [`Engine::end_step`] takes.
#[derive(Debug)]
pub struct PendingStep(State);

#[derive(Debug)]
enum State {
    Over(StepResult),
    /// The number that the engine gave to the step.
    #[cfg(feature = "vulkan")]
    UnderWay(u64),
}

impl PendingStep {
    /// Returns true if its losses are available.
    pub fn is_over(&self) -> bool {
        matches!(self.0, State::Over(_))
    }
}

fn misfit(buffer: Buffer, has: usize, given: usize) -> EngineError {
    EngineError::mismatch(format!("{buffer:?} holds {has} values, but {given} were given"))
}

/// Returns views for an engine without a device's memory.
pub fn on_host(views: &Arc<Pyramid>) -> Result<Arc<Pyramid>, EngineError> {
    views.on_host().map_err(|reason| EngineError::mismatch(format!("views on a device cannot be read: {reason}")))
}

/// Returns the error for a buffer that [`Engine::keep`] does not keep.
fn not_kept(buffer: Buffer) -> EngineError {
    EngineError::mismatch(format!("{buffer:?} cannot be kept, only Phases and Shown can"))
}

/// Returns the error for pupil passes with more modes than the display's model has tables for.
fn other_source(modes: usize, tables: usize) -> EngineError {
    EngineError::mismatch(format!(
        "a pupil pass has {modes} modes of a source, but the display's model has tables for {tables}. \
         `Planner::with_source` sets both"
    ))
}

#[cfg(feature = "vulkan")]
fn not_under_way() -> EngineError {
    EngineError::mismatch("the step to end is not under way")
}

fn nothing_kept() -> EngineError {
    EngineError::mismatch("no phases were kept")
}

/// Runs steps, and counts the time of each kernel.
pub trait Engine: Send {
    /// Describes the engine and its device in one line.
    fn describe(&self) -> String;

    /// Describes how it runs lists, such as `kernel by kernel` or with several kernels together.
    fn lists(&self) -> &'static str {
        "kernel by kernel"
    }

    /// Returns the location of its buffers.
    fn memory(&self) -> Memory {
        Memory::Host
    }

    /// Returns the best storage of complex fields if halves are exact enough. A GPU, whose time is bytes, prefers
    /// halves.
    fn preferred_storage(&self) -> Storage {
        Storage::F32
    }

    /// Returns a drawer of splats on the device of the engine. It is `None` if the CPU draws them.
    ///
    /// # Errors
    /// [`EngineError`] if memory runs out or the device is lost.
    fn splat_drawer(&self) -> Result<Option<Arc<dyn SplatDrawer>>, EngineError> {
        Ok(None)
    }

    /// Makes the buffers for this shape, all zero, and takes the views. Targets as float32 need no views.
    ///
    /// # Errors
    /// [`EngineError`] if memory runs out or the device is too small.
    fn load(&mut self, shape: &Shape, views: Option<Arc<Pyramid>>) -> Result<(), EngineError>;

    /// Replaces the loaded views by others. The buffers keep their content.
    ///
    /// # Errors
    /// [`EngineError`] if memory runs out or the device is lost.
    fn take_views(&mut self, views: Arc<Pyramid>) -> Result<(), EngineError>;

    /// Fills a buffer, with complex values as pairs of float32.
    ///
    /// # Errors
    /// [`EngineError`] if the length is not the buffer's, or the device is lost.
    fn write(&mut self, buffer: Buffer, data: &[f32]) -> Result<(), EngineError>;

    /// Reads a whole buffer. Pupil pass buffers have the size that the last step gave them.
    ///
    /// # Errors
    /// [`EngineError`] if the shape does not have the buffer, or the device is lost.
    fn read(&mut self, buffer: Buffer) -> Result<Vec<f32>, EngineError>;

    /// Returns the phases in place, if they are in a device's memory.
    fn phases_on_device(&self) -> Option<PhasesOnDevice<'_>> {
        None
    }

    /// Keeps a copy of [`Buffer::Phases`] or [`Buffer::Shown`] next to the buffers, instead of the copy kept before.
    /// [`load`](Self::load) deletes it.
    ///
    /// # Errors
    /// [`EngineError`] if it is another buffer, the shape does not have it, memory runs out, or the device is lost.
    fn keep(&mut self, buffer: Buffer) -> Result<(), EngineError>;

    /// Reads the copy that was kept.
    ///
    /// # Errors
    /// [`EngineError`] if no phases were kept, or the device is lost.
    fn kept(&mut self) -> Result<Vec<f32>, EngineError>;

    /// Copies the kept phases back to the phases and sets the [moments](Self::clear_moments) to zero. Nothing passes
    /// through the host if the buffers are on a device.
    ///
    /// # Errors
    /// [`EngineError`] if no phases were kept, or the device is lost.
    fn restore(&mut self) -> Result<(), EngineError>;

    /// Fills the phases from a table, with the views that were loaded last.
    ///
    /// # Errors
    /// [`EngineError`] if the number of phases differs, or the device is lost.
    fn look_up(&mut self, of: &LookUp) -> Result<(), EngineError> {
        self.write(Buffer::Phases, &of.phases()?)
    }

    /// Sets [`Buffer::Momentum`] and [`Buffer::Second`] to zero, if the shape has them.
    ///
    /// # Errors
    /// [`EngineError`] if the device is lost.
    fn clear_moments(&mut self) -> Result<(), EngineError>;

    /// Reads a buffer like [`read`](Self::read), into existing memory.
    ///
    /// # Errors
    /// The errors of [`read`](Self::read), and a length that is not the buffer's.
    fn read_into(&mut self, buffer: Buffer, to: &mut [f32]) -> Result<(), EngineError> {
        let data = self.read(buffer)?;
        if data.len() != to.len() {
            return Err(misfit(buffer, data.len(), to.len()));
        }
        to.copy_from_slice(&data);
        Ok(())
    }

    /// Runs the dispatches `part` of the step's list. Returns the loss of each pupil pass that `compare` saw in this
    /// part, as a sum over its pixels, and zero for the others.
    ///
    /// # Errors
    /// [`EngineError`] if the step does not fit the loaded shape, or the device is lost.
    fn run_part(&mut self, step: &Step, part: Range<usize>) -> Result<Vec<f64>, EngineError>;

    /// Runs the whole list.
    ///
    /// # Errors
    /// The errors of [`run_part`](Self::run_part).
    fn run(&mut self, step: &Step) -> Result<Vec<f64>, EngineError> {
        self.run_part(step, 0..step.list.len())
    }

    /// Starts a step, or these parts of its list in order. All losses are computed before phases may change. If one
    /// is not finite, the phases stay unchanged, also through steps that are already under way after it. On a device
    /// the step may still be under way when this returns, one at most. It must be ended before another two are begun.
    ///
    /// # Errors
    /// The errors of [`run_part`](Self::run_part).
    fn begin_step(&mut self, step: &Step, parts: &[Range<usize>]) -> Result<PendingStep, EngineError> {
        let (start, update) = (Instant::now(), step.before_update());
        let mut losses: Option<Vec<f64>> = None;
        for part in parts {
            let before = part.start..part.end.min(update).max(part.start);
            let of_part = self.run_part(step, before.clone())?;
            let sums = match &mut losses {
                Some(sums) => {
                    sums.iter_mut().zip(&of_part).for_each(|(sum, loss)| *sum += loss);
                    self.recycle(of_part);
                    sums
                }
                none => none.insert(of_part),
            };
            if part.end > update {
                if !sums.iter().all(|loss| loss.is_finite()) {
                    break;
                }
                let of_update = self.run_part(step, before.end..part.end)?;
                self.recycle(of_update);
            }
        }
        let losses = losses.unwrap_or_else(|| vec![0.0; step.pupil_passes.len()]);
        Ok(PendingStep(State::Over(StepResult { losses, seconds: start.elapsed().as_secs_f64() })))
    }

    /// Waits for a step and returns its result.
    ///
    /// # Errors
    /// [`EngineError`] if the step is from another engine or too old, or the device is lost.
    fn end_step(&mut self, begun: PendingStep) -> Result<StepResult, EngineError> {
        match begun.0 {
            State::Over(taken) => Ok(taken),
            #[cfg(feature = "vulkan")]
            State::UnderWay(_) => Err(not_under_way()),
        }
    }

    /// Takes back a list of losses that the engine returned, to fill it again.
    fn recycle(&mut self, _losses: Vec<f64>) {}

    /// Makes the memory, pipelines and tables of these steps without running anything, so that steps find all of
    /// them. With `at_once` the steps may have any of their pupil passes, that number at a time. Without it, they are
    /// as given.
    ///
    /// # Errors
    /// The errors of [`run_part`](Self::run_part), and lack of memory.
    fn prepare(&mut self, _steps: &mut dyn Iterator<Item = Step>, _at_once: Option<usize>) -> Result<(), EngineError> {
        Ok(())
    }

    /// Makes the memory and tables of these steps, as [`prepare`](Self::prepare) does, and their pipelines in the
    /// background. A step that comes before its pipelines makes them itself.
    ///
    /// # Errors
    /// The errors of [`prepare`](Self::prepare).
    fn prepare_later(&mut self, steps: &mut dyn Iterator<Item = Step>, at_once: usize) -> Result<(), EngineError> {
        self.prepare(steps, Some(at_once))
    }

    /// Turns timing of single kernels on or off, on engines for which it costs time.
    fn time_kernels(&mut self, _on: bool) {}

    /// Returns time and calls per kernel since the last reset, in the order of [`Kernel::ALL`]. On a device they
    /// count only while kernels are [timed](Self::time_kernels).
    fn timings(&self) -> Vec<Timing>;

    /// Returns the time in regions that threads share, since the last reset, if the engine measures it.
    fn parallel_time(&self) -> Option<ParallelTime> {
        None
    }

    /// Sets all times to zero.
    fn reset_timings(&mut self);
}

/// Refuses buffers on the host that exceed the available memory, before any is allocated. A complex value takes
/// `complex` bytes.
pub(crate) fn check_shape(shape: &Shape, complex: u64) -> Result<(), EngineError> {
    let bytes = crate::plan::shared_bytes(shape, complex);
    match crate::memory::available() {
        Some(available) if bytes > available => Err(EngineError::OutOfMemory {
            device: "the machine's".into(),
            what: format!("phases and fields of {} sub-frames of {} pixels", shape.frames, shape.pixels()),
            wanted: Some(bytes),
        }),
        _ => Ok(()),
    }
}
