//! Wraps an engine that refuses work after a stop, so that a long job ends at its next list.

use eyebox::low_level::engine::{
    Buffer, Engine, EngineError, LookUp, Memory, PendingStep, PhasesOnDevice, Shape, Step, StepResult, Storage, Timing,
};
use eyebox::low_level::scene::{Pyramid, SplatDrawer};
use std::ops::Range;
use std::sync::Arc;

/// Runs lists on another engine until `stops` returns true. From then on it returns [`EngineError::Stopped`].
pub(crate) struct Stoppable<'a> {
    pub(crate) engine: &'a mut dyn Engine,
    pub(crate) stops: &'a (dyn Fn() -> bool + Sync),
}

impl Stoppable<'_> {
    fn check(&self) -> Result<(), EngineError> {
        if (self.stops)() { Err(EngineError::Stopped) } else { Ok(()) }
    }
}

impl Engine for Stoppable<'_> {
    fn describe(&self) -> String {
        self.engine.describe()
    }

    fn lists(&self) -> &'static str {
        self.engine.lists()
    }

    fn memory(&self) -> Memory {
        self.engine.memory()
    }

    fn preferred_storage(&self) -> Storage {
        self.engine.preferred_storage()
    }

    fn splat_drawer(&self) -> Result<Option<Arc<dyn SplatDrawer>>, EngineError> {
        self.engine.splat_drawer()
    }

    fn load(&mut self, shape: &Shape, views: Option<Arc<Pyramid>>) -> Result<(), EngineError> {
        self.check()?;
        self.engine.load(shape, views)
    }

    fn take_views(&mut self, views: Arc<Pyramid>) -> Result<(), EngineError> {
        self.engine.take_views(views)
    }

    fn write(&mut self, buffer: Buffer, data: &[f32]) -> Result<(), EngineError> {
        self.engine.write(buffer, data)
    }

    fn read(&mut self, buffer: Buffer) -> Result<Vec<f32>, EngineError> {
        self.engine.read(buffer)
    }

    fn phases_on_device(&self) -> Option<PhasesOnDevice<'_>> {
        self.engine.phases_on_device()
    }

    fn keep(&mut self, buffer: Buffer) -> Result<(), EngineError> {
        self.engine.keep(buffer)
    }

    fn kept(&mut self) -> Result<Vec<f32>, EngineError> {
        self.engine.kept()
    }

    fn restore(&mut self) -> Result<(), EngineError> {
        self.engine.restore()
    }

    fn look_up(&mut self, of: &LookUp) -> Result<(), EngineError> {
        self.engine.look_up(of)
    }

    fn clear_moments(&mut self) -> Result<(), EngineError> {
        self.engine.clear_moments()
    }

    fn read_into(&mut self, buffer: Buffer, to: &mut [f32]) -> Result<(), EngineError> {
        self.engine.read_into(buffer, to)
    }

    fn run_part(&mut self, step: &Step, part: Range<usize>) -> Result<Vec<f64>, EngineError> {
        self.check()?;
        self.engine.run_part(step, part)
    }

    fn run(&mut self, step: &Step) -> Result<Vec<f64>, EngineError> {
        self.check()?;
        self.engine.run(step)
    }

    fn begin_step(&mut self, step: &Step, parts: &[Range<usize>]) -> Result<PendingStep, EngineError> {
        self.check()?;
        self.engine.begin_step(step, parts)
    }

    fn end_step(&mut self, begun: PendingStep) -> Result<StepResult, EngineError> {
        self.engine.end_step(begun)
    }

    fn recycle(&mut self, losses: Vec<f64>) {
        self.engine.recycle(losses);
    }

    fn prepare(&mut self, steps: &mut dyn Iterator<Item = Step>, at_once: Option<usize>) -> Result<(), EngineError> {
        self.check()?;
        self.engine.prepare(steps, at_once)
    }

    fn time_kernels(&mut self, on: bool) {
        self.engine.time_kernels(on);
    }

    fn timings(&self) -> Vec<Timing> {
        self.engine.timings()
    }

    fn reset_timings(&mut self) {
        self.engine.reset_timings();
    }
}
