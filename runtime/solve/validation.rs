//! Quality on validation pupils: those that the optimiser is not shown.

use super::exposure::BrightEnd;
use crate::engine::{Engine, EngineError};
use crate::evaluate::{self, Sums};
use crate::optics::mean_light;
use crate::plan::{Planner, Viewpoint};

/// Fixed viewpoints that no step draws, and what should be seen through them.
pub struct Validator {
    viewpoints: Vec<Viewpoint>,
    /// The bright end of the photographs.
    bright_end: BrightEnd,
}

/// Quality on validation pupils: the exposure is the least-squares fit over all of them.
pub type ValidationScore = crate::evaluate::Scores;

impl Validator {
    /// Looks at the photographs; `engine` holds the views.
    ///
    /// # Errors
    /// Those of the engine.
    pub fn new(engine: &mut dyn Engine, planner: &Planner, viewpoints: Vec<Viewpoint>) -> Result<Self, EngineError> {
        let photographs = evaluate::targets(engine, planner, &viewpoints)?;
        let bright_end = BrightEnd::of(photographs.iter().map(|p| &p[..])).lit(mean_light(&planner.modes));
        Ok(Self { viewpoints, bright_end })
    }

    /// The bright end of the photographs.
    pub(crate) fn bright_end(&self) -> BrightEnd {
        self.bright_end
    }

    /// Scores the phases that `engine` holds; only sums leave it.
    ///
    /// # Errors
    /// Those of the engine.
    pub fn score(&self, engine: &mut dyn Engine, planner: &Planner) -> Result<ValidationScore, EngineError> {
        let sums = evaluate::sums(engine, planner, &self.viewpoints)?;
        // Images that are black (or not finite) have no exposure: any will do, their PSNR says it.
        let exposure = Sums::fit_exposure(&sums).unwrap_or(1.0);
        Ok(ValidationScore::at(&sums, exposure))
    }
}
