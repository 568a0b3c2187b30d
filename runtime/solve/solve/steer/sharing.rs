//! Refines one color whose phases follow from drive values that several colors move (OPTICS 13).

use super::Refiner;
use crate::engine::{Buffer, Engine, EngineError};
use crate::solve::error::{SolveError, require};
use crate::solve::problem::Problem;
use crate::solve::refine_settings::RefineSettings;
use crate::solve::step::{Turns, ask};

impl Refiner {
    /// Starts as [`new`](Self::new) does, in the light of a laser of these powers per sub-frame, each relative to their
    /// mean.
    ///
    /// # Errors
    /// The errors of [`new`](Self::new), and [`SolveError::Setting`] for another number of powers or for invalid
    /// powers.
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
        let right = "one per sub-frame, 0 or more, with a mean of 1";
        require(powers.len() == frames && sound, "the powers of a laser", format_args!("{powers:?}"), right)?;
        Self::with_powers(problem, phases, exposure, powers, steering, engine)
    }

    /// Runs the next step without the move of its phases.
    ///
    /// It returns the loss and the data for the move. `change` receives the requested change of the field if the loss
    /// is finite.
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

    /// Sets the phases and continues the count of steps.
    pub(in crate::solve) fn show(&mut self, phases: &[f32]) -> Result<(), EngineError> {
        self.engine.write(Buffer::Phases, phases)
    }

    /// Restarts the count of steps.
    pub(in crate::solve) fn count_anew(&mut self) {
        self.since = 0;
    }

    /// Returns true if no step was taken since new phases or a new aim.
    pub(in crate::solve) fn is_new(&self) -> bool {
        self.since == 0
    }

    /// Returns the number of values of the change of its field.
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
