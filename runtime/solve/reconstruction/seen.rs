//! Checks a scene and a pupil against a hologram in memory, and computes the exposed image of an eye.

use super::{ReconstructionError, SceneSource};
use crate::engine::Engine;
use crate::evaluate::Plane;
use crate::hologram::{Hologram, HologramError, SceneRecord};
use crate::optics::{OpticsError, Padding, Pupil};
use crate::scene::LightField;
use crate::solve::{Problem, PupilRange, Sampler, Sequence};

/// Number of pupils that determine the exposures of phases without exposures.
const PUPILS: usize = 16;

impl Hologram {
    /// Refuses a scene that the hologram does not show, or whose light field differs in size from the hologram's
    /// picture.
    ///
    /// # Errors
    /// Returns [`HologramError::OtherScene`] or [`HologramError::OtherSize`].
    pub fn check_shows(&self, record: &SceneRecord, field: &LightField) -> Result<(), HologramError> {
        self.check_is_of(record)?;
        self.check_size(field)
    }

    /// Refuses a light field that differs in size from the hologram's picture.
    ///
    /// # Errors
    /// Returns [`HologramError::OtherSize`] with both sizes.
    pub fn check_size(&self, field: &LightField) -> Result<(), HologramError> {
        let (given, shows) = ((field.height, field.width), self.picture_size());
        if given != shows {
            return Err(HologramError::OtherSize { given, shows });
        }
        Ok(())
    }

    /// Refuses a pupil that no eye has, or that the light of any of its colors does not reach.
    ///
    /// # Errors
    /// Returns the errors of [`Pupil::check_usual`].
    pub fn check_pupil(&self, pupil: Pupil) -> Result<Pupil, OpticsError> {
        let display = self.made_for().ok().filter(|display| !display.sources.is_empty());
        for (at, color) in self.colors.iter().enumerate() {
            match display.as_ref().zip(color.color) {
                Some((display, color)) => display.check_pupil(color, pupil)?,
                None => pupil.check_usual(&self.optics(at)?)?,
            };
        }
        Ok(pupil)
    }

    /// Fits unknown exposures to the scene, one per color for the whole eyebox (OPTICS 2). `field` has its size and its
    /// colors.
    ///
    /// # Errors
    /// Returns the errors of [`made_for`](Self::made_for), [`Problem::new`] and [`score`](Self::score).
    pub fn fit_exposure(&mut self, field: &LightField, engine: &mut dyn Engine) -> Result<(), ReconstructionError> {
        if !self.metadata.exposure_assumed {
            return Ok(());
        }
        let display = self.made_for()?;
        let problem = |color| Problem::new(field, color, &display, Padding::default());
        let problems = self.named_colors().into_iter().map(problem).collect::<Result<Vec<_>, _>>()?;
        // The light is almost the same at every depth, so an uncertain depth is sufficient.
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

    /// Returns the image that an eye sees through a pupil, as one plane of linear light per color. 1 is the scene's
    /// full scale. The distortion of the display's picture is applied.
    ///
    /// # Errors
    /// Returns [`HologramError::NoExposure`], or the errors of [`look`](Self::look).
    pub fn seen(&self, pupil: &Pupil, engine: &mut dyn Engine) -> Result<Vec<Plane>, ReconstructionError> {
        if self.metadata.exposure_assumed {
            return Err(HologramError::NoExposure.into());
        }
        let mut planes = self.as_seen(self.look(pupil, engine)?);
        for (plane, color) in planes.iter_mut().zip(&self.colors) {
            let exposure = color.exposure as f32;
            plane.values.iter_mut().for_each(|value| *value *= exposure);
        }
        Ok(planes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::engine::cpu::CpuEngine;
    use crate::hologram::ColorHologram;
    use crate::optics::{Color, Display};
    use crate::scene::{self, Request};

    #[test]
    fn who_asks_is_told_what_does_not_fit() {
        let display = Display { height: 16, width: 24, ..Display::preset("small").unwrap() };
        let color = ColorHologram {
            color: Some(Color::Green),
            wavelength: 520e-9,
            exposure: 0.5,
            efficiency: 0.5,
            phases: vec![0.5; 16 * 24],
        };
        let mut hologram = Hologram { scene: "builtin:plane".into(), ..Hologram::on(&display, 1, vec![color]) };
        let field = |side| {
            let display = Display { height: side, ..display.clone() };
            scene::load("builtin:plane", &Request { views: 1, ..Request::new(&display, &[Color::Green]) }).unwrap()
        };
        let record = |source| SceneRecord::of_source(source, None).unwrap();
        hologram.check_shows(&record("builtin:plane"), &field(16)).unwrap();
        let refused = |source, side| hologram.check_shows(&record(source), &field(side)).unwrap_err();
        let size = refused("builtin:plane", 20);
        assert!(matches!(size, HologramError::OtherSize { given: (20, 24), shows: (16, 24) }), "{size}");
        let other = refused("builtin:point", 16);
        assert!(matches!(&other, HologramError::OtherScene { given, .. } if given == "builtin:point"), "{other}");

        let pupil = Pupil { x: 1e-3, y: 0.0, diameter: 4e-3, depth: 0.0 };
        assert_eq!(hologram.check_pupil(pupil), Ok(pupil));
        assert!(hologram.check_pupil(Pupil { x: 1.0, ..pupil }).is_err());
        for depth in [1.0, 2e3] {
            let refused = hologram.check_pupil(Pupil { depth, ..pupil });
            assert!(matches!(refused, Err(OpticsError::Unusual { .. })), "{depth} m: {refused:?}");
        }

        let looked = hologram.look(&pupil, &mut CpuEngine::new()).unwrap();
        let seen = hologram.seen(&pupil, &mut CpuEngine::new()).unwrap();
        assert!(looked[0].values.iter().zip(&seen[0].values).all(|(raw, seen)| *seen == raw * 0.5));
        hologram.metadata.exposure_assumed = true;
        assert!(matches!(
            hologram.seen(&pupil, &mut CpuEngine::new()),
            Err(ReconstructionError::Hologram(HologramError::NoExposure))
        ));
    }
}
