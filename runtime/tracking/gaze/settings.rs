//! Holds the settings of the steps from sample to pupil.

use super::GazeError;
use eyebox_base::reason;
use serde::Serialize;

/// The eye whose pupil is followed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Eye {
    /// The pupil of the left eye.
    Left,
    /// The pupil of the right eye.
    Right,
    /// The mean of both eyes, or the eye that the tracker sees.
    Mean,
}

/// Settings of the estimator. Lengths are in meters, times in seconds, angles in radians.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Settings {
    /// The eye whose pupil is followed.
    pub eye: Eye,
    /// Distance from the eye's center of rotation to its entrance pupil. 11 mm give 0.19 mm per degree.
    pub radius: f64,
    /// Distance from the eye to the screen of a gaze point, if the tracker does not report it.
    pub screen_distance: f64,
    /// Width and height of a tracker's picture in the pupil plane, without a calibration.
    pub picture: f64,
    /// Readings with less confidence are refused.
    pub confidence: f64,
    /// Pupils farther than this from the center of the eyebox are refused.
    pub reach: f64,
    /// Smallest and largest accepted distance between the eyes, if the tracker measures both in space.
    pub between_eyes: [f64; 2],
    /// The largest speed of a turning eye, radians per second.
    pub fastest: f64,
    /// Speed above which a movement is a saccade (I-VT), radians per second.
    pub saccade_speed: f64,
    /// Cutoff of the one-euro filter at rest, hertz.
    pub cutoff: f64,
    /// Increase of the cutoff of the one-euro filter with speed, hertz per meter per second.
    pub beta: f64,
    /// Cutoff of the speed in the one-euro filter, hertz.
    pub speed_cutoff: f64,
    /// Time for which a lost pupil is held, seconds.
    pub hold: f64,
    /// Speed at which the spread widens after `hold`, meters per second.
    pub widen: f64,
    /// Largest spread after widening, meters.
    pub widest: f64,
    /// Rate of unforeseen saccades, per second.
    pub saccades: f64,
    /// Standard deviation of a pupil that was never seen, meters. It covers the eyebox.
    pub unknown: f64,
    /// Smallest and largest diameter, if the tracker measures none.
    pub diameter: [f64; 2],
    /// Smallest and largest depth at which the eye may focus, if the source measures none.
    pub focus: [f64; 2],
    /// Converts the dioptres that a source measures to depths. Without an eyepiece, its focus is ignored.
    pub eyepiece: Option<Eyepiece>,
}

/// The eyepiece between the eye and the hologram.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Eyepiece {
    /// Focal length, meters. D dioptres are at a depth of D times its square.
    pub focal_length: f64,
    /// Smallest and largest depth of the content. A focus beyond is clamped to this range.
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
    /// Checks the range of every number.
    ///
    /// # Errors
    /// [`GazeError::Setting`] with the name of the setting.
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
            Err(GazeError::Setting(reason!("gaze-setting", "gaze: {name} is {value}, but it must be {rule}")))
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
