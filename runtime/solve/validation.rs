//! Quality on validation pupils: those that the optimiser is not shown.

use super::exposure::BrightEnd;
use crate::engine::{Engine, EngineError};
use crate::evaluate::{self, Sums};
use crate::optics::{Geometry, mean_light};
use crate::plan::{Moving, Planner, Viewpoint};

/// Fixed viewpoints that no step draws, and what should be seen through them.
pub struct Validator {
    viewpoints: Vec<Viewpoint>,
    /// The bright end of the photographs, for the light that the display has.
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
        let light = mean_light(&planner.modes) * light_left(planner, &viewpoints);
        let bright_end = BrightEnd::of(photographs.iter().map(|p| &p[..])).lit(light);
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

/// The light for which a solve behind these viewpoints is exposed, over what an SLM of points would give. Pixels with an aperture leave the
/// mean of what they leave through each pupil; a solve that is exposed for more chases light which is not there. Short solves do better with more
/// than that: its root serves both (docs/displays.md).
fn light_left(planner: &Planner, viewpoints: &[Viewpoint]) -> f64 {
    let Some(model) = planner.model.as_ref().filter(|_| planner.slm.geometry == Geometry::Relay) else { return 1.0 };
    let eyebox = planner.slm.eyebox();
    let through = viewpoints.iter().map(|viewpoint| match viewpoint {
        Viewpoint::Pupil(pupil) | Viewpoint::Moving(Moving { pupil, .. }) => {
            model.model().aperture_light(&model.model().true_pupil(pupil), eyebox)
        }
        Viewpoint::Stft { .. } => 1.0,
    });
    (through.sum::<f64>() / viewpoints.len().max(1) as f64).sqrt()
}
