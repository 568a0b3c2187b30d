//! Adds a static mask in front of the SLM to a display (OPTICS 12).

use super::{Display, Geometry, Mask};
use eyebox_base::error::Reason;
use eyebox_base::reason;

impl Display {
    /// Mask pixels per SLM pixel along an axis, or 1 without a mask.
    pub fn mask_factor(&self) -> usize {
        self.mask.as_ref().map_or(1, |mask| mask.factor.max(1))
    }

    /// The same display with this mask, or without one.
    ///
    /// # Errors
    /// The property of the display that does not fit the mask.
    pub fn with_mask(&self, mask: Option<Mask>) -> Result<Self, Reason> {
        let display = Self { mask, ..self.clone() };
        display.check_mask()?;
        Ok(display)
    }

    /// Turns of this wavelength's light (meters) per turn of the mask's phases.
    pub fn mask_slope(&self, wavelength: f64) -> f64 {
        let longest = self.wavelengths.iter().map(|w| w.wavelength).fold(0.0, f64::max);
        let meant = self.mask.as_ref().and_then(|mask| mask.wavelength_nm).map_or(longest, |nm| nm * 1e-9);
        meant / wavelength
    }

    /// Checks the mask on this display.
    pub(super) fn check_mask(&self) -> Result<(), Reason> {
        let Some(mask) = &self.mask else { return Ok(()) };
        mask.check()?;
        if self.geometry == Geometry::FarField {
            return Err(reason!("mask-without-relay", "only an SLM behind a relay has a mask: leave it out"));
        }
        let largest = self.height.max(self.width) * mask.factor;
        if largest > 65536 {
            return Err(reason!("mask-pixels", "{largest} mask pixels along an axis: give at most 65536"));
        }
        for color in self.wavelengths.iter().map(|w| w.color) {
            if self.model(color).subpixels > 1 {
                return Err(reason!(
                    "mask-and-subpixels",
                    "[model] has subpixels in {color}, which the mask's pixels replace: leave them out"
                ));
            }
            if mask.distance_mm > 0.0 && self.modes(color).iter().any(|mode| mode.angle != [0.0; 2]) {
                let why = "a source off the axis lights a mask at a distance with an offset";
                return Err(reason!(
                    "mask-and-source",
                    "{why}: leave out distance_mm of the mask, or the {color} source off the axis"
                ));
            }
        }
        Ok(())
    }
}
