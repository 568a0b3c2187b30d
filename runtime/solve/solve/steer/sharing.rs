//! A refinement of one colour whose phases are its share of drives that several colours move (OPTICS 13).

use super::Refiner;
use crate::engine::{Buffer, Engine, EngineError};
use crate::solve::error::{SolveError, require};
use crate::solve::problem::Problem;
use crate::solve::refine_settings::RefineSettings;
use crate::solve::step::{Turns, ask};

impl Refiner {
    /// [`new`](Self::new) in the light of a laser of these powers, sub-frame by sub-frame, each over their mean.
    ///
    /// # Errors
    /// Those of [`new`](Self::new); [`SolveError::Setting`] for another number of powers, or powers that cannot be.
    pub fn lit_by(
        problem: Problem,
        phases: &[f32],
        exposure: f64,
        powers: &[f64],
        steering: RefineSettings,
        engine: Box<dyn Engine>,
    ) -> Result<Self, SolveError> {
        let frames = phases.len() / (problem.optics.height * problem.optics.width).max(1);
        let mean = powers.iter().sum::<f64>() / powers.len().max(1) as f64;
        let sound = powers.iter().all(|p| p.is_finite() && *p >= 0.0) && (mean - 1.0).abs() < 1e-6;
        let right = "one a sub-frame, 0 or more, with a mean of 1";
        require(powers.len() == frames && sound, "the powers of a laser", format_args!("{powers:?}"), right)?;
        Self::with_powers(problem, phases, exposure, powers, steering, engine)
    }

    /// Takes the next step up to what would move its phases: its loss, how it would move them, and in `change` the change of the field
    /// that it asks for, unless the loss is no finite number.
    pub(in crate::solve) fn ask(&mut self, change: &mut [f32]) -> Result<(f64, Turns), EngineError> {
        let step = self.next();
        let turns = Turns::of(&step);
        let loss = ask(self.engine.as_mut(), &step, &self.drawing.parts, change);
        self.drawing.pixels = self.drawing.take_back(step);
        let loss = loss?;
        if !loss.is_finite() {
            self.drawing.forget();
        }
        Ok((loss, turns))
    }

    /// Has these phases from now on, and counts its steps on.
    pub(in crate::solve) fn show(&mut self, phases: &[f32]) -> Result<(), EngineError> {
        self.engine.write(Buffer::Phases, phases)
    }

    /// Counts its steps anew.
    pub(in crate::solve) fn count_anew(&mut self) {
        self.since = 0;
    }

    /// Whether no step was taken since phases or aim were set anew.
    pub(in crate::solve) fn is_new(&self) -> bool {
        self.since == 0
    }

    /// Values of the change of its field.
    pub(in crate::solve) fn changes(&self) -> usize {
        2 * self.planner.frames * self.planner.grid.height * self.planner.grid.width
    }
}

impl AsRef<Self> for Refiner {
    fn as_ref(&self) -> &Self {
        self
    }
}

impl AsMut<Self> for Refiner {
    fn as_mut(&mut self) -> &mut Self {
        self
    }
}
