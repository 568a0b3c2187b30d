//! Reconstructs the image at the eye of the holograms of a study.

use eyebox::low_level::engine::{Engine, EngineError};
use eyebox::low_level::error::Reason;
use eyebox::low_level::evaluate::Sums;
use eyebox::low_level::optics::Pupil;
use eyebox::low_level::session::SessionError;
use eyebox::low_level::session::{LiveColor, Policy};
use eyebox::low_level::solve::{PupilRange, Refiner, Sampler, Sequence};
use std::sync::Arc;

/// The number of pupils over which the exposure is fitted.
const EXPOSED: usize = 12;

/// The reconstruction of one color's phases at a constant exposure.
pub(super) struct SeenColor {
    pub(super) seen: Refiner,
    pub(super) exposure: f64,
}

impl SeenColor {
    pub(super) fn new(
        color: &LiveColor,
        policy: &Policy,
        depth: f64,
        engine: Box<dyn Engine>,
    ) -> Result<Self, SessionError> {
        let problem = color.problem.clone();
        let range = PupilRange::over(problem.eyebox, [depth, depth]);
        let regions = Arc::clone(&problem.regions);
        let (phases, exposure, steering) = (&color.phases, color.exposure, policy.steering);
        let mut seen = match &color.laser {
            Some(laser) => Refiner::lit_by(problem, phases, exposure, &laser.powers, steering, engine)?,
            None => Refiner::new(problem, phases, exposure, steering, engine)?,
        };
        let mut sampler = Sampler::new(range, Sequence::Sobol, 0x006a_7564_6765).over(regions);
        let pupils: Vec<Pupil> = (0..EXPOSED).map(|_| sampler.draw()).collect();
        // The lasers do not change, so there is one exposure, which is fitted to the hologram for the whole eyebox.
        let exposure = Sums::fit_exposure(&seen.look(&pupils)?).map_err(|e| SessionError::Setting(Reason::of(&e)))?;
        Ok(Self { seen, exposure })
    }

    /// Returns the PSNR through this pupil, in dB. `None` if the target image is black.
    pub(super) fn psnr(&mut self, pupil: Pupil) -> Result<Option<f64>, EngineError> {
        Ok(self.seen.look(&[pupil])?.first().and_then(|sums| sums.quality(self.exposure)))
    }
}
