//! Exposures of phases that came without.

use super::{ReconstructionError, SceneSource};
use crate::engine::Engine;
use crate::hologram::Hologram;
use crate::optics::Padding;
use crate::scene::LightField;
use crate::solve::{Problem, PupilRange, Sampler, Sequence};

/// Pupils that decide them.
const PUPILS: usize = 16;

impl Hologram {
    /// Gives it the exposures with which it is most like its scene, one a colour for all of the eyebox (OPTICS 2), where
    /// they are not known. `field` has its size and its colours.
    ///
    /// # Errors
    /// Those of [`made_for`](Self::made_for), of [`Problem::new`] and [`score`](Self::score).
    pub fn fit_exposure(&mut self, field: &LightField, engine: &mut dyn Engine) -> Result<(), ReconstructionError> {
        if !self.metadata.exposure_assumed {
            return Ok(());
        }
        let display = self.made_for()?;
        let problem = |color| Problem::new(field, color, &display, Padding::default());
        let problems = self.named_colors().into_iter().map(problem).collect::<Result<Vec<_>, _>>()?;
        // Light is much the same at every depth: a doubtful one will do.
        let range = PupilRange::over(display.eyebox_min(), field.reach(&display).0);
        let mut sampler = Sampler::new(range, Sequence::Sobol, self.seed);
        let pupils: Vec<_> = (0..PUPILS).map(|_| sampler.draw()).collect();
        let means: Vec<f64> = problems.iter().map(|p| p.mean).collect();
        let fitted = self.score(&SceneSource::from(problems), &pupils, engine)?.exposures;
        for ((color, exposure), mean) in self.colors.iter_mut().zip(fitted).zip(means) {
            (color.exposure, color.efficiency) = (exposure, mean / exposure);
        }
        self.metadata.exposure_assumed = false;
        Ok(())
    }
}
