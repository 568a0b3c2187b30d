//! Pupils, and what is seen through them in numbers.

use crate::failure::Failure;
use eyebox::hologram::Hologram;
use eyebox::optics::Pupil;
use eyebox::reconstruction::PupilScore;

/// Where the eye's pupil is, how wide it is, and where it focuses. Metres.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct EyeboxPupil {
    /// Centre, to the right (along columns).
    pub x_m: f64,
    /// Centre, down (along rows).
    pub y_m: f64,
    /// Diameter; an eye's is 2e-3 to 8e-3.
    pub diameter_m: f64,
    /// Where it focuses, from the SLM's image; positive is nearer.
    pub depth_m: f64,
}

impl EyeboxPupil {
    /// A pupil that the hologram's light reaches, such as eyes have.
    pub(crate) fn before(self, hologram: &Hologram) -> Result<Pupil, Failure> {
        let Self { x_m: x, y_m: y, diameter_m: diameter, depth_m: depth } = self;
        Ok(hologram.check_pupil(Pupil { x, y, diameter, depth })?)
    }
}

/// What a pupil sees, against what it should see.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct EyeboxScore {
    /// PSNR over all colors, dB; NaN if the target is black.
    pub psnr_db: f64,
    /// The most that any hologram could have there, dB; NaN where it is not known.
    pub ceiling_db: f64,
    /// Mean SSIM over the colours; NaN where the picture is smaller than SSIM's window.
    pub ssim: f64,
    /// PSNR of the image past an obstruction against the image that the same hologram shows a clear pupil, dB; NaN for a clear pupil.
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
