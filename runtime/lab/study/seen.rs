//! What an eye sees of the holograms of a study.

use eyebox::low_level::engine::{Engine, EngineError};
use eyebox::low_level::error::Reason;
use eyebox::low_level::evaluate::Sums;
use eyebox::low_level::optics::Pupil;
use eyebox::low_level::session::SessionError;
use eyebox::low_level::session::{LiveColor, Policy};
use eyebox::low_level::solve::{PupilRange, Refiner, Sampler, Sequence};
use std::sync::Arc;

/// Pupils that the exposure is fitted over.
const EXPOSED: usize = 12;

/// What an eye sees of one colour's phases, at an exposure that stays.
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
        // Lasers stay as they are: one exposure, that of the hologram for the whole eyebox.
        let exposure = Sums::fit_exposure(&seen.look(&pupils)?).map_err(|e| SessionError::Setting(Reason::of(&e)))?;
        Ok(Self { seen, exposure })
    }

    /// PSNR through this pupil, dB; `None` if its photograph is black.
    pub(super) fn psnr(&mut self, pupil: Pupil) -> Result<Option<f64>, EngineError> {
        Ok(self.seen.look(&[pupil])?.first().and_then(|sums| sums.quality(self.exposure)))
    }
}
