//! Which way round a bench is: the sign of its phase, and how its camera sees the picture.

use super::map::CameraMap;
use serde::Serialize;
use std::fmt;

/// The sign of the phase, which is the direction of the SLM's table too: pictures do not tell phases of the other sign from a table that
/// falls where the display's file lets it rise.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum PhaseSign {
    /// As in the display's file: a higher level delays the light more.
    AsRequested,
    /// The other one: a higher level delays the light less.
    Opposite,
    /// No model explains the pictures, with neither sign.
    Unknown,
}

/// Which way round a bench is.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Directions {
    /// The sign of the phase, and the direction of the table.
    pub phase: PhaseSign,
    /// Whether the camera sees the picture mirrored, left to right.
    pub mirrored: bool,
    /// How far the picture is then turned clockwise, degrees, more than -180 and up to 180.
    pub turned_deg: f64,
}

impl Directions {
    /// By the camera's map.
    pub(super) fn new(phase: PhaseSign, map: CameraMap) -> Self {
        let [[a, b], [d, e]] = map.slopes();
        let mirrored = a * e - b * d < 0.0;
        // Mirrored back, it is a turn.
        let (a, d) = if mirrored { (-a, -d) } else { (a, d) };
        let turned = (d - b).atan2(a + e).to_degrees();
        Self { phase, mirrored, turned_deg: if turned <= -180.0 { 180.0 } else { turned } }
    }
}

impl fmt::Display for Directions {
    fn fmt(&self, to: &mut fmt::Formatter<'_>) -> fmt::Result {
        to.write_str(match self.phase {
            PhaseSign::AsRequested => {
                "the phase has the sign of the display's file, and the table rises: a higher level delays the light more"
            }
            PhaseSign::Opposite => {
                "the phase has the other sign, or the table falls: a higher level delays the light less"
            }
            PhaseSign::Unknown => "the sign of the phase and the direction of the table are not known",
        })?;
        to.write_str("; the camera sees the picture ")?;
        to.write_str(if self.mirrored { "mirrored left to right" } else { "not mirrored" })?;
        // A tenth of a degree is two tenths of a pixel at the edge of 256.
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
            // A place to the right of the middle comes to lie where the words say.
            let [at, middle] = [[48.5, 31.5], [47.5, 31.5]].map(|at| map.to_camera(at));
            let right = [at[0] - middle[0], at[1] - middle[1]];
            let angle = if mirrored { (-right[1]).atan2(-right[0]) } else { right[1].atan2(right[0]) };
            let off = (angle.to_degrees() - degrees).rem_euclid(360.0);
            assert!(off.min(360.0 - off) < 0.5, "{degrees}: {off}");
        }
    }
}
