//! The truth that all settings are scored by: the same pupils for all, the full window, every view, the padding that the
//! scene requires, the SLM's levels, and one exposure.

use super::{QualityError, Subject};
use crate::engine::{Buffer, Engine};
use crate::evaluate::{self, Ceiling, Plane};
use crate::optics::{Pupil, WindowFactor};
use crate::plan::{Planner, Purpose, Viewpoint};
use crate::solve::{Diameters, Levels, Problem, PupilRange, Sampler, Sequence, Settings, ValidationScore, Validator};
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
    pupils: Vec<Pupil>,
}

impl Reference {
    /// For this subject; the seed decides the pupils, and is to be another than that of the solves.
    ///
    /// # Errors
    /// [`QualityError`].
    pub fn new(subject: &Subject, seed: u64, engine: &mut dyn Engine) -> Result<Self, QualityError> {
        let problem = Problem::new(subject.field, subject.color, subject.display, subject.required_padding()?)?;
        let mut planner = problem.planner(1, WindowFactor::Full);
        let unit = problem.unit();
        if let Some(views) = &mut planner.views {
            views.unit /= unit;
        }
        let Settings { diameter, depth, .. } = subject.base;
        let range = PupilRange { eyebox: problem.eyebox, diameter, depth, diameters: Diameters::Uniform };
        // Apart from the pupils that solves draw and validate by, which are of their own seed and its complement.
        let mut sampler = Sampler::new(range, Sequence::Random, seed ^ 0x7265_6665_7265_6e63);
        let pupils: Vec<Pupil> = (0..PUPILS).map(|_| sampler.draw()).collect();
        let viewpoints = pupils.iter().map(|p| Viewpoint::Pupil(*p)).collect();
        engine.load(&planner.shape(Purpose::View), Some(Arc::clone(&problem.pyramid)))?;
        let validator = Validator::new(engine, &planner, viewpoints)?;
        let pixels = problem.optics.height * problem.optics.width;
        Ok(Self { problem, planner, validator, unit, levels: subject.levels.clone(), pixels, pupils })
    }

    /// The same, for an SLM of other levels.
    pub(crate) fn with_levels(self, levels: Levels) -> Self {
        Self { levels, ..self }
    }

    /// Phases (frames, height, width), as the SLM shows them.
    ///
    /// # Errors
    /// Those of the engine.
    pub fn score(&self, phases: &[f32], engine: &mut dyn Engine) -> Result<ValidationScore, QualityError> {
        let mut planner = Planner { frames: phases.len() / self.pixels.max(1), ..self.planner.clone() };
        planner.levels = self.levels.count();
        engine.load(&planner.shape(Purpose::View), Some(Arc::clone(&self.problem.pyramid)))?;
        if let Some(levels) = self.levels.table() {
            engine.write(Buffer::Levels, &levels)?;
        }
        engine.write(Buffer::Phases, phases)?;
        Ok(self.validator.score(engine, &planner)?.in_units_of(self.unit))
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

    /// The pupils that it looks through.
    pub fn pupils(&self) -> Vec<Pupil> {
        self.pupils.clone()
    }
}
