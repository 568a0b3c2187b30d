//! Computes the target images of a scene in front of a display, through any pupil.

use super::{ReconstructionError, Sampling};
use crate::engine::{Engine, Purpose};
use crate::evaluate::{self, Plane, Views};
use crate::optics::{Display, OpticsError, Padding, Pupil, WindowFactor};
use crate::scene::LightField;
use crate::solve::Problem;
use std::sync::Arc;

/// A scene in front of a display, in some of its colors.
#[non_exhaustive]
pub enum SceneSource {
    /// All views of its light field, color by color.
    Whole(Vec<Problem>),
    /// A far field larger than memory, whose views are made around each pupil.
    Around(Vec<Views>),
}

impl From<Vec<Problem>> for SceneSource {
    fn from(problems: Vec<Problem>) -> Self {
        Self::Whole(problems)
    }
}

impl SceneSource {
    /// Creates it from a light field of the display's size, in all of its colors. The views are released color by
    /// color.
    ///
    /// # Errors
    /// Returns an error for a color that the display does not have.
    pub fn new(mut field: LightField, display: &Display) -> Result<Self, OpticsError> {
        let mut problems = Vec::with_capacity(field.colors.len());
        for (i, color) in field.colors.clone().into_iter().enumerate() {
            problems.push(Problem::new(&field, color, display, Padding::default())?);
            field.planes[i] = Vec::new();
        }
        Ok(Self::Whole(problems))
    }

    /// Returns the number of its colors.
    pub fn colors(&self) -> usize {
        match self {
            Self::Whole(problems) => problems.len(),
            Self::Around(views) => views.len(),
        }
    }

    /// Returns true if it has no colors.
    pub fn is_empty(&self) -> bool {
        self.colors() == 0
    }

    /// Returns the target image in every color through one pupil (OPTICS 3). It is linear light, in the samples of
    /// [`PhaseSource::look`](crate::hologram::PhaseSource::look).
    ///
    /// # Errors
    /// Returns the errors of the engine.
    pub fn photograph(&self, pupil: &Pupil, engine: &mut dyn Engine) -> Result<Vec<Plane>, ReconstructionError> {
        let one = |color| Ok(self.photographs(color, &[*pupil], Sampling::Picture, engine)?.remove(0));
        (0..self.colors()).map(one).collect()
    }

    /// Returns the target images of one color through several pupils, with the given sampling.
    ///
    /// # Errors
    /// Returns the errors of the engine.
    ///
    /// # Panics
    /// Panics if the color does not exist, which is a mistake of the caller.
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
