//! Runs lists of kernels over buffers: on the [`cpu`], on [`vulkan`], or on both in turn ([`Handover`]).
//!
//! A [`Step`] is plain data: a short list of named kernels ([`Dispatch`]) and, per pupil, the arguments and tables that
//! they take ([`PupilPass`]). Every engine runs the same list and keeps the same buffers ([`Buffer`]), so that a wrong
//! kernel is found by running the list on one engine up to it and on the other after it.

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
pub use handover::{At, Handover};
pub use look_up::LookUp;
pub use threads::{pool, prepare_threads};

use crate::scene::Pyramid;
use std::ops::Range;
use std::sync::Arc;
use std::time::Instant;

/// Where an engine's buffers lie.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Memory {
    /// In the host's memory, as part of the program.
    Host,
    /// In the host's memory, behind a driver: what the host gives it is there twice.
    Shared,
    /// In the device's own.
    Device,
}

#[cfg(feature = "vulkan")]
impl Memory {
    /// Of a device of this kind.
    pub fn of(kind: crate::gpu::DeviceKind) -> Self {
        use crate::gpu::DeviceKind::{Cpu, Integrated};
        if matches!(kind, Cpu | Integrated) { Self::Shared } else { Self::Device }
    }
}

/// What came of a step.
#[derive(Debug, Clone, PartialEq)]
pub struct StepResult {
    /// The loss (a sum over pixels) of each pupil pass. Where one is no finite number the phases stayed as they were.
    pub losses: Vec<f64>,
    /// Seconds that it took: by the device's clock, where it has one.
    pub seconds: f64,
}

/// A step that was begun, which [`Engine::end_step`] takes.
#[derive(Debug)]
pub struct PendingStep(State);

#[derive(Debug)]
enum State {
    Over(StepResult),
    /// It has the number that its engine gave it.
    #[cfg(feature = "vulkan")]
    UnderWay(u64),
}

impl PendingStep {
    /// Whether its losses are known already.
    pub fn is_over(&self) -> bool {
        matches!(self.0, State::Over(_))
    }
}

fn misfit(buffer: Buffer, has: usize, given: usize) -> EngineError {
    EngineError::mismatch(format!("{buffer:?} holds {has} values, {given} were given"))
}

/// Views for an engine that has none of a device's memory.
pub fn on_host(views: &Arc<Pyramid>) -> Result<Arc<Pyramid>, EngineError> {
    views.on_host().map_err(|reason| EngineError::mismatch(format!("the views are on a device: {reason}")))
}

/// What [`Engine::keep`] does not keep.
fn not_kept(buffer: Buffer) -> EngineError {
    EngineError::mismatch(format!("{buffer:?} is not kept, phases and what is shown are"))
}

/// Pupil passes of more modes than the display's model has tables for.
fn other_source(modes: usize, tables: usize) -> EngineError {
    EngineError::mismatch(format!(
        "a pupil pass has {modes} modes of a source, the display's model tables for {tables}: `Planner::with_source` \
         makes both"
    ))
}

#[cfg(feature = "vulkan")]
fn not_under_way() -> EngineError {
    EngineError::mismatch("the step that is to be ended is not under way")
}

fn nothing_kept() -> EngineError {
    EngineError::mismatch("nothing was kept")
}

/// Runs steps. Times are kept per kernel.
pub trait Engine: Send {
    /// What it is and what it runs on, in one line.
    fn describe(&self) -> String;

    /// How it runs lists: `kernel by kernel`, or what it does together.
    fn lists(&self) -> &'static str {
        "kernel by kernel"
    }

    /// Where its buffers lie.
    fn memory(&self) -> Memory {
        Memory::Host
    }

    /// How complex fields are best stored where halves are exact enough: as halves on a GPU, whose time is bytes.
    fn preferred_storage(&self) -> Storage {
        Storage::F32
    }

    /// Makes the buffers for this shape, all zero, and takes the views (float32 targets need none).
    ///
    /// # Errors
    /// Out of memory, or a device that is too small.
    fn load(&mut self, shape: &Shape, views: Option<Arc<Pyramid>>) -> Result<(), EngineError>;

    /// Takes other views in place of those that it was loaded with; its buffers stay as they are.
    ///
    /// # Errors
    /// Out of memory; a lost device.
    fn take_views(&mut self, views: Arc<Pyramid>) -> Result<(), EngineError>;

    /// Fills a buffer (complex ones as pairs of float32).
    ///
    /// # Errors
    /// A length that is not the buffer's; a lost device.
    fn write(&mut self, buffer: Buffer, data: &[f32]) -> Result<(), EngineError>;

    /// Reads a buffer, whole. Pupil pass buffers have the size that the last step gave them.
    ///
    /// # Errors
    /// A buffer that the shape does not have; a lost device.
    fn read(&mut self, buffer: Buffer) -> Result<Vec<f32>, EngineError>;

    /// The phases where they are, if that is in a device's memory.
    fn phases_on_device(&self) -> Option<PhasesOnDevice<'_>> {
        None
    }

    /// Keeps a copy of [`Buffer::Phases`] or [`Buffer::Shown`] beside the buffers, where they are, in place of the one kept
    /// before. [`load`](Self::load) forgets it.
    ///
    /// # Errors
    /// A buffer that is neither, or that the shape does not have; out of memory; a lost device.
    fn keep(&mut self, buffer: Buffer) -> Result<(), EngineError>;

    /// Reads what was kept.
    ///
    /// # Errors
    /// Nothing was kept; a lost device.
    fn kept(&mut self) -> Result<Vec<f32>, EngineError>;

    /// What was kept becomes the phases again, and the [moments](Self::clear_moments) zero, with nothing passing through the
    /// host where the buffers are a device's.
    ///
    /// # Errors
    /// Nothing was kept; a lost device.
    fn restore(&mut self) -> Result<(), EngineError>;

    /// Fills the phases by a table, from the views that were taken last.
    ///
    /// # Errors
    /// Another number of phases; a lost device.
    fn look_up(&mut self, of: &LookUp) -> Result<(), EngineError> {
        self.write(Buffer::Phases, &of.phases()?)
    }

    /// Makes [`Buffer::Momentum`] and [`Buffer::Second`] zero, as far as the shape has them.
    ///
    /// # Errors
    /// A lost device.
    fn clear_moments(&mut self) -> Result<(), EngineError>;

    /// As [`read`](Self::read), into memory that is there already.
    ///
    /// # Errors
    /// Those of [`read`](Self::read); a length that is not the buffer's.
    fn read_into(&mut self, buffer: Buffer, to: &mut [f32]) -> Result<(), EngineError> {
        let data = self.read(buffer)?;
        if data.len() != to.len() {
            return Err(misfit(buffer, data.len(), to.len()));
        }
        to.copy_from_slice(&data);
        Ok(())
    }

    /// Runs the dispatches `part` of the step's list. Returns the loss (a sum over pixels) of each pupil pass that
    /// `compare` saw in this part, zero for others.
    ///
    /// # Errors
    /// A step that does not fit the loaded shape; a lost device.
    fn run_part(&mut self, step: &Step, part: Range<usize>) -> Result<Vec<f64>, EngineError>;

    /// Runs the whole list.
    ///
    /// # Errors
    /// As [`run_part`](Self::run_part).
    fn run(&mut self, step: &Step) -> Result<Vec<f64>, EngineError> {
        self.run_part(step, 0..step.list.len())
    }

    /// Takes a step, or these parts of its list, in order. All losses are known before phases may change: with one that is no
    /// finite number they stay as they are, and where steps are under way behind it, through those as well. On a device the
    /// step may be under way when this returns, one at most; it is ended before another two are begun.
    ///
    /// # Errors
    /// As [`run_part`](Self::run_part).
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

    /// What came of a step, when it is over.
    ///
    /// # Errors
    /// A step of another engine, or of long ago; a lost device.
    fn end_step(&mut self, begun: PendingStep) -> Result<StepResult, EngineError> {
        match begun.0 {
            State::Over(taken) => Ok(taken),
            #[cfg(feature = "vulkan")]
            State::UnderWay(_) => Err(not_under_way()),
        }
    }

    /// A list of losses that it gave is done with: it may be filled again.
    fn recycle(&mut self, _losses: Vec<f64>) {}

    /// Makes what these steps need: memory, pipelines, tables. With `at_once` they may be over any of their pupil passes, so many
    /// at a time; without, they are as they are given. Nothing is run, and steps find all of it there.
    ///
    /// # Errors
    /// Those of [`run_part`](Self::run_part); out of memory.
    fn prepare(&mut self, _steps: &mut dyn Iterator<Item = Step>, _at_once: Option<usize>) -> Result<(), EngineError> {
        Ok(())
    }

    /// Whether kernels are timed one by one from now on, where that takes time itself.
    fn time_kernels(&mut self, _on: bool) {}

    /// Time and calls per kernel since the last reset, in the order of [`Kernel::ALL`]; on a device, since kernels are
    /// [timed](Self::time_kernels).
    fn timings(&self) -> Vec<Timing>;

    /// Forgets the times.
    fn reset_timings(&mut self);
}

/// Refuses buffers on the host that memory does not hold, before any is taken; a complex value takes `complex` bytes.
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
