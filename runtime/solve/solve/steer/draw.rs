//! Draws the pupils of the next step of a refinement, around the eye and sometimes anywhere.

use super::{DIAMETERS, Drawing, EYES, FIRST_WINDOWS, Refiner, USUAL_EYE};
use crate::engine::EngineError;
use crate::optics::{Pupil, Window};
use crate::plan::{Kernel, Step, Viewpoint};
use crate::solve::sampling::{Diameters, PupilRange};
use crate::solve::step::Update;
use std::collections::HashSet;

impl Refiner {
    /// Makes the device objects for steps over pupils of an eye's size and over pupils of the first aim. Pipelines for
    /// pupils of a usual size are made before this returns, and the others in the background.
    pub(super) fn prepare(&mut self) -> Result<(), EngineError> {
        let [low, high] = self.aim.diameter;
        let (low, high) = (low.min(EYES[0]), high.max(EYES[1]));
        let [x, y] = self.aim.centre;
        let mut seen = HashSet::new();
        let mut viewpoints = Vec::new();
        let diameter = |i: u32| low + (high - low) * f64::from(i) / f64::from(DIAMETERS);
        let mut diameters: Vec<f64> = (0..=DIAMETERS).map(diameter).collect();
        diameters.sort_by(|a, b| (a - USUAL_EYE).abs().total_cmp(&(b - USUAL_EYE).abs()));
        for diameter in diameters {
            let pupil = Pupil { x, y, diameter, depth: 0.0 };
            let window = Window::new(&self.planner.grid, &pupil, self.steering.window);
            if seen.insert((window.rows, window.columns)) {
                viewpoints.push(Viewpoint::Pupil(pupil));
            }
        }
        let later = viewpoints.split_off(FIRST_WINDOWS.min(viewpoints.len()));
        let update = self.steering.strategy.update(1);
        let Self { planner, engine, .. } = self;
        let step =
            |viewpoints: &[Viewpoint]| update.step(planner, update.pupil_passes(planner, viewpoints, self.exposure), 0);
        let at_once = self.steering.pupils + self.steering.elsewhere as usize + 1;
        engine.prepare(&mut std::iter::once(step(&viewpoints)), Some(at_once))?;
        if later.is_empty() {
            return Ok(());
        }
        engine.prepare_later(&mut std::iter::once(step(&later)), at_once)
    }

    /// Draws pupils for the next step around the eye and sometimes anywhere. They are rarer elsewhere if the position
    /// is more certain.
    pub(super) fn draw(&mut self, update: Update) {
        let (aim, eyebox) = (self.aim, self.problem.eyebox);
        (self.drawn_for, self.moved_for) = (aim, self.motion);
        self.drawing.viewpoints.clear();
        let count = self.steering.pupils as f64;
        let elsewhere = aim.elsewhere.clamp(0.0, 1.0);
        // If the eye may be anywhere, some of the pupils around it move elsewhere.
        let moved = (count * (elsewhere - 0.5).max(0.0) * 2.0).floor();
        self.due += self.steering.elsewhere + moved;
        for _ in 0..(count - moved) as usize {
            let pupil = aim.pupil(self.points.draw());
            self.look_through_one(pupil);
        }
        while self.due >= 1.0 || self.drawing.viewpoints.is_empty() {
            self.due -= 1.0;
            let [x, y, d, z] = self.points.draw();
            let pupil = aim.pupil([0.0, 0.0, d, z]);
            if !self.problem.regions.is_empty() {
                let (diameter, depth) = ([pupil.diameter; 2], [pupil.depth; 2]);
                let range = PupilRange { eyebox, diameter, depth, diameters: Diameters::Uniform };
                self.look_through_one(range.within(&self.problem.regions, [d, x, y, z]));
                continue;
            }
            let reach = (eyebox / 2.0 - pupil.diameter / 2.0).max(0.0);
            let [left, top] = self.problem.optics.center();
            let (x, y) = (left + reach * (2.0 * x - 1.0), top + reach * (2.0 * y - 1.0));
            self.look_through_one(Pupil { x, y, ..pupil });
        }
        let Drawing { lists, spare, viewpoints, .. } = &mut self.drawing;
        update.refill(&self.planner, viewpoints, self.exposure, &mut lists.pupil_passes, spare);
        (self.drawing.drawn, self.drawing.used) = (true, 0);
    }

    /// Adds one more pupil, or an eye that moves with it.
    fn look_through_one(&mut self, pupil: Pupil) {
        let (frames, motion) = (self.planner.frames, self.motion);
        let viewpoint = match motion.is_still() {
            true => Viewpoint::Pupil(pupil),
            false => motion.viewpoint(pupil, frames, self.moves.draw()),
        };
        self.drawing.viewpoints.push(viewpoint);
    }

    /// Returns true if the next step draws pupils.
    pub(super) fn is_fresh(&self) -> bool {
        !self.drawing.drawn || self.drawing.used >= self.steering.repeats.max(1)
    }

    /// Returns the index of the pace of the next step.
    pub(in crate::solve) fn kind(&self) -> usize {
        usize::from(!self.is_fresh())
    }

    /// Returns the next step. The parts of its list that have to run are in `drawing`. If the step before had the same
    /// pupils, the parts that depend on pupils alone are left out.
    pub(super) fn next(&mut self) -> Step {
        self.since += 1;
        let update = self.steering.strategy.update(self.since);
        if self.is_fresh() {
            self.draw(update);
        }
        // After a call of `loss`, the next step is still the first one for its pupils.
        let first = self.drawing.used == 0;
        self.drawing.used += 1;
        let mut step = update.step(&self.planner, self.drawing.take_lists(), usize::MAX);
        step.project.step = self.since as u32;
        let known = |kernel| {
            matches!(kernel, Kernel::Transfer | Kernel::Relay | Kernel::Eye | Kernel::Photograph | Kernel::Resample)
        };
        let parts = &mut self.drawing.parts;
        parts.clear();
        for (i, dispatch) in step.list.iter().enumerate().filter(|(_, d)| first || !known(d.kernel)) {
            match parts.last_mut() {
                Some(last) if last.end == i => last.end = i + 1,
                _ => parts.push(i..i + 1),
            }
            debug_assert!(dispatch.pupil_passes.end <= step.pupil_passes.len());
        }
        step
    }
}
