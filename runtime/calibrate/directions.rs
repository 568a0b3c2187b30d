//! Reports the sign of a bench's phase and the orientation of its camera's picture.

use super::map::CameraMap;
use serde::Serialize;
use std::fmt;

/// The sign of the phase, which is also the direction of the SLM's table. Pictures cannot separate phases of the other
/// sign from a table that falls while the display's file has a rising one.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum PhaseSign {
    /// The sign of the display's file. A higher level delays the light more.
    AsRequested,
    /// The opposite sign. A higher level delays the light less.
    Opposite,
    /// No model explains the pictures with either sign.
    Unknown,
}

/// The orientation of a bench.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Directions {
    /// The sign of the phase, and the direction of the table.
    pub phase: PhaseSign,
    /// True if the camera sees the picture mirrored, left to right.
    pub mirrored: bool,
    /// Clockwise rotation of the picture after that reflection, degrees, more than -180 and up to 180.
    pub turned_deg: f64,
}

impl Directions {
    /// The directions of a camera's map.
    pub(super) fn new(phase: PhaseSign, map: CameraMap) -> Self {
        let [[a, b], [d, e]] = map.slopes();
        let mirrored = a * e - b * d < 0.0;
        // After the reflection is undone, it is a rotation.
        let (a, d) = if mirrored { (-a, -d) } else { (a, d) };
        let turned = (d - b).atan2(a + e).to_degrees();
        Self { phase, mirrored, turned_deg: if turned <= -180.0 { 180.0 } else { turned } }
    }
}

impl fmt::Display for Directions {
    fn fmt(&self, to: &mut fmt::Formatter<'_>) -> fmt::Result {
        to.write_str(match self.phase {
            PhaseSign::AsRequested => {
                "the phase has the sign of the display file, the table rises, and a higher level delays the light more"
            }
            PhaseSign::Opposite => {
                "the phase has the other sign, or the table falls, and a higher level delays the light less"
            }
            PhaseSign::Unknown => "the sign of the phase and the direction of the table are unknown",
        })?;
        to.write_str(". The camera sees the picture ")?;
        to.write_str(if self.mirrored { "mirrored left to right" } else { "not mirrored" })?;
        // A tenth of a degree is two tenths of a pixel at the edge of 256 pixels.
        match (self.turned_deg.abs(), self.turned_deg > 0.0) {
            (..0.05, _) => write!(to, " and upright"),
            (by, clockwise) => {
                write!(
                    to,
                    " and turned by {by:.1} degrees {}",
                    if clockwise { "clockwise" } else { "counterclockwise" }
                )
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mirror_and_any_turn_are_told_apart() {
        for (mirrored, degrees) in
            [(false, 0.0), (true, 0.0), (false, 92.0), (true, -88.5), (false, 180.0), (true, 179.0), (false, -2.5)]
        {
            let (sin, cos) = f64::to_radians(degrees).sin_cos();
            let side = if mirrored { -1.0 } else { 1.0 };
            let numbers = [0.8 * side * cos, -0.8 * sin, 0.1, 0.8 * side * sin, 0.8 * cos, -0.05, 0.0, 0.0, 0.0, 0.0];
            let map = CameraMap { numbers, slm: [64, 96], camera: [120, 150] };
            let found = Directions::new(PhaseSign::AsRequested, map);
            assert_eq!(found.mirrored, mirrored, "{degrees}");
            assert!((found.turned_deg - degrees).abs() < 1e-3, "{found:?} for {degrees}");
            // A place to the right of the middle comes out at the rotation of the text.
            let [at, middle] = [[48.5, 31.5], [47.5, 31.5]].map(|at| map.to_camera(at));
            let right = [at[0] - middle[0], at[1] - middle[1]];
            let angle = if mirrored { (-right[1]).atan2(-right[0]) } else { right[1].atan2(right[0]) };
            let off = (angle.to_degrees() - degrees).rem_euclid(360.0);
            assert!(off.min(360.0 - off) < 0.5, "{degrees}: {off}");
        }
    }
}
