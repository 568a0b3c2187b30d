//! An eye with an obstruction in its pupil: the relay's table of that one pupil has it (OPTICS 11).
//!
//! Engines multiply each bin by the relay's table already, so an obstruction needs no kernel. The table is made again for each pupil,
//! because marks move with the eye. That is for looking and scoring: a solve never contains an obstruction.

use super::{ModelTables, Planner};
use crate::optics::{Obstruction, Pupil};

impl Planner {
    /// The same for an eye with this pupil, in which there is an obstruction. It is for that pupil alone.
    #[must_use]
    pub fn obstructed(&self, obstruction: Obstruction, pupil: &Pupil) -> Self {
        let ideal = || ModelTables::ideal(&self.modes, self.slm, self.grid);
        let model = self.model.clone().unwrap_or_else(ideal);
        let iris = model.model().true_pupil(pupil);
        Self { model: Some(model.obstructed(obstruction, &iris)), ..self.clone() }
    }
}
