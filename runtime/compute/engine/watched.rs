//! An engine around the CPU's, for tests of what uses one: what stands before each of its parts may wait, count or fail.

use super::{Buffer, Engine, EngineError, Memory, Shape, Step, Timing, cpu::CpuEngine};
use crate::scene::Pyramid;
use std::{ops::Range, sync::Arc};

/// Runs a list on the CPU, and before each part of it something else.
pub struct Watched<F>(pub CpuEngine, pub F);

impl<F: FnMut() -> Result<(), EngineError> + Send> Engine for Watched<F> {
    fn describe(&self) -> String {
        self.0.describe()
    }

    fn memory(&self) -> Memory {
        self.0.memory()
    }

    fn load(&mut self, shape: &Shape, views: Option<Arc<Pyramid>>) -> Result<(), EngineError> {
        self.0.load(shape, views)
    }

    fn take_views(&mut self, views: Arc<Pyramid>) -> Result<(), EngineError> {
        self.0.take_views(views)
    }

    fn write(&mut self, buffer: Buffer, data: &[f32]) -> Result<(), EngineError> {
        self.0.write(buffer, data)
    }

    fn read(&mut self, buffer: Buffer) -> Result<Vec<f32>, EngineError> {
        self.0.read(buffer)
    }

    fn keep(&mut self, buffer: Buffer) -> Result<(), EngineError> {
        self.0.keep(buffer)
    }

    fn kept(&mut self) -> Result<Vec<f32>, EngineError> {
        self.0.kept()
    }

    fn restore(&mut self) -> Result<(), EngineError> {
        self.0.restore()
    }

    fn clear_moments(&mut self) -> Result<(), EngineError> {
        self.0.clear_moments()
    }

    fn run_part(&mut self, step: &Step, part: Range<usize>) -> Result<Vec<f64>, EngineError> {
        (self.1)()?;
        self.0.run_part(step, part)
    }

    fn timings(&self) -> Vec<Timing> {
        self.0.timings()
    }

    fn reset_timings(&mut self) {
        self.0.reset_timings();
    }
}
