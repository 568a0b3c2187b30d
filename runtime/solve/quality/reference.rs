//! Scores all settings against one reference.
//!
//! It uses the same pupils for all, the full window, every view, the padding that the scene requires, the SLM's levels,
//! and one exposure.

use super::{ColorJob, QualityError};
use crate::engine::{Buffer, Engine};
use crate::evaluate::{self, Ceiling, JodMetric, Plane, Summary};
use crate::optics::{Pupil, WindowFactor};
use crate::plan::{Planner, Purpose, Viewpoint};
use crate::solve::{Diameters, Levels, Problem, PupilRange, Sampler, Sequence, ValidationScore, Validator};
use std::sync::Arc;

/// Number of pupils of a score. They are random by the paper's distribution, and no solve uses them.
pub const PUPILS: usize = 16;

/// Scores holograms of one color of a scene.
pub struct Reference {
    problem: Problem,
    planner: Planner,
    validator: Validator,
    unit: f64,
    levels: Levels,
    pixels: usize,
    /// The pupils of the scores.
    pub(super) pupils: Vec<Pupil>,
}

impl Reference {
    /// Prepares the reference of this job. The seed decides the pupils and must differ from the seed of the solves.
    ///
    /// # Errors
    /// [`QualityError`] for a wrong color, and if the engine fails.
    pub fn new(job: &ColorJob, seed: u64, engine: &mut dyn Engine) -> Result<Self, QualityError> {
        let problem = Problem::new(job.field, job.color, job.display, job.required_padding()?)?;
        let mut planner = problem.planner(1, WindowFactor::Full);
        let unit = problem.unit();
        if let Some(views) = &mut planner.views {
            views.unit /= unit;
        }
        let range = PupilRange { diameters: Diameters::Uniform, ..job.base.pupil_range(problem.eyebox) };
        // These pupils differ from the pupils of solves and validations, which use their own seed and its complement.
        let mut sampler = Sampler::new(range, Sequence::Random, seed ^ 0x7265_6665_7265_6e63);
        let pupils: Vec<Pupil> = (0..PUPILS).map(|_| sampler.draw()).collect();
        let viewpoints = pupils.iter().map(|p| Viewpoint::Pupil(*p)).collect();
        engine.load(&planner.shape(Purpose::View), Some(Arc::clone(&problem.pyramid)))?;
        let validator = Validator::new(engine, &planner, viewpoints)?;
        let pixels = problem.optics.height * problem.optics.width;
        Ok(Self { problem, planner, validator, unit, levels: job.levels.clone(), pixels, pupils })
    }

    /// Returns the reference for an SLM with other levels.
    #[must_use]
    pub fn with_levels(self, levels: Levels) -> Self {
        Self { levels, ..self }
    }

    /// Scores phases (frames, height, width) as the SLM shows them.
    ///
    /// # Errors
    /// [`QualityError::Engine`] if the engine fails.
    pub fn score(&self, phases: &[f32], engine: &mut dyn Engine) -> Result<ValidationScore, QualityError> {
        let mut planner = Planner { frames: phases.len() / self.pixels.max(1), ..self.planner.clone() };
        planner.levels = self.levels.count();
        self.show(phases, &planner, engine)?;
        Ok(self.validator.score(engine, &planner)?.in_units_of(self.unit))
    }

    /// Returns the mean and worst JOD of phases (frames, height, width) through `most` of the pupils, spread evenly.
    ///
    /// It uses the exposure of their score. It compares whole pictures, which are the mean of the sub-frames in one
    /// color, with their target images. The result is `None` for pictures that have no JOD.
    ///
    /// # Errors
    /// [`QualityError`] if the engine fails, and with an [`EvaluateError`](evaluate::EvaluateError) for pictures that
    /// are not finite.
    pub fn judge(
        &self,
        phases: &[f32],
        exposure: f64,
        metric: &JodMetric,
        most: usize,
        engine: &mut dyn Engine,
    ) -> Result<Option<[f64; 2]>, QualityError> {
        let count = most.min(self.pupils.len());
        let pupils: Vec<Pupil> = (0..count).map(|i| self.pupils[i * self.pupils.len() / count]).collect();
        let frames = phases.len() / self.pixels.max(1);
        let levels = self.levels.count();
        let planner = Planner { frames, levels, ..self.problem.planner(1, WindowFactor::Full) };
        self.show(phases, &planner, engine)?;
        let seen = evaluate::views(engine, &planner, &pupils)?;
        let wanted = evaluate::photographs(engine, &planner, &pupils)?;
        let (rows, columns) = planner.slm.image_size();
        let mut jod = Vec::new();
        for (mut seen, wanted) in seen.into_iter().zip(wanted) {
            seen.iter_mut().for_each(|v| *v *= exposure as f32);
            let judged = metric.picture(&[&seen; 3].map(|p| &p[..]), &[&wanted; 3].map(|p| &p[..]), rows, columns)?;
            jod.extend(judged.map(|judged| judged.jod));
        }
        Ok(Summary::of(&jod).map(|jod| [jod.mean, jod.worst]))
    }

    /// Loads phases on the engine as the SLM shows them.
    fn show(&self, phases: &[f32], planner: &Planner, engine: &mut dyn Engine) -> Result<(), QualityError> {
        engine.load(&planner.shape(Purpose::View), Some(Arc::clone(&self.problem.pyramid)))?;
        if let Some(levels) = self.levels.table() {
            engine.write(Buffer::Levels, &levels)?;
        }
        Ok(engine.write(Buffer::Phases, phases)?)
    }

    /// Returns the mean and worst ceiling in dB ([`Ceiling`]). The result is `None` if the picture fills a part of the
    /// field of view, or if diffraction takes nothing through some pupil.
    ///
    /// # Errors
    /// [`QualityError::Engine`] if the engine fails.
    pub fn ceiling(&self, engine: &mut dyn Engine) -> Result<Option<[f64; 2]>, QualityError> {
        let (problem, planner) = (&self.problem, self.problem.planner(1, WindowFactor::Full));
        if planner.share < 1.0 {
            return Ok(None);
        }
        engine.load(&planner.shape(Purpose::View), Some(Arc::clone(&problem.pyramid)))?;
        let (rows, columns) = planner.slm.image_size();
        let of = |(pupil, values): (&Pupil, Vec<f32>)| {
            let photograph = Plane { rows, columns, values }.pooled();
            Ceiling::decibels([&Ceiling::new(&planner.slm, pupil, &photograph)])
        };
        let photographs = evaluate::photographs(engine, &planner, &self.pupils)?;
        let all: Vec<f64> = self.pupils.iter().zip(photographs).map(of).collect();
        let mean = all.iter().sum::<f64>() / all.len() as f64;
        Ok(mean.is_finite().then(|| [mean, all.iter().copied().fold(mean, f64::min)]))
    }
}
