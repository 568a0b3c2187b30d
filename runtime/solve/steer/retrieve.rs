//! Beginning with phases that fit any picture a little: one step of phase retrieval from them.

use super::Refiner;
use crate::engine::{Buffer, EngineError};
use crate::solve::steering::Strategy;

/// The step of the retrieval. Of a small change of the field a phase can follow one half, and the other half goes elsewhere: a gain of
/// 2 makes up for it, and some more for larger changes (measured: the best is between 2.5 and 3, from random as from fitted phases).
/// Nothing is kept of where phases went before.
const RETRIEVAL: Strategy =
    Strategy::Projection { gain: 2.7, settled: 2.7, settling: 1.0, momentum: 0.0, overlap_power: 1.0 };

impl Refiner {
    /// Begins again with phases that are no picture's own, such as [`fixed_phases`](crate::solve::fixed_phases), by one step of phase
    /// retrieval: through the pupils of a step their retinal fields are given the picture's amplitude (OPTICS 6b), and the phase of
    /// what comes back is taken, as far as phases can follow. Returns the loss before it. Counts as the first step.
    ///
    /// # Errors
    /// Those of the engine.
    pub fn retrieve(&mut self, fixed: &[f32]) -> Result<f64, EngineError> {
        self.settle()?;
        self.restart(fixed)?;
        let usual = self.steering.strategy;
        if matches!(usual, Strategy::Projection { .. }) {
            self.steering.strategy = RETRIEVAL;
        }
        let loss = self.step();
        self.steering.strategy = usual;
        loss
    }

    /// Goes on with phases that it had before, for the same eye: the steps since it came there still count, velocities do not.
    ///
    /// # Errors
    /// Those of the engine.
    pub fn go_on_with(&mut self, phases: &[f32]) -> Result<(), EngineError> {
        self.settle()?;
        self.engine.write(Buffer::Phases, phases)?;
        self.engine.clear_moments()
    }
}
