//! Holds the state of a pupil, p = (s, d, z).

use super::{Optics, OpticsError};
use serde::{Deserialize, Serialize};

/// Position, diameter and focus of the eye's pupil. All lengths are in meters.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Pupil {
    /// Center along the columns (+x).
    pub x: f64,
    /// Center along the rows (+y, down).
    pub y: f64,
    /// Diameter of the pupil.
    pub diameter: f64,
    /// Depth of the focus.
    pub depth: f64,
}

impl Pupil {
    /// Makes a pupil from millimeters, in the order x, y, diameter, depth.
    pub fn from_mm([x, y, diameter, depth]: [f64; 4]) -> Self {
        Self { x: x * 1e-3, y: y * 1e-3, diameter: diameter * 1e-3, depth: depth * 1e-3 }
    }

    /// The pupil in millimeters, in the order x, y, diameter, depth.
    pub fn to_mm(self) -> [f64; 4] {
        [self.x * 1e3, self.y * 1e3, self.diameter * 1e3, self.depth * 1e3]
    }

    /// Checks that all numbers are finite and the diameter is positive.
    ///
    /// # Errors
    /// [`OpticsError::NotFinite`] or [`OpticsError::NotPositive`] for an impossible number.
    pub fn check(self) -> Result<Self, OpticsError> {
        for (what, value) in
            [("the pupil's x (mm)", self.x), ("the pupil's y (mm)", self.y), ("the focus depth (mm)", self.depth)]
        {
            if !value.is_finite() {
                return Err(OpticsError::NotFinite { what, value });
            }
        }
        if self.diameter.is_finite() && self.diameter > 0.0 {
            Ok(self)
        } else {
            let hint = "; the eye's is 2 to 8 mm";
            Err(OpticsError::NotPositive { what: "the pupil's diameter (mm)", value: self.diameter * 1e3, hint })
        }
    }

    /// Does [`check`](Self::check), and checks that the center is in the eyebox.
    ///
    /// # Errors
    /// The errors of `check`, and [`OpticsError::OutsideEyebox`].
    pub fn check_within(self, optics: &Optics) -> Result<Self, OpticsError> {
        self.check()?;
        let reach = optics.eyebox() / 2.0;
        if self.x.abs() <= reach && self.y.abs() <= reach {
            return Ok(self);
        }
        let [x_mm, y_mm, diameter_mm, _] = self.to_mm();
        let color = format!("{:.0} nm", optics.wavelength * 1e9);
        Err(OpticsError::OutsideEyebox {
            x_mm,
            y_mm,
            diameter_mm,
            eyebox_mm: optics.eyebox() * 1e3,
            reach_mm: reach * 1e3,
            color,
        })
    }
}

impl Optics {
    /// The rectangle of a far-field SLM's pixels that a pupil covers, as (row, column) of its first pixel and its size.
    /// It has at least one pixel.
    pub fn under(&self, pupil: &Pupil) -> ([usize; 2], [usize; 2]) {
        let first = self.first_bin();
        let axis = |s: f64, first: i64, n: usize| {
            let pixel = |at: f64| (at / self.pitch - first as f64).clamp(0.0, n as f64 - 1.0);
            let (low, high) = (pixel(s - pupil.diameter / 2.0).floor(), pixel(s + pupil.diameter / 2.0).ceil());
            (low as usize, (high - low) as usize + 1)
        };
        let ((top, rows), (left, columns)) = (axis(pupil.y, first.0, self.height), axis(pupil.x, first.1, self.width));
        ([top, left], [rows, columns])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pupil_must_be_somewhere_and_open() {
        let optics = Optics::new(8, 8, 8e-6, 520e-9, 0.4).unwrap();
        assert!(Pupil::from_mm([0.0, 0.0, 3.0, 0.0]).check_within(&optics).is_ok());
        assert!(Pupil::from_mm([13.0, -13.0, 3.0, 0.0]).check_within(&optics).is_ok());
        for bad in [
            [0.0, 0.0, 0.0, 0.0],
            [0.0, 0.0, -2.0, 0.0],
            [14.0, 0.0, 3.0, 0.0],
            [f64::NAN, 0.0, 3.0, 0.0],
            [0.0, 0.0, 3.0, f64::INFINITY],
        ] {
            assert!(Pupil::from_mm(bad).check_within(&optics).is_err(), "{bad:?}");
        }
    }
}
