//! A hologram that is refined while it is in use: all colours, for where the pupil is.

use super::{Hologram, HologramError};
use crate::engine::{Engine, EngineError};
use crate::optics::PupilDistribution;
use crate::scene::LightField;
use crate::solve::{Problem, Refiner, Steering};

/// All colours of a hologram under refinement, each on an engine of its own.
pub struct Refinement {
    hologram: Hologram,
    refiners: Vec<Refiner>,
}

impl Hologram {
    /// What it was solved for: its scene before its display, colour by colour, with the padding that it was solved with.
    ///
    /// # Errors
    /// [`HologramError::NoDisplay`]; [`HologramError::Optics`] for a scene without one of its colours.
    pub fn problems(&self, field: &LightField) -> Result<Vec<Problem>, HologramError> {
        let (display, padding) = (self.made_for()?, self.metadata.padding());
        self.named_colors().into_iter().map(|c| Ok(Problem::new(field, c, &display, padding)?)).collect()
    }

    /// Refuses a hologram whose colours share their sub-frames, which cannot be `what` colour by colour.
    ///
    /// # Errors
    /// [`HologramError::SharesSubFrames`].
    pub fn check_apart(&self, what: &'static str) -> Result<(), HologramError> {
        if self.metadata.joint_color.is_some() { Err(HologramError::SharesSubFrames { what }) } else { Ok(()) }
    }

    /// Begins to refine it for where the pupil is. `field` is its scene; `open` opens an engine for each colour.
    ///
    /// # Errors
    /// Those of [`check_apart`](Self::check_apart), of [`problems`](Self::problems), of [`Refiner::new`] and of `open`.
    pub fn refine(
        self,
        field: &LightField,
        steering: Steering,
        mut open: impl FnMut() -> Result<Box<dyn Engine>, EngineError>,
    ) -> Result<Refinement, HologramError> {
        self.check_apart("refined")?;
        let begin = |(problem, color): (Problem, &super::ColorHologram)| {
            Ok(Refiner::new(problem, &color.phases, color.exposure, steering, open()?)?)
        };
        let refiners =
            self.problems(field)?.into_iter().zip(&self.colors).map(begin).collect::<Result<_, HologramError>>()?;
        Ok(Refinement { hologram: self, refiners })
    }
}

impl Refinement {
    /// The pupil is there from now on, as far as is known.
    ///
    /// # Errors
    /// Those of the engines.
    pub fn set_pupil(&mut self, pupil: PupilDistribution) -> Result<(), EngineError> {
        self.refiners.iter_mut().try_for_each(|r| r.aim(pupil))
    }

    /// One step of every colour. Returns the mean loss: squared difference in linear light over the pupils of the step; not
    /// finite where no step was taken.
    ///
    /// # Errors
    /// Those of the engines.
    pub fn step(&mut self) -> Result<f64, EngineError> {
        let losses = self.refiners.iter_mut().map(Refiner::step).collect::<Result<Vec<_>, _>>()?;
        Ok(losses.iter().sum::<f64>() / losses.len().max(1) as f64)
    }

    /// The hologram as it is now.
    ///
    /// # Errors
    /// Those of the engines.
    pub fn hologram(&mut self) -> Result<&Hologram, EngineError> {
        for (color, refiner) in self.hologram.colors.iter_mut().zip(&mut self.refiners) {
            color.phases = refiner.phases()?;
            if let Some(name) = color.color {
                self.hologram.metadata.sources.light_only(name, refiner.sources());
            }
        }
        Ok(&self.hologram)
    }
}
