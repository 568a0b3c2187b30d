//! What should be seen: a scene before a display, photographed through any pupil.

use super::{ReconstructionError, Sampling};
use crate::engine::{Engine, Purpose};
use crate::evaluate::{self, Plane, Views};
use crate::optics::{Display, OpticsError, Padding, Pupil, WindowFactor};
use crate::scene::LightField;
use crate::solve::Problem;
use std::sync::Arc;

/// A scene before a display, in some of its colours.
#[non_exhaustive]
pub enum SceneSource {
    /// All views of its light field, colour by colour.
    Whole(Vec<Problem>),
    /// A far field larger than memory: views are made from around each pupil.
    Around(Vec<Views>),
}

impl From<Vec<Problem>> for SceneSource {
    fn from(problems: Vec<Problem>) -> Self {
        Self::Whole(problems)
    }
}

impl SceneSource {
    /// A light field that has the display's size, in all of its colours. Its views are given up one colour at a time.
    ///
    /// # Errors
    /// A colour that the display does not have.
    pub fn new(mut field: LightField, display: &Display) -> Result<Self, OpticsError> {
        let mut problems = Vec::with_capacity(field.colors.len());
        for (i, color) in field.colors.clone().into_iter().enumerate() {
            problems.push(Problem::new(&field, color, display, Padding::default())?);
            field.planes[i] = Vec::new();
        }
        Ok(Self::Whole(problems))
    }

    /// How many colours it has.
    pub fn colors(&self) -> usize {
        match self {
            Self::Whole(problems) => problems.len(),
            Self::Around(views) => views.len(),
        }
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.colors() == 0
    }

    /// The photograph in every colour through one pupil (OPTICS 3): linear light, in the samples of
    /// [`PhaseSource::look`](crate::hologram::PhaseSource::look).
    ///
    /// # Errors
    /// Those of the engine.
    pub fn photograph(&self, pupil: &Pupil, engine: &mut dyn Engine) -> Result<Vec<Plane>, ReconstructionError> {
        let one = |color| Ok(self.photographs(color, &[*pupil], Sampling::Picture, engine)?.remove(0));
        (0..self.colors()).map(one).collect()
    }

    /// The same of one colour through several pupils, sampled as asked.
    ///
    /// # Errors
    /// Those of the engine.
    ///
    /// # Panics
    /// If there is no such colour: the caller's mistake.
    pub fn photographs(
        &self,
        color: usize,
        pupils: &[Pupil],
        sampling: Sampling,
        engine: &mut dyn Engine,
    ) -> Result<Vec<Plane>, ReconstructionError> {
        match self {
            Self::Whole(problems) => {
                let problem = &problems[color];
                let planner = problem.planner(1, WindowFactor::Full);
                engine.load(&planner.shape(Purpose::View), Some(Arc::clone(&problem.pyramid)))?;
                let (rows, columns) = problem.optics.image_size();
                let taken = evaluate::photographs(engine, &planner, pupils)?;
                Ok(taken.into_iter().map(|values| Plane { rows, columns, values }).collect())
            }
            Self::Around(views) => {
                let views = &views[color];
                let one = |pupil| {
                    let image = views.photograph(&views.piece(pupil), pupil, sampling.factor(), engine)?;
                    Ok(sampling.picture(image, views.share()))
                };
                pupils.iter().map(one).collect()
            }
        }
    }
}
