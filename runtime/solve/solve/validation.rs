//! Measures quality on validation pupils, which the optimizer never receives.

use super::exposure::BrightEnd;
use crate::engine::{Engine, EngineError};
use crate::evaluate::{self, Sums};
use crate::optics::{Geometry, mean_light};
use crate::plan::{Moving, Planner, Viewpoint};

/// Lowest power of the remaining light by which solves are exposed (measured).
const LEAST_POWER: f64 = 0.5;
/// Limits of strong and of weak crosstalk (measured). The values are the share of the variance of random drive values
/// that it leaves, the steps of a solve that is exposed for the remaining light, and the highest power of that light.
const STRONG: [f64; 3] = [0.6, 60.0, 1.0];
const WEAK: [f64; 3] = [0.8, 30.0, 1.5];

/// Fixed viewpoints that no step draws, with their target images.
pub struct Validator {
    viewpoints: Vec<Viewpoint>,
    /// The bright end of the target images under the light of the display's sources.
    bright_end: BrightEnd,
    /// Share of the light that pixels with an aperture leave through these viewpoints, relative to an SLM of points.
    aperture_light: f64,
    /// Share of the variance of random drive values that crosstalk leaves.
    variance_left: f64,
}

/// Quality on validation pupils. The exposure is the least-squares fit over all of them.
pub type ValidationScore = crate::evaluate::Scores;

impl Validator {
    /// Computes the target images. `engine` holds the views.
    ///
    /// # Errors
    /// [`EngineError`] if the engine fails.
    pub fn new(engine: &mut dyn Engine, planner: &Planner, viewpoints: Vec<Viewpoint>) -> Result<Self, EngineError> {
        let photographs = evaluate::targets(engine, planner, &viewpoints)?;
        let bright_end = BrightEnd::of(photographs.iter().map(|p| &p[..])).lit(mean_light(&planner.modes));
        let aperture_light = aperture_light(planner, &viewpoints);
        Ok(Self { viewpoints, bright_end, aperture_light, variance_left: planner.variance_left() })
    }

    /// Returns the bright end of the target images for a solve of `steps` steps of the projection.
    ///
    /// A solve that is exposed for light which the aperture removes chases light that does not exist. A short solve is
    /// better exposed for more light than exists, because it has no time to move light. A long solve is better exposed
    /// for less, because the edge of the eyebox has less light than the mean. This holds only if crosstalk lets it
    /// direct the rest away (docs/results/display-model.json).
    pub(crate) fn bright_end(&self, steps: usize) -> BrightEnd {
        let weakness = ((self.variance_left - STRONG[0]) / (WEAK[0] - STRONG[0])).clamp(0.0, 1.0);
        let [for_all, most] = [1, 2].map(|i| STRONG[i] + weakness * (WEAK[i] - STRONG[i]));
        let power = (steps as f64 / for_all).sqrt().clamp(LEAST_POWER, most);
        self.bright_end.lit(self.aperture_light.powf(power))
    }

    /// Scores the phases that `engine` holds. Only sums leave the engine.
    ///
    /// # Errors
    /// [`EngineError`] if the engine fails.
    pub fn score(&self, engine: &mut dyn Engine, planner: &Planner) -> Result<ValidationScore, EngineError> {
        let sums = evaluate::sums(engine, planner, &self.viewpoints)?;
        // Images that are black (or not finite) have no exposure. Any value is allowed, and their PSNR shows the fault.
        let exposure = Sums::fit_exposure(&sums).unwrap_or(1.0);
        Ok(ValidationScore::at(&sums, exposure))
    }
}

/// Returns the mean share of the light that pixels with an aperture leave through viewpoints, relative to an SLM of
/// points.
fn aperture_light(planner: &Planner, viewpoints: &[Viewpoint]) -> f64 {
    let Some(model) = planner.model.as_ref().filter(|_| planner.slm.geometry == Geometry::Relay) else { return 1.0 };
    let eyebox = planner.slm.eyebox();
    let through = viewpoints.iter().map(|viewpoint| match viewpoint {
        Viewpoint::Pupil(pupil) | Viewpoint::Moving(Moving { pupil, .. }) => {
            model.model().aperture_light(&model.model().true_pupil(pupil), eyebox)
        }
        Viewpoint::Stft { .. } => 1.0,
    });
    through.sum::<f64>() / viewpoints.len().max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::engine::cpu::CpuEngine;
    use crate::optics::{Color, Display, DisplayModel, Padding, Pupil, Spread};
    use crate::plan::{ModelTables, Purpose};
    use crate::scene::{self, Request};
    use crate::solve::{Problem, Settings};
    use std::sync::Arc;

    /// If pixels have an aperture, the exposure follows the light that it leaves through the pupils. Short solves
    /// follow it less, and long ones more.
    #[test]
    fn an_exposure_follows_the_light_that_the_aperture_leaves() {
        let display = Display { height: 48, width: 64, ..Display::preset("paper").unwrap() };
        let field = scene::load("builtin:still-life", &Request::new(&display, &[Color::Green])).unwrap();
        let plain = Problem::new(&field, Color::Green, &display, Padding::default()).unwrap();
        let pupils = [[6.0, 0.0, 8.0, 0.0], [-7.0, 7.0, 5.0, 0.0]].map(Pupil::from_mm);
        let exposure = |problem: &Problem, steps| {
            let planner = problem.planner_of(&Settings { frames: 1, ..Settings::default() });
            let mut engine = CpuEngine::new();
            engine.load(&planner.shape(Purpose::View), Some(Arc::clone(&problem.pyramid))).unwrap();
            let viewpoints = pupils.map(Viewpoint::Pupil).to_vec();
            Validator::new(&mut engine, &planner, viewpoints).unwrap().bright_end(steps).guess()
        };
        let filled = |crosstalk: Option<[Spread; 4]>| {
            let model = DisplayModel { fill: 0.95, crosstalk, ..DisplayModel::default() };
            let model = ModelTables::new(model, 11e-3, 256, plain.optics, plain.optics);
            Problem { model, ..plain.clone() }
        };
        let model = DisplayModel { fill: 0.95, ..DisplayModel::default() };
        let left = pupils.iter().map(|pupil| model.aperture_light(pupil, plain.optics.eyebox())).sum::<f64>() / 2.0;
        let strong = [Spread { q: 1.2, sigma: 1.0 }; 4];
        let weak = [(0, 0.5), (7, 0.5), (30, 1.0), (60, 2f64.sqrt()), (600, 1.5)].map(|row| (None, row));
        let strong = [(0, 0.5), (15, 0.5), (30, 0.5f64.sqrt()), (60, 1.0), (600, 1.0)].map(|row| (Some(strong), row));
        for (crosstalk, (steps, power)) in weak.into_iter().chain(strong) {
            let ratio = exposure(&filled(crosstalk), steps) / exposure(&plain, steps);
            let off = ratio * left.powf(power) - 1.0;
            assert!(left < 0.8 && off.abs() < 1e-9, "{left} remains, {ratio} times the exposure for {steps} steps");
        }
    }
}
