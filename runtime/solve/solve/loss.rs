//! What the difference of a picture and its photograph is measured in.

use super::error::SolveError;
use crate::plan::ContrastLoss;
use serde::{Deserialize, Serialize};
use std::f64::consts::FRAC_PI_2;

/// What a solve makes small.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[non_exhaustive]
pub enum Loss {
    /// Differences of light, or of amplitude, every pixel and every spatial frequency alike: PSNR's.
    #[default]
    Light,
    /// Differences of contrast, weighted by the eye's contrast sensitivity at the display's pixels a degree and luminance
    /// ([`ContrastLoss`]).
    Contrast,
}

impl Loss {
    /// Both.
    pub const ALL: [Self; 2] = [Self::Light, Self::Contrast];

    /// As on the command line and in files.
    pub fn name(self) -> &'static str {
        ["light", "contrast"][self as usize]
    }

    /// Refuses a gaze that cannot be, or that is of no use.
    pub(super) fn check(self, gaze: Option<[f64; 2]>) -> Result<(), SolveError> {
        let Some(gaze) = gaze else { return Ok(()) };
        let wrong = |value: String, right| Err(SolveError::Setting { what: "the gaze (degrees)", value, right });
        if !gaze.iter().all(|angle| angle.abs() <= FRAC_PI_2) {
            return wrong(format!("{:?}", gaze.map(f64::to_degrees)), "within 90 of the picture's middle");
        }
        if self == Self::Light {
            return wrong("given".into(), "none for the loss of light, or the loss of contrast (`loss` contrast)");
        }
        Ok(())
    }

    /// What images are compared by whose contrasts are seen so, for an eye that looks there; none for light.
    ///
    /// # Errors
    /// [`SolveError::Setting`] where it is not known how the display is seen.
    pub(super) fn of(
        self,
        gaze: Option<[f64; 2]>,
        contrast: Option<ContrastLoss>,
    ) -> Result<Option<ContrastLoss>, SolveError> {
        match (self, contrast) {
            (Self::Light, _) => Ok(None),
            (Self::Contrast, Some(contrast)) => Ok(Some(ContrastLoss { gaze, ..contrast })),
            (Self::Contrast, None) => {
                let right = "light, for a hologram whose display is not known";
                Err(SolveError::Setting { what: "the loss", value: self.name().into(), right })
            }
        }
    }

    /// Whether it is what files of earlier versions have.
    pub(super) fn is_light(&self) -> bool {
        *self == Self::Light
    }
}
