//! Quality on pupils that the optimiser is not shown.

use super::exposure::BrightEnd;
use crate::engine::{Engine, EngineError};
use crate::evaluate::{self, Sums};
use crate::plan::{Planner, Viewpoint};

/// Fixed viewpoints, and what should be seen through them.
pub struct Judge {
    viewpoints: Vec<Viewpoint>,
    /// The bright end of the photographs.
    bright_end: BrightEnd,
}

/// What a judge found: the exposure is the least-squares fit over all pupils.
pub use crate::evaluate::Scores as Verdict;

impl Judge {
    /// Looks at the photographs; `engine` holds the views.
    ///
    /// # Errors
    /// Those of the engine.
    pub fn new(engine: &mut dyn Engine, planner: &Planner, viewpoints: Vec<Viewpoint>) -> Result<Self, EngineError> {
        let photographs = evaluate::targets(engine, planner, &viewpoints)?;
        let bright_end = BrightEnd::of(photographs.iter().map(|p| &p[..]));
        Ok(Self { viewpoints, bright_end })
    }

    /// The bright end of the photographs.
    pub fn bright_end(&self) -> BrightEnd {
        self.bright_end
    }

    /// Judges the phases that `engine` holds; only sums leave it.
    ///
    /// # Errors
    /// Those of the engine.
    pub fn judge(&self, engine: &mut dyn Engine, planner: &Planner) -> Result<Verdict, EngineError> {
        let sums = evaluate::sums(engine, planner, &self.viewpoints)?;
        // Images that are black (or not finite) have no exposure: any will do, their PSNR says it.
        let exposure = Sums::fit_exposure(&sums).unwrap_or(1.0);
        Ok(Verdict { psnr: sums.iter().map(|s| s.psnr(exposure)).collect(), exposure })
    }
}
