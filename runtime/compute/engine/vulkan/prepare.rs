//! Makes the resources of steps before the first of them.

use super::check::check;
use super::engine::VulkanEngine;
use crate::engine::{EngineError, Step};
use std::collections::HashSet;

impl VulkanEngine {
    /// Makes the losses on the device, their copy for the host, and the tables large enough for the next list. The
    /// lists in flight get them as well, because their slots are used next.
    pub(super) fn fit_flights(&mut self) -> Result<(), EngineError> {
        let end = self.flights[self.at].end;
        if end > self.losses.as_ref().map_or(0, |l| l.size) {
            self.gpu.recorder.idle()?;
            self.losses = None;
            self.losses = Some(self.gpu.block(end.next_power_of_two(), "losses")?);
        }
        let size = self.losses.as_ref().map_or(0, |l| l.size);
        let groups = self.verdict.as_ref().map_or(0, |v| v.groups().size);
        let tables = self.flights[self.at].tables.need();
        if self.flights.iter().any(|flight| !flight.fits(size, groups, tables)) {
            self.gpu.recorder.idle()?;
            self.flights.iter_mut().try_for_each(|flight| flight.fit(&self.gpu, size, groups, tables))?;
        }
        Ok(())
    }

    /// Makes memory, pipelines and tables of these steps, see [`Engine::prepare`](crate::engine::Engine::prepare).
    pub(super) fn prepare_steps(
        &mut self,
        steps: &mut dyn Iterator<Item = Step>,
        at_once: Option<usize>,
    ) -> Result<(), EngineError> {
        let recorded = self.collect(steps, at_once);
        self.gpu.compile().and(recorded)
    }

    /// Makes memory and tables of these steps, and their pipelines in the background, see
    /// [`Engine::prepare_later`](crate::engine::Engine::prepare_later).
    pub(super) fn prepare_steps_later(
        &mut self,
        steps: &mut dyn Iterator<Item = Step>,
        at_once: usize,
    ) -> Result<(), EngineError> {
        let recorded = self.collect(steps, Some(at_once));
        self.gpu.compile_later().and(recorded)
    }

    /// Records the steps and discards the recordings. Memory and tables that they request are made, and their pipelines
    /// are collected.
    fn collect(&mut self, steps: &mut dyn Iterator<Item = Step>, at_once: Option<usize>) -> Result<(), EngineError> {
        self.gpu.recorder.idle()?;
        self.gpu.want();
        let mut seen = HashSet::new();
        for step in steps {
            self.prepare_step(&step, at_once, &mut seen)?;
        }
        Ok(())
    }

    /// Makes room for a step, and records it if it has new window sizes.
    fn prepare_step(
        &mut self,
        step: &Step,
        at_once: Option<usize>,
        seen: &mut HashSet<[usize; 2]>,
    ) -> Result<(), EngineError> {
        check(step, &(0..step.list.len()), &self.shape, self.views.as_deref())?;
        self.flights[self.at].lay_out(step, &self.shape, self.views.as_deref());
        self.fit_flights()?;
        match at_once {
            Some(count) => self.arenas.fit_any(&mut self.gpu, &step.pupil_passes, count, &self.shape)?,
            None => self.arenas.fit(&mut self.gpu, step, &self.shape)?,
        }
        let windows = step.pupil_passes.iter().map(|pass| [pass.window.rows, pass.window.columns]);
        // This visits all windows, not only those up to the first new one.
        if windows.filter(|window| seen.insert(*window)).count() == 0 {
            return Ok(());
        }
        self.record(step, &step.list.iter().collect::<Vec<_>>(), true, false)
    }
}
