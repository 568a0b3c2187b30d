//! Computes the JOD at the end of a fixation.

use super::results::Judging;
use super::seen::SeenColor;
use eyebox::low_level::error::Reason;
use eyebox::low_level::evaluate::{JodMetric, rgb};
use eyebox::low_level::optics::{Color, Pupil};
use eyebox::low_level::session::SessionError;

/// Judges the images at the eye of all colors together.
pub(super) struct Judge {
    metric: JodMetric,
    colors: Vec<Color>,
}

impl Judge {
    /// Makes the judge for these viewing conditions.
    ///
    /// # Errors
    /// Returns [`SessionError::Setting`] for invalid viewing conditions.
    pub(super) fn new(judging: &Judging) -> Result<Self, SessionError> {
        let metric = JodMetric::new(&judging.viewing, judging.pixels_per_degree, false);
        let metric = metric.map_err(|e| SessionError::Setting(Reason::of(&e)))?;
        Ok(Self { metric, colors: judging.colors.clone() })
    }

    /// Returns the JOD through this pupil of two holograms of one scene, against its target image. Returns `None` for
    /// pictures without a JOD.
    ///
    /// # Errors
    /// Returns the errors of the engines, and [`SessionError::Setting`] for values that are no picture.
    pub(super) fn both(
        &self,
        holograms: [&mut Vec<SeenColor>; 2],
        pupil: Pupil,
    ) -> Result<Option<[f64; 2]>, SessionError> {
        let mut jod = [0.0; 2];
        for (jod, hologram) in jod.iter_mut().zip(holograms) {
            let Some(found) = self.one(hologram, pupil)? else { return Ok(None) };
            *jod = found;
        }
        Ok(Some(jod))
    }

    fn one(&self, hologram: &mut [SeenColor], pupil: Pupil) -> Result<Option<f64>, SessionError> {
        let (mut seen, mut wanted, mut size) = (Vec::new(), Vec::new(), (0, 0));
        for color in hologram {
            let exposure = color.exposure as f32;
            let [mut light, photograph] = color.seen.pictures(pupil)?;
            light.iter_mut().for_each(|v| *v *= exposure);
            seen.push(light);
            wanted.push(photograph);
            size = color.seen.problem().optics.image_size();
        }
        let black = vec![0.0; size.0 * size.1];
        let [seen, wanted] = [&seen, &wanted].map(|planes| {
            planes.iter().enumerate().map(|(i, p)| (self.colors.get(i).copied(), p.as_slice())).collect::<Vec<_>>()
        });
        let found = self.metric.picture(&rgb(&seen, &black), &rgb(&wanted, &black), size.0, size.1);
        let found = found.map_err(|e| SessionError::Setting(Reason::of(&e)))?;
        Ok(found.map(|judged| judged.jod))
    }
}
