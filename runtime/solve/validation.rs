//! Quality on validation pupils: those that the optimiser is not shown.

use super::exposure::BrightEnd;
use crate::engine::{Engine, EngineError};
use crate::evaluate::{self, Sums};
use crate::plan::{Planner, Viewpoint};

/// Fixed viewpoints that no step draws, and what should be seen through them.
pub struct Validator {
    viewpoints: Vec<Viewpoint>,
    /// The bright end of the photographs.
    bright_end: BrightEnd,
}

/// Quality on validation pupils.
#[derive(Debug, Clone, PartialEq)]
pub struct ValidationScore {
    /// PSNR per pupil, dB, after 2 x 2 averaging, with one exposure for all.
    pub psnr: Vec<f64>,
    /// That exposure: the least-squares fit over all pupils.
    pub exposure: f64,
}

impl ValidationScore {
    /// Mean over pupils, dB.
    pub fn mean(&self) -> f64 {
        self.psnr.iter().sum::<f64>() / self.psnr.len().max(1) as f64
    }

    /// For targets that were divided by `unit`: the exposure and the errors that they stand for.
    pub(crate) fn in_units_of(mut self, unit: f64) -> Self {
        self.exposure *= unit;
        self.psnr.iter_mut().for_each(|db| *db -= 20.0 * unit.log10());
        self
    }

    /// The worst pupil, dB.
    pub fn worst(&self) -> f64 {
        self.psnr.iter().copied().fold(f64::INFINITY, f64::min)
    }
}

impl Validator {
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

    /// Scores the phases that `engine` holds; only sums leave it.
    ///
    /// # Errors
    /// Those of the engine.
    pub fn score(&self, engine: &mut dyn Engine, planner: &Planner) -> Result<ValidationScore, EngineError> {
        let sums = evaluate::sums(engine, planner, &self.viewpoints)?;
        // Images that are black (or not finite) have no exposure: any will do, their PSNR says it.
        let exposure = Sums::fit_exposure(&sums).unwrap_or(1.0);
        Ok(ValidationScore { psnr: sums.iter().map(|s| s.psnr(exposure)).collect(), exposure })
    }
}
