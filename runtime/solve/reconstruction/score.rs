//! Scores a hologram against its scene.

use super::{ReconstructionError, Sampling, SceneSource};
use crate::engine::Engine;
use crate::evaluate::{Ceiling, Plane, Summary, Sums, ssim_at};
use crate::hologram::{Hologram, HologramError, PhaseSource};
use crate::optics::Pupil;
use eyebox_base::reason;

/// The number of pupils whose pictures are in memory at once.
const AT_ONCE: usize = 64;

/// The scores of one pupil over all colors.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PupilScore {
    /// The pupil, in meters.
    pub pupil: Pupil,
    /// PSNR over all colors with the same weight for every pixel, in dB. It is `None` if the target is black.
    pub psnr: Option<f64>,
    /// The highest PSNR of any hologram through this pupil ([`Ceiling`]), in dB. It is infinite if diffraction causes
    /// no loss. It is none if it cannot be computed, for tiles and if the picture is a part of the field of view.
    pub ceiling: Option<f64>,
    /// The finest detail that all colors can have through this pupil, in cycles per degree.
    pub finest_cycles_per_degree: f64,
    /// Mean SSIM over the colors. It is none if the picture is smaller than SSIM's window.
    pub ssim: Option<f64>,
    /// PSNR of the image with an obstruction against the image of the same hologram through a clear pupil, over all
    /// colors, in dB. It is none for a clear pupil, or if the clear pupil receives no light.
    pub against_clear: Option<f64>,
    /// Quality in JOD, 10 at most, over all colors. It is none unless it was [computed](PhaseSource::judge).
    pub jod: Option<f64>,
    /// JOD at the gaze direction alone ([`JodSettings::gaze`](super::JodSettings::gaze)).
    pub jod_there: Option<f64>,
}

/// The scores of a hologram.
#[derive(Debug, Clone, PartialEq)]
pub struct HologramScores {
    /// One score for each pupil, in their order.
    pub pupils: Vec<PupilScore>,
    /// For each color, the exposure that was fitted over all pupils.
    pub exposures: Vec<f64>,
}

impl HologramScores {
    /// Returns a summary of the PSNR over the pupils whose target is not black, or `None` without any.
    pub fn summary(&self) -> Option<Summary> {
        self.summary_of(|pupil| pupil.psnr)
    }

    /// Returns a summary of another score over the pupils that have it, or `None` if no pupil has it.
    pub fn summary_of(&self, score: impl Fn(&PupilScore) -> Option<f64>) -> Option<Summary> {
        Summary::of(&self.pupils.iter().filter_map(score).collect::<Vec<_>>())
    }
}

impl PhaseSource<'_> {
    /// Compares the images through pupils with the target images of the scene, after 2 x 2 averaging. One exposure per
    /// color is used for all pupils (OPTICS 2 and 8). The scene has the hologram's colors in their order.
    ///
    /// # Errors
    /// Returns [`HologramError::Inconsistent`] for a scene of other colors, [`ReconstructionError::Evaluate`] for a
    /// color without light, and the errors of [`look`](Self::look).
    pub fn score(
        &self,
        scene: &SceneSource,
        pupils: &[Pupil],
        engine: &mut dyn Engine,
    ) -> Result<HologramScores, ReconstructionError> {
        let (has, given) = (self.about().colors.len(), scene.colors());
        if has != given {
            let reason = reason!("colors-count", "it has {has} colors, but the scene has {given}");
            return Err(HologramError::Inconsistent(reason).into());
        }
        let optics = (0..has).map(|color| self.about().optics(color)).collect::<Result<Vec<_>, _>>()?;
        let mut exposures = Vec::with_capacity(has);
        let mut sums: Vec<Vec<(Sums, f64)>> = vec![Vec::with_capacity(has); pupils.len()];
        let mut ssims: Vec<Option<f64>> = vec![Some(0.0); pupils.len()];
        let clear = self.about().metadata.obstruction.map(|_| self.clone().obstructed(None));
        let mut against_clear: Vec<Vec<(Sums, f64)>> = vec![Vec::with_capacity(has); pupils.len()];
        let mut ceilings: Vec<Vec<Ceiling>> = vec![Vec::with_capacity(has); pupils.len()];
        for color in 0..has {
            let pairs =
                |pupils: &[Pupil], engine: &mut dyn Engine| -> Result<Vec<(Plane, Plane)>, ReconstructionError> {
                    let wanted = scene.photographs(color, pupils, Sampling::Pupil, engine)?;
                    let seen = self.look_through(color, None, pupils, Sampling::Pupil, engine)?;
                    Ok(seen.iter().map(Plane::pooled).zip(wanted.iter().map(Plane::pooled)).collect())
                };
            // The ceiling exists if the picture of this color has all frequencies of the SLM.
            let is_whole = matches!(self, Self::Whole(_)) && self.about().picture_share(color) == 1.0;
            let whole = is_whole.then(|| &optics[color]);
            let (mut of_color, mut kept) = (Vec::with_capacity(pupils.len()), Vec::new());
            for some in pupils.chunks(AT_ONCE) {
                kept = pairs(some, engine)?;
                for (pupil, (seen, wanted)) in some.iter().zip(&kept) {
                    ceilings[of_color.len()].extend(whole.map(|optics| Ceiling::new(optics, pupil, wanted)));
                    of_color.push(Sums::of_images(&seen.values, &wanted.values)?);
                }
            }
            let exposure = Sums::fit_exposure(&of_color)?;
            sums.iter_mut().zip(of_color).for_each(|(sums, of_color)| sums.push((of_color, exposure)));
            // The exposure is fitted after all pupils. For many pupils, their pictures are computed a second time.
            let of_pupils = ssims.chunks_mut(AT_ONCE).zip(against_clear.chunks_mut(AT_ONCE));
            for (some, (ssims, against_clear)) in pupils.chunks(AT_ONCE).zip(of_pupils) {
                let made = if pupils.len() > AT_ONCE { pairs(some, engine)? } else { std::mem::take(&mut kept) };
                for ((seen, wanted), sum) in made.iter().zip(ssims) {
                    let one = ssim_at(exposure, &seen.values, &wanted.values, seen.rows, seen.columns)?;
                    *sum = sum.zip(one).map(|(sum, one)| sum + one);
                }
                let Some(clear) = &clear else { continue };
                // The target is the image through the clear pupil at the same exposure.
                let targets = clear.look_through(color, None, some, Sampling::Pupil, engine)?;
                for (((seen, _), target), sums) in made.iter().zip(&targets).zip(against_clear) {
                    let target: Vec<f32> = target.pooled().values.iter().map(|v| v * exposure as f32).collect();
                    sums.push((Sums::of_images(&seen.values, &target)?, exposure));
                }
            }
            exposures.push(exposure);
        }
        let finest = |d: f64| optics.iter().map(|o| o.finest_cycles_per_degree(d)).fold(f64::INFINITY, f64::min);
        let score = |(i, pupil): (usize, &Pupil)| PupilScore {
            pupil: *pupil,
            psnr: Sums::quality_of_colors(&sums[i]),
            ceiling: (ceilings[i].len() == has).then(|| Ceiling::decibels(&ceilings[i])),
            finest_cycles_per_degree: finest(pupil.diameter),
            ssim: ssims[i].map(|sum| sum / has as f64),
            against_clear: Sums::quality_of_colors(&against_clear[i]),
            jod: None,
            jod_there: None,
        };
        Ok(HologramScores { pupils: pupils.iter().enumerate().map(score).collect(), exposures })
    }
}

impl Hologram {
    /// Scores this hologram with [`PhaseSource::score`].
    ///
    /// # Errors
    /// Returns the errors of [`PhaseSource::score`].
    pub fn score(
        &self,
        scene: &SceneSource,
        pupils: &[Pupil],
        engine: &mut dyn Engine,
    ) -> Result<HologramScores, ReconstructionError> {
        PhaseSource::from(self).score(scene, pupils, engine)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::engine::cpu::CpuEngine;
    use crate::hologram::ColorHologram;
    use crate::optics::{Color, Display};
    use crate::scene::{self, Request};

    /// The pictures of few pupils are kept, and pictures of many are computed twice. Both must give the same scores.
    #[test]
    fn many_pupils_score_as_few_do() {
        let display = Display { height: 24, width: 24, ..Display::preset("small").unwrap() };
        let field =
            scene::load("builtin:plane", &Request { views: 3, ..Request::new(&display, &[Color::Green]) }).unwrap();
        let scene = SceneSource::new(field, &display).unwrap();
        let color = ColorHologram {
            color: Some(Color::Green),
            wavelength: 520e-9,
            exposure: 0.4,
            efficiency: 0.4,
            phases: (0..576).map(|i| (i * 37 % 100) as f32 * 0.06 - 3.0).collect(),
        };
        let hologram = Hologram { height: 24, width: 24, ..Hologram::on(&display, 1, vec![color]) };
        let few: Vec<Pupil> =
            (0..7).map(|i| Pupil::from_mm([f64::from(i) - 3.0, 1.0, 4.0 + f64::from(i), 0.0])).collect();
        let many = few.repeat(AT_ONCE / 3);
        let mut engine = CpuEngine::new();
        let [few, many] = [&few, &many].map(|pupils| hologram.score(&scene, pupils, &mut engine).unwrap());
        let near = |a: f64, b: f64| a == b || (a - b).abs() < 1e-5 * a.abs().max(1.0);
        assert!(near(few.exposures[0], many.exposures[0]) && many.pupils.len() > AT_ONCE);
        for (one, other) in few.pupils.iter().cycle().zip(&many.pupils) {
            let same = one.pupil == other.pupil && near(one.psnr.unwrap(), other.psnr.unwrap());
            assert!(same && near(one.ssim.unwrap(), other.ssim.unwrap()), "{one:?} {other:?}");
            assert!(near(one.ceiling.unwrap(), other.ceiling.unwrap()), "{one:?} {other:?}");
        }
    }
}
