//! Converts depths to diopters, and writes depths as text.

use eyebox_base::quantity::{CM, D, Dimension, M, MM, Quantity, QuantityError};
use serde::{Deserialize, Serialize};
use std::{fmt, str::FromStr};

/// The accommodation, in diopters, that focusing at `depth` requires from the eye, `D = z / f^2` (OPTICS 9). `depth` is
/// in meters, positive towards the eye. The last lens of the relay shows content that far inside its focus at the
/// distance `f^2 / z` (Newton's form of the lens equation). Depth 0 is at infinity, and no relaxed eye is in focus
/// below it. `focal_length` is in meters.
pub fn dioptres(depth: f64, focal_length: f64) -> f64 {
    depth / (focal_length * focal_length)
}

/// The depth in meters at which an eye with this accommodation in diopters is in focus, `z = f^2 D`. It is the inverse
/// of [`dioptres`].
pub fn depth_of_dioptres(dioptres: f64, focal_length: f64) -> f64 {
    dioptres * focal_length * focal_length
}

/// A depth (meters) in both units, such as `1.50 mm (0.009 D)`.
pub fn depth_in_words(depth: f64, focal_length: f64) -> String {
    format!("{:.2} mm ({})", depth * 1e3, dioptres_in_words(depth, focal_length))
}

/// A range of depths (meters) in both units, such as `-3.00..3.25 mm (-0.019..0.020 D)`.
pub fn depths_in_words(depths: [f64; 2], focal_length: f64) -> String {
    let [far, near] = depths.map(|z| z * 1e3);
    let [from, to] = depths.map(|z| dioptres_in_words(z, focal_length).trim_end_matches(" D").to_owned());
    format!("{far:.2}..{near:.2} mm ({from}..{to} D)")
}

/// A depth (meters) in diopters, such as `0.009 D`.
pub fn dioptres_in_words(depth: f64, focal_length: f64) -> String {
    let value = dioptres(depth, focal_length);
    // Three decimals are 160 um behind a lens of 400 mm. No result is -0.
    format!("{:.3} D", if value.abs() < 5e-4 { 0.0 } else { value })
}

/// A depth as users write it, in meters or in diopters. Diopters become meters with the focal length of the display.
/// Text is in millimeters, or has a unit, such as `-0.5D`. A text in meters or centimeters is a distance from the eye,
/// so `2m` is `0.5D`. JSON holds a number or such a text.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "Written", into = "Written")]
pub enum Depth {
    /// A depth in meters, positive towards the eye.
    Metres(f64),
    /// A depth in diopters, positive nearer to the eye.
    Dioptres(f64),
}

impl Depth {
    /// The depth in meters for a display of this focal length (meters).
    pub fn metres(self, focal_length: f64) -> f64 {
        match self {
            Self::Metres(metres) => metres,
            Self::Dioptres(value) => depth_of_dioptres(value, focal_length),
        }
    }
}

/// Larger depths are rejected, in mm or in diopters.
const FARTHEST: f64 = 1e9;

impl FromStr for Depth {
    type Err = QuantityError;

    fn from_str(text: &str) -> Result<Self, QuantityError> {
        Self::of(Quantity::read(text, MM, &[Dimension::Vergence])?)
    }
}

impl Depth {
    /// Reads a depth that must have a unit.
    ///
    /// # Errors
    /// [`QuantityError`] if the text is something else.
    pub fn read_with_unit(text: &str) -> Result<Self, QuantityError> {
        Self::of(Quantity::read_with_unit(text, MM, &[Dimension::Vergence])?)
    }

    fn of(quantity: Quantity<'_>) -> Result<Self, QuantityError> {
        // Depths are millimeters of the image behind the relay, which nobody measures in meters.
        let (depth, value) = match quantity.unit() {
            D => (Self::Dioptres(quantity.value_in(D)), quantity.value_in(D)),
            M | CM => (Self::Dioptres(1.0 / quantity.value_in(M)), 1.0 / quantity.value_in(M)),
            _ => (Self::Metres(quantity.value_in(MM) * 1e-3), quantity.value_in(MM)),
        };
        if value.abs() <= FARTHEST { Ok(depth) } else { Err(quantity.out_of_range("1e9 mm or 1e9 D at most")) }
    }
}

impl fmt::Display for Depth {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        match self {
            Self::Metres(metres) => write!(f, "{}", metres * 1e3),
            Self::Dioptres(value) => f.write_str(&D.text(*value)),
        }
    }
}

/// A depth as JSON holds it.
#[derive(Serialize, Deserialize)]
#[serde(untagged)]
enum Written {
    Millimetres(f64),
    Text(String),
}

impl TryFrom<Written> for Depth {
    type Error = QuantityError;

    fn try_from(written: Written) -> Result<Self, QuantityError> {
        match written {
            Written::Millimetres(value) => Ok(Self::Metres(value * 1e-3)),
            Written::Text(text) => text.parse(),
        }
    }
}

impl From<Depth> for Written {
    fn from(depth: Depth) -> Self {
        match depth {
            Depth::Metres(metres) => Self::Millimetres(metres * 1e3),
            Depth::Dioptres(_) => Self::Text(depth.to_string()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_depth_is_a_vergence() {
        // 160 mm of depth behind a lens of 400 mm are one diopter. Nearer is more.
        assert!((dioptres(0.16, 0.4) - 1.0).abs() < 1e-12 && dioptres(-0.16, 0.4) < 0.0);
        assert!((depth_of_dioptres(dioptres(3e-3, 0.4), 0.4) - 3e-3).abs() < 1e-15);
        assert_eq!(depth_in_words(1.5e-3, 0.4), "1.50 mm (0.009 D)");
        assert_eq!(depths_in_words([-3e-3, 3.25e-3], 0.4), "-3.00..3.25 mm (-0.019..0.020 D)");
        assert_eq!(dioptres_in_words(-1e-6, 0.4), "0.000 D");
    }

    #[test]
    fn depths_are_read_in_both_units() {
        let read = |text: &str| text.parse::<Depth>().map(|d| (d.metres(0.4) * 1e6).round());
        assert_eq!(read("1500um"), Ok(1500.0));
        assert_eq!("2m".parse(), Ok(Depth::Dioptres(0.5)));
        assert_eq!("-25 cm".parse(), Ok(Depth::Dioptres(-4.0)));
        assert_eq!(read("1.5"), Ok(1500.0));
        assert_eq!(read("-1.5 mm"), Ok(-1500.0));
        assert_eq!(read("0.5D"), Ok(80_000.0));
        assert_eq!(read(" -0.01 d"), Ok(-1600.0));
        for bad in ["", "D", "x", "nan", "infD", "0m", "2 D D", "1s", "1e99"] {
            assert!(read(bad).is_err(), "{bad}");
        }
        let both: Vec<Depth> = serde_json::from_str(r#"[1.5, "0.5D"]"#).unwrap();
        assert_eq!(both, [Depth::Metres(1.5e-3), Depth::Dioptres(0.5)]);
        assert!(serde_json::from_str::<Depth>("\"near\"").is_err());
    }
}
