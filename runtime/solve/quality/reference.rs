//! The truth that all settings are scored by: the same pupils for all, the full window, every view, the padding that the
//! scene requires, the SLM's levels, and one exposure.

use super::{ColorJob, QualityError};
use crate::engine::{Buffer, Engine};
use crate::evaluate::{self, Ceiling, JodMetric, Plane, Summary};
use crate::optics::{Pupil, WindowFactor};
use crate::plan::{Planner, Purpose, Viewpoint};
use crate::solve::{Diameters, Levels, Problem, PupilRange, Sampler, Sequence, ValidationScore, Validator};
use std::sync::Arc;

/// Pupils of a score: random, by the paper's distribution, none of them shown to any solve.
pub const PUPILS: usize = 16;

/// Scores holograms of one colour of a scene.
pub struct Reference {
    problem: Problem,
    planner: Planner,
    validator: Validator,
    unit: f64,
    levels: Levels,
    pixels: usize,
    /// The pupils that it looks through.
    pub(super) pupils: Vec<Pupil>,
}

impl Reference {
    /// For this job; the seed decides the pupils, and is to be another than that of the solves.
    ///
    /// # Errors
    /// [`QualityError`].
    pub fn new(job: &ColorJob, seed: u64, engine: &mut dyn Engine) -> Result<Self, QualityError> {
        let problem = Problem::new(job.field, job.color, job.display, job.required_padding()?)?;
        let mut planner = problem.planner(1, WindowFactor::Full);
        let unit = problem.unit();
        if let Some(views) = &mut planner.views {
            views.unit /= unit;
        }
        let range = PupilRange { diameters: Diameters::Uniform, ..job.base.pupil_range(problem.eyebox) };
        // Apart from the pupils that solves draw and validate by, which are of their own seed and its complement.
        let mut sampler = Sampler::new(range, Sequence::Random, seed ^ 0x7265_6665_7265_6e63);
        let pupils: Vec<Pupil> = (0..PUPILS).map(|_| sampler.draw()).collect();
        let viewpoints = pupils.iter().map(|p| Viewpoint::Pupil(*p)).collect();
        engine.load(&planner.shape(Purpose::View), Some(Arc::clone(&problem.pyramid)))?;
        let validator = Validator::new(engine, &planner, viewpoints)?;
        let pixels = problem.optics.height * problem.optics.width;
        Ok(Self { problem, planner, validator, unit, levels: job.levels.clone(), pixels, pupils })
    }

    /// The same, for an SLM of other levels.
    #[must_use]
    pub fn with_levels(self, levels: Levels) -> Self {
        Self { levels, ..self }
    }

    /// Phases (frames, height, width), as the SLM shows them.
    ///
    /// # Errors
    /// Those of the engine.
    pub fn score(&self, phases: &[f32], engine: &mut dyn Engine) -> Result<ValidationScore, QualityError> {
        let mut planner = Planner { frames: phases.len() / self.pixels.max(1), ..self.planner.clone() };
        planner.levels = self.levels.count();
        self.show(phases, &planner, engine)?;
        Ok(self.validator.score(engine, &planner)?.in_units_of(self.unit))
    }

    /// Mean and worst JOD of phases (frames, height, width) through `most` of the pupils, spread evenly, at the exposure of their score: of
    /// whole pictures, the mean of their sub-frames in one colour beside its photograph. None for pictures that have no JOD.
    ///
    /// # Errors
    /// Those of the engine; [`EvaluateError`](evaluate::EvaluateError) for pictures that hold no numbers.
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

    /// Phases on the engine, as the SLM shows them.
    fn show(&self, phases: &[f32], planner: &Planner, engine: &mut dyn Engine) -> Result<(), QualityError> {
        engine.load(&planner.shape(Purpose::View), Some(Arc::clone(&self.problem.pyramid)))?;
        if let Some(levels) = self.levels.table() {
            engine.write(Buffer::Levels, &levels)?;
        }
        Ok(engine.write(Buffer::Phases, phases)?)
    }

    /// Mean and worst dB that any hologram could have ([`Ceiling`]); none where it is not known, where the picture is a part
    /// of the field of view, or where diffraction takes nothing through some pupil.
    ///
    /// # Errors
    /// Those of the engine.
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
