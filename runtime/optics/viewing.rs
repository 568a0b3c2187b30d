//! Describes the luminance and the angular resolution of a picture, for visual difference metrics.

use super::OpticsError;
use super::units::within;
use eyebox_base::error::Reason;
use serde::{Deserialize, Serialize};

/// `[viewing]` of a display file. It changes no hologram, only the scores of the image.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
#[non_exhaustive]
pub struct Viewing {
    /// Luminance of white in cd/m2.
    pub luminance_cd_m2: f64,
    /// Luminance of black in cd/m2. It adds to every pixel.
    pub black_cd_m2: f64,
    /// Pixels per degree of visual angle in the middle of the picture. The default is the value of the optics. Examples
    /// for another value are an eyepiece that is not in the file, or a picture that is scored at a coarser resolution.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pixels_per_degree: Option<f64>,
}

impl Default for Viewing {
    /// The values of ColorVideoVDP's `standard_4k`, 200 cd/m2 and a contrast of 1000:1.
    fn default() -> Self {
        Self { luminance_cd_m2: 200.0, black_cd_m2: 0.2, pixels_per_degree: None }
    }
}

impl Viewing {
    /// The same conditions with the given values.
    ///
    /// # Errors
    /// [`OpticsError::Viewing`] for a value out of range.
    pub fn with(
        self,
        luminance_cd_m2: Option<f64>,
        black_cd_m2: Option<f64>,
        pixels_per_degree: Option<f64>,
    ) -> Result<Self, OpticsError> {
        let new = Self {
            luminance_cd_m2: luminance_cd_m2.unwrap_or(self.luminance_cd_m2),
            black_cd_m2: black_cd_m2.unwrap_or(self.black_cd_m2),
            pixels_per_degree: pixels_per_degree.or(self.pixels_per_degree),
        };
        new.check().map_err(|reason| OpticsError::Viewing { reason })?;
        Ok(new)
    }

    /// True if all values are the default.
    pub fn is_default(&self) -> bool {
        *self == Self::default()
    }

    /// Checks the range of every value.
    ///
    /// # Errors
    /// A reason in words.
    pub fn check(&self) -> Result<(), Reason> {
        within("the luminance of white in cd/m2", self.luminance_cd_m2, 0.1, 10_000.0)?;
        within("the luminance of black in cd/m2", self.black_cd_m2, 0.0, self.luminance_cd_m2)?;
        self.pixels_per_degree.map_or(Ok(()), |n| within("the number of pixels per degree", n, 1.0, 10_000.0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Display;
    use eyebox_base::error::ErrorData;

    const BENCH: &str =
        "resolution = [8, 8]\npitch_um = 8.0\nfocal_length_mm = 400.0\nwavelengths_nm = { green = 520 }\n";

    #[test]
    fn a_display_says_how_it_is_seen_or_its_optics_do() {
        let plain = Display::from_toml(BENCH, "b").unwrap();
        // 8 um at 400 mm are 20 microradians.
        assert!((plain.pixels_per_degree() - 1.0 / 20e-6f64.to_degrees()).abs() < 1e-9);
        assert!(plain.viewing.is_default() && !plain.to_toml().contains("viewing"));
        let text = format!("{BENCH}[viewing]\nluminance_cd_m2 = 80\npixels_per_degree = 60\n");
        let display = Display::from_toml(&text, "b").unwrap();
        assert_eq!((display.viewing.luminance_cd_m2, display.pixels_per_degree()), (80.0, 60.0));
        assert_eq!(Display::from_toml(&display.to_toml(), "b").unwrap(), display);
        let given = display.viewing.with(None, Some(0.0), Some(30.0)).unwrap();
        assert_eq!((given.luminance_cd_m2, given.black_cd_m2, given.pixels_per_degree), (80.0, 0.0, Some(30.0)));
    }

    #[test]
    fn what_no_eye_sees_is_refused() {
        for (line, says) in [
            ("luminance_cd_m2 = 0", "display-file/range"),
            ("luminance_cd_m2 = nan", "display-file/range"),
            ("black_cd_m2 = 300", "display-file/range"),
            ("pixels_per_degree = -1", "display-file/range"),
            ("brightness = 3", "display-file/toml"),
        ] {
            let error = Display::from_toml(&format!("{BENCH}[viewing]\n{line}\n"), "b.toml").unwrap_err();
            assert!(error.to_string().contains("b.toml"), "{error}");
            assert_eq!(ErrorData::of(&error).code, says, "{error}");
        }
        assert!(Viewing::default().with(Some(-1.0), None, None).is_err());
    }
}
