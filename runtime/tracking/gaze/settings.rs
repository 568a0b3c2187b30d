//! What the way from sample to pupil is set to.

use super::GazeError;
use eyebox_base::reason;
use serde::Serialize;

/// Whose pupil.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Eye {
    /// The left one's.
    Left,
    /// The right one's.
    Right,
    /// The mean of both, or of what the tracker has.
    Mean,
}

/// Settings. Lengths in metres, times in seconds, angles in radians.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Settings {
    /// Whose pupil.
    pub eye: Eye,
    /// From the eye's centre of rotation to its entrance pupil: 11 mm make 0.19 mm a degree.
    pub radius: f64,
    /// From the eye to the screen that a gaze point lies on, where the tracker does not say.
    pub screen_distance: f64,
    /// What the width and the height of a tracker's picture stand for in the pupil plane, without a calibration.
    pub picture: f64,
    /// Readings with less confidence are refused.
    pub confidence: f64,
    /// Farther from the centre of the eyebox no pupil is believed.
    pub reach: f64,
    /// Smallest and largest distance between the eyes that is believed, where the tracker measures both in space.
    pub between_eyes: [f64; 2],
    /// Fastest that an eye turns, radians a second.
    pub fastest: f64,
    /// Speed from which a movement is a saccade (I-VT), radians a second.
    pub saccade_speed: f64,
    /// One-euro filter: cutoff at rest, hertz.
    pub cutoff: f64,
    /// One-euro filter: what the cutoff gains with speed, hertz per metre a second.
    pub beta: f64,
    /// One-euro filter: cutoff of the speed, hertz.
    pub speed_cutoff: f64,
    /// A lost pupil is held so long, seconds.
    pub hold: f64,
    /// Then its spread widens, metres a second,
    pub widen: f64,
    /// up to this, metres.
    pub widest: f64,
    /// Unforeseen saccades, a second.
    pub saccades: f64,
    /// Standard deviation of a pupil that was never seen: over the eyebox.
    pub unknown: f64,
    /// Diameters where the tracker measures none, smallest and largest.
    pub diameter: [f64; 2],
    /// Depths that the eye may focus at, smallest and largest, where the source measures none.
    pub focus: [f64; 2],
    /// What makes depths of the dioptres that a source measures; without, its focus is passed over.
    pub eyepiece: Option<Eyepiece>,
}

/// What the eye looks at the hologram through.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Eyepiece {
    /// Focal length, metres: D dioptres are the depth D times its square.
    pub focal_length: f64,
    /// Depths of the content, smallest and largest: what focuses beyond is taken to focus at its end.
    pub depths: [f64; 2],
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            eye: Eye::Mean,
            radius: 11e-3,
            screen_distance: 0.6,
            picture: 24e-3,
            confidence: 0.6,
            reach: 20e-3,
            between_eyes: [40e-3, 85e-3],
            fastest: 1000f64.to_radians(),
            saccade_speed: 30f64.to_radians(),
            cutoff: 3.0,
            beta: 1000.0,
            speed_cutoff: 2.0,
            hold: 0.15,
            widen: 10e-3,
            widest: 4e-3,
            saccades: 3.0,
            unknown: 4e-3,
            diameter: [3e-3, 5e-3],
            focus: [0.0, 0.0],
            eyepiece: None,
        }
    }
}

impl Settings {
    /// Checks every number.
    ///
    /// # Errors
    /// [`GazeError::Setting`], naming it.
    pub fn check(self) -> Result<Self, GazeError> {
        let positive = [
            ("radius", self.radius),
            ("screen_distance", self.screen_distance),
            ("picture", self.picture),
            ("reach", self.reach),
            ("fastest", self.fastest),
            ("saccade_speed", self.saccade_speed),
            ("cutoff", self.cutoff),
            ("speed_cutoff", self.speed_cutoff),
            ("widest", self.widest),
            ("unknown", self.unknown),
            ("the smallest diameter", self.diameter[0]),
            ("the smallest distance between the eyes", self.between_eyes[0]),
        ];
        let not_negative = [
            ("confidence", self.confidence),
            ("beta", self.beta),
            ("hold", self.hold),
            ("widen", self.widen),
            ("saccades", self.saccades),
        ];
        let wrong = |name: &str, value: f64, rule: &str| {
            Err(GazeError::Setting(reason!("gaze-setting", "gaze: {name} is {value}: it must be {rule}")))
        };
        for (name, value) in positive {
            if !(value.is_finite() && value > 0.0) {
                return wrong(name, value, "positive and finite");
            }
        }
        for (name, value) in not_negative {
            if !(value.is_finite() && value >= 0.0) {
                return wrong(name, value, "finite and not negative");
            }
        }
        if let Some(eyepiece) = self.eyepiece {
            let (f, [low, high]) = (eyepiece.focal_length, eyepiece.depths);
            if !(f.is_finite() && f > 0.0) {
                return wrong("the eyepiece's focal length", f, "positive and finite");
            }
            if low.is_nan() || high.is_nan() || low > high {
                return wrong("the depth of the content", high, "a range, the smallest first");
            }
        }
        let ranges =
            [("diameter", self.diameter), ("focus", self.focus), ("the distance between the eyes", self.between_eyes)];
        for (name, [low, high]) in ranges {
            if !(low.is_finite() && high.is_finite() && low <= high) {
                return wrong(name, high, "a finite range, the smallest first");
            }
        }
        Ok(self)
    }
}
