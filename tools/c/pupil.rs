//! Pupils and their scores.

use crate::failure::Failure;
use eyebox::hologram::Hologram;
use eyebox::optics::Pupil;
use eyebox::reconstruction::PupilScore;

/// The position, diameter and focus of a pupil of the eye, in meters.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct EyeboxPupil {
    /// Center of the pupil along the columns (m). Positive values are to the right.
    pub x_m: f64,
    /// Center of the pupil along the rows (m). Positive values are down.
    pub y_m: f64,
    /// Diameter of the pupil (m). The diameter of an eye's pupil is 2e-3 to 8e-3.
    pub diameter_m: f64,
    /// Depth of the focus, measured from the SLM's image (m). Positive values are nearer to the eye.
    pub depth_m: f64,
}

impl EyeboxPupil {
    /// Returns the pupil, or an error if no eye has such a pupil or the light of the hologram does not reach it.
    pub(crate) fn before(self, hologram: &Hologram) -> Result<Pupil, Failure> {
        let Self { x_m: x, y_m: y, diameter_m: diameter, depth_m: depth } = self;
        Ok(hologram.check_pupil(Pupil { x, y, diameter, depth })?)
    }
}

/// The score of an image through one pupil against the target image.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct EyeboxScore {
    /// PSNR over all colors (dB). It is NaN if the target is black.
    pub psnr_db: f64,
    /// The ceiling, which is the highest PSNR of any hologram through this pupil (dB). It is NaN if it is unknown.
    pub ceiling_db: f64,
    /// Mean SSIM over the colors. It is NaN if the picture is smaller than SSIM's window.
    pub ssim: f64,
    /// PSNR of the image with an obstruction against the image of the same hologram through a clear pupil (dB). It is
    /// NaN for a clear pupil.
    pub against_clear_db: f64,
}

impl From<&PupilScore> for EyeboxScore {
    fn from(score: &PupilScore) -> Self {
        let known = |value: Option<f64>| value.unwrap_or(f64::NAN);
        Self {
            psnr_db: known(score.psnr),
            ceiling_db: known(score.ceiling),
            ssim: known(score.ssim),
            against_clear_db: known(score.against_clear),
        }
    }
}
