//! Runs a list on one engine up to a kernel, and on a second one from there.
//!
//! If a step fails on Vulkan and works on the CPU, handovers at later and later kernels find the faulty one.

use super::{Buffer, Engine, EngineError, Kernel, Memory, Resource, Shape, Step, Timing, not_kept, nothing_kept};
use crate::scene::{Pyramid, SplatDrawer};
use std::ops::Range;
use std::sync::Arc;

/// The place in a list at which the second engine takes over.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum At {
    /// Before this entry of the list, or at its end if the list is shorter.
    Index(usize),
    /// Before the first entry with this kernel, or at the list's end if there is none.
    Kernel(Kernel),
}

/// Runs the front of each list on one engine and its rest on another. An engine that takes over receives all buffers.
pub struct Handover {
    first: Box<dyn Engine>,
    second: Box<dyn Engine>,
    at: At,
    shape: Option<Shape>,
    /// True if the second engine ran last. Only that engine has the results of the kernels.
    last_is_second: Option<bool>,
    /// The kept phases, for both engines.
    kept: Option<Vec<f32>>,
}

impl Handover {
    /// Makes an engine that runs lists on `first` up to `at`, and on `second` from there.
    pub fn new(first: Box<dyn Engine>, second: Box<dyn Engine>, at: At) -> Self {
        Self { first, second, at, shape: None, last_is_second: None, kept: None }
    }

    fn place(&self, step: &Step) -> usize {
        match self.at {
            At::Index(index) => index.min(step.list.len()),
            At::Kernel(kernel) => step.list.iter().position(|d| d.kernel == kernel).unwrap_or(step.list.len()),
        }
    }

    fn last(&mut self) -> &mut dyn Engine {
        if self.last_is_second == Some(true) { &mut *self.second } else { &mut *self.first }
    }
}

/// Copies the data that kernels from entry `at` on may read. These are all buffers of the shape, and the buffers of
/// the pupil passes whose kernels the list is in the middle of.
fn copy(from: &mut dyn Engine, to: &mut dyn Engine, shape: &Shape, step: &Step, at: usize) -> Result<(), EngineError> {
    for buffer in shape.buffers() {
        to.write(buffer, &from.read(buffer)?)?;
    }
    // A group of pupil passes that starts here needs no data from before.
    let Some(next) = step.list[at..].iter().find(|d| !d.pupil_passes.is_empty()) else { return Ok(()) };
    let before = step.list[..at].iter().rev().find(|d| !d.pupil_passes.is_empty());
    if before.is_none_or(|b| b.pupil_passes != next.pupil_passes) {
        return Ok(());
    }
    for (slot, pupil_pass) in step.pupil_passes[next.pupil_passes.clone()].iter().enumerate() {
        for resource in Resource::OF_SLOT {
            let (Some(buffer), length) = (resource.buffer(slot), pupil_pass.extent(resource, shape).floats()) else {
                continue;
            };
            // A buffer of another length was not yet computed for this pupil pass.
            match from.read(buffer) {
                Ok(data) if length > 0 && data.len() == length => to.write(buffer, &data)?,
                Ok(_) | Err(EngineError::Mismatch { .. }) => {}
                Err(e) => return Err(e),
            }
        }
    }
    Ok(())
}

impl Engine for Handover {
    fn describe(&self) -> String {
        let at = match self.at {
            At::Index(index) => format!("entry {index}"),
            At::Kernel(kernel) => kernel.name().to_owned(),
        };
        format!("{}, from {at} on {}", self.first.describe(), self.second.describe())
    }

    fn memory(&self) -> Memory {
        self.second.memory()
    }

    fn splat_drawer(&self) -> Result<Option<Arc<dyn SplatDrawer>>, EngineError> {
        self.second.splat_drawer()
    }

    fn load(&mut self, shape: &Shape, views: Option<Arc<Pyramid>>) -> Result<(), EngineError> {
        self.first.load(shape, views.clone())?;
        self.second.load(shape, views)?;
        (self.shape, self.last_is_second, self.kept) = (Some(*shape), None, None);
        Ok(())
    }

    fn take_views(&mut self, views: Arc<Pyramid>) -> Result<(), EngineError> {
        self.first.take_views(Arc::clone(&views))?;
        self.second.take_views(views)
    }

    fn write(&mut self, buffer: Buffer, data: &[f32]) -> Result<(), EngineError> {
        self.first.write(buffer, data)?;
        self.second.write(buffer, data)
    }

    fn read(&mut self, buffer: Buffer) -> Result<Vec<f32>, EngineError> {
        self.last().read(buffer)
    }

    fn keep(&mut self, buffer: Buffer) -> Result<(), EngineError> {
        if !matches!(buffer, Buffer::Phases | Buffer::Shown) {
            return Err(not_kept(buffer));
        }
        self.kept = Some(self.read(buffer)?);
        Ok(())
    }

    fn kept(&mut self) -> Result<Vec<f32>, EngineError> {
        self.kept.clone().ok_or_else(nothing_kept)
    }

    fn restore(&mut self) -> Result<(), EngineError> {
        let kept = self.kept()?;
        self.write(Buffer::Phases, &kept)?;
        self.clear_moments()
    }

    fn clear_moments(&mut self) -> Result<(), EngineError> {
        self.first.clear_moments()?;
        self.second.clear_moments()
    }

    fn run_part(&mut self, step: &Step, part: Range<usize>) -> Result<Vec<f64>, EngineError> {
        let Some(shape) = self.shape else {
            return Err(EngineError::mismatch("nothing was loaded"));
        };
        if part.start > part.end || part.end > step.list.len() {
            return Err(EngineError::mismatch(format!("dispatches {part:?} of {}", step.list.len())));
        }
        let at = self.place(step).clamp(part.start, part.end);
        let mut losses = vec![0.0; step.pupil_passes.len()];
        for (second, part) in [(false, part.start..at), (true, at..part.end)] {
            if part.is_empty() {
                continue;
            }
            let (mut ran, mut runs) = (&mut self.first, &mut self.second);
            if !second {
                std::mem::swap(&mut ran, &mut runs);
            }
            if self.last_is_second.is_some_and(|last| last != second) {
                copy(&mut **ran, &mut **runs, &shape, step, part.start)?;
            }
            // This also holds if the run fails, because its results are then the ones to read.
            self.last_is_second = Some(second);
            let more = runs.run_part(step, part)?;
            losses.iter_mut().zip(more).for_each(|(loss, more)| *loss += more);
        }
        Ok(losses)
    }

    fn prepare(&mut self, steps: &mut dyn Iterator<Item = Step>, at_once: Option<usize>) -> Result<(), EngineError> {
        let steps: Vec<Step> = steps.collect();
        self.first.prepare(&mut steps.iter().cloned(), at_once)?;
        self.second.prepare(&mut steps.into_iter(), at_once)
    }

    fn prepare_later(&mut self, steps: &mut dyn Iterator<Item = Step>, at_once: usize) -> Result<(), EngineError> {
        let steps: Vec<Step> = steps.collect();
        self.first.prepare_later(&mut steps.iter().cloned(), at_once)?;
        self.second.prepare_later(&mut steps.into_iter(), at_once)
    }

    fn time_kernels(&mut self, on: bool) {
        self.first.time_kernels(on);
        self.second.time_kernels(on);
    }

    fn timings(&self) -> Vec<Timing> {
        let mut all = self.first.timings();
        for timing in self.second.timings() {
            match all.iter_mut().find(|t| t.kernel == timing.kernel) {
                Some(t) => {
                    t.calls += timing.calls;
                    t.seconds += timing.seconds;
                }
                None => all.push(timing),
            }
        }
        all.sort_by_key(|t| t.kernel as usize);
        all
    }

    fn reset_timings(&mut self) {
        self.first.reset_timings();
        self.second.reset_timings();
    }
}
