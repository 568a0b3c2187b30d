//! Defines the position, the focus and the blinks of an eye over time.

use super::error::FilmError;
use eyebox::low_level::error::Reason;
use eyebox::low_level::files::read;
use eyebox::low_level::optics::{Depth, Pupil};
use eyebox::low_level::reason;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// The largest number of frames of a film.
const MOST_FRAMES: f64 = 100_000.0;
/// The times in which the lid closes, stays closed and opens, in seconds. A human blink lasts 0.3 s.
const BLINK: [f64; 3] = [0.1, 0.05, 0.15];
/// The largest distance of a pupil from the axis, and its largest diameter, in millimeters.
const FARTHEST_MM: f64 = 100.0;

/// One key of the path of an eye. A value that it lacks is interpolated between the keys before and after it that have
/// one.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Key {
    /// The time of the key, in seconds.
    pub t_s: f64,
    /// The position of the pupil's center to the right, in mm.
    #[serde(default)]
    pub x_mm: Option<f64>,
    /// The downward position of the pupil's center, in mm.
    #[serde(default)]
    pub y_mm: Option<f64>,
    /// The diameter of the pupil, in mm.
    #[serde(default)]
    pub diameter_mm: Option<f64>,
    /// The focus of the eye in mm, or in dioptres as in `"0.5D"`.
    #[serde(default)]
    pub focus: Option<Depth>,
    /// True if the eye jumps here at this time, instead of moving smoothly.
    #[serde(default)]
    pub jump: bool,
}

/// The path of an eye as JSON with `rate_hz`, `keys` by rising time, and `blinks_s`. It begins at time 0 and ends with
/// the last key.
///
/// Between two keys, each value follows the path of least jerk, as humans move. The share of the way is `10 s^3 - 15
/// s^4 + 6 s^5` after the share s of the time (Flash and Hogan, Journal of Neuroscience 5, 1985). Before the first key
/// with a value, the value is the same as there. After the last such key it stays. Without any key, the pupil is in the
/// middle of the eyebox, is 4 mm wide and focuses at 0.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EyePath {
    /// Frames per second, 1 to 1000, as a whole number or in thousandths.
    #[serde(default = "usual_rate")]
    pub rate_hz: f64,
    /// The keys by rising time.
    pub keys: Vec<Key>,
    /// The times at which blinks begin, in seconds. Each takes 0.3 s.
    #[serde(default)]
    pub blinks_s: Vec<f64>,
}

/// The state of an eye at one time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Moment {
    /// The pupil, in meters.
    pub pupil: Pupil,
    /// The share of the light that the lid lets in.
    pub lid: f64,
}

fn usual_rate() -> f64 {
    30.0
}

impl EyePath {
    /// Reads a path from a file.
    ///
    /// # Errors
    /// Returns [`FilmError::Path`] if the file is unreadable or the path is invalid.
    pub fn read(file: &Path) -> Result<Self, FilmError> {
        let name = file.display().to_string();
        let text = read::text(file, read::TABLE)
            .map_err(|e| FilmError::Path { file: name.clone(), reason: e.to_string().into() })?;
        Self::from_json(&text, &name)
    }

    /// Reads a path from JSON text. Errors name it `file`.
    ///
    /// # Errors
    /// Returns [`FilmError::Path`] if the path is invalid.
    pub fn from_json(text: &str, file: &str) -> Result<Self, FilmError> {
        let wrong = |reason: Reason| FilmError::Path { file: file.into(), reason };
        let path: Self = serde_json::from_str(text).map_err(|e| wrong(e.to_string().into()))?;
        path.check().map_err(wrong)?;
        Ok(path)
    }

    fn check(&self) -> Result<(), Reason> {
        if !(1.0..=1000.0).contains(&self.rate_hz) {
            return Err(reason!("rate", "rate_hz is {}, but must be 1 to 1000", self.rate_hz));
        }
        if self.keys.is_empty() {
            return Err(reason!("no-keys", "keys is empty"));
        }
        let mut before = 0.0;
        for (i, key) in self.keys.iter().enumerate() {
            let number = i + 1;
            if !(key.t_s >= before && key.t_s.is_finite()) {
                return Err(reason!(
                    "time",
                    "t_s of key {number} is {}, but times must be 0 or more and rise",
                    key.t_s
                ));
            }
            before = key.t_s;
            for (name, value, least) in [
                ("x_mm", key.x_mm, -FARTHEST_MM),
                ("y_mm", key.y_mm, -FARTHEST_MM),
                ("diameter_mm", key.diameter_mm, 0.01),
            ] {
                if let Some(value) = value.filter(|v| !(least..=FARTHEST_MM).contains(v)) {
                    return Err(reason!(
                        "key-range",
                        "{name} of key {number} is {value}, but must be {least} to {FARTHEST_MM}"
                    ));
                }
            }
        }
        if let Some(t) = self.blinks_s.iter().find(|t| !t.is_finite()) {
            return Err(reason!("blink", "blinks_s has {t}, which is not a finite number"));
        }
        let frames = before * self.rate_hz;
        if frames >= MOST_FRAMES {
            return Err(reason!("frames-count", "{frames:.0} frames, but at most {MOST_FRAMES} are allowed"));
        }
        Ok(())
    }

    /// Returns the number of frames from time 0 to the last key, both included.
    pub fn frames(&self) -> usize {
        let end = self.keys.last().map_or(0.0, |key| key.t_s);
        (end * self.rate_hz + 1e-6).floor() as usize + 1
    }

    /// Returns the time of a frame, in seconds.
    pub fn time(&self, frame: usize) -> f64 {
        frame as f64 / self.rate_hz
    }

    /// Returns the rate as a whole number of frames in a whole number of seconds.
    pub fn rate(&self) -> [u64; 2] {
        let thousandths = (self.rate_hz * 1000.0).round() as u64;
        if thousandths.is_multiple_of(1000) { [thousandths / 1000, 1] } else { [thousandths, 1000] }
    }

    /// Returns the eye at a time in seconds, in front of a display of this focal length in meters.
    pub fn at(&self, time: f64, focal_length: f64) -> Moment {
        let of = |value: &dyn Fn(&Key) -> Option<f64>, otherwise: f64| self.track(time, value).unwrap_or(otherwise);
        let pupil = Pupil {
            x: of(&|key| key.x_mm, 0.0) * 1e-3,
            y: of(&|key| key.y_mm, 0.0) * 1e-3,
            diameter: of(&|key| key.diameter_mm, 4.0) * 1e-3,
            depth: of(&|key| key.focus.map(|focus| focus.metres(focal_length)), 0.0),
        };
        let open = self.blinks_s.iter().map(|begins| open(time - begins));
        Moment { pupil, lid: open.fold(1.0, f64::min) }
    }

    /// Interpolates a value between the keys that have it. Returns `None` if no key has it.
    fn track(&self, time: f64, value: &dyn Fn(&Key) -> Option<f64>) -> Option<f64> {
        let mut said = self.keys.iter().filter_map(|key| Some((key, value(key)?)));
        let (mut from, mut before) = said.next()?;
        for (to, after) in said {
            if time < to.t_s {
                if to.jump || time <= from.t_s {
                    return Some(before);
                }
                let share = (time - from.t_s) / (to.t_s - from.t_s);
                return Some(before + (after - before) * least_jerk(share));
            }
            (from, before) = (to, after);
        }
        Some(before)
    }
}

fn least_jerk(share: f64) -> f64 {
    share.powi(3) * (10.0 - 15.0 * share + 6.0 * share * share)
}

/// Returns the opening of the lid, 0 to 1, at this number of seconds after a blink began.
fn open(since: f64) -> f64 {
    let [down, closed, up] = BLINK;
    match since {
        t if t <= 0.0 || t >= down + closed + up => 1.0,
        t if t < down => 1.0 - least_jerk(t / down),
        t if t <= down + closed => 0.0,
        t => least_jerk((t - down - closed) / up),
    }
}

#[cfg(test)]
mod tests {
    use super::super::error::EXAMPLE;
    use super::*;
    use eyebox::low_level::error::ErrorData;

    #[test]
    fn an_eye_goes_from_key_to_key() {
        let path = EyePath::from_json(
            r#"{"rate_hz": 10, "keys": [{"t_s": 0, "x_mm": -4, "focus": 1}, {"t_s": 1, "y_mm": 2},
                {"t_s": 2, "x_mm": 4, "diameter_mm": 6}, {"t_s": 3, "x_mm": 0, "jump": true, "focus": "0.1D"}],
                "blinks_s": [2.5]}"#,
            "p",
        )
        .unwrap();
        assert_eq!((path.frames(), path.rate()), (31, [10, 1]));
        let near = |a: f64, b: f64| (a - b).abs() < 1e-12;
        let at = |t: f64| path.at(t, 0.4).pupil;
        assert!(near(at(0.0).x, -4e-3) && near(at(1.0).x, 0.0) && near(at(2.0).x, 4e-3));
        assert!(at(0.5).x > -4e-3 && at(0.5).x < -2e-3, "it begins gently: {}", at(0.5).x);
        // A jump waits for its time, and so does its focus.
        assert!(near(at(2.99).x, 4e-3) && near(at(3.0).x, 0.0) && near(at(2.99).depth, 1e-3));
        assert!(near(at(3.0).depth, 0.1 * 0.4 * 0.4) && near(at(0.0).y, 2e-3) && near(at(9.0).diameter, 6e-3));
        let lid = |t: f64| path.at(t, 0.4).lid;
        assert!(lid(2.5) == 1.0 && lid(2.62) == 0.0 && lid(2.81) == 1.0 && (0.01..0.99).contains(&lid(2.55)));
        let still = EyePath::from_json(r#"{"keys": [{"t_s": 0}]}"#, "p").unwrap();
        assert_eq!(
            (still.frames(), still.at(0.0, 0.4).pupil),
            (1, Pupil { x: 0.0, y: 0.0, diameter: 4e-3, depth: 0.0 })
        );
        assert_eq!(EyePath { rate_hz: 23.976, ..still }.rate(), [23_976, 1000]);
        EyePath::from_json(EXAMPLE, "p").unwrap();
    }

    #[test]
    fn a_path_that_no_eye_goes_is_refused_in_one_line() {
        for (text, [code, part]) in [
            ("", ["path", ""]),
            ("{}", ["path", "keys"]),
            (r#"{"keys": []}"#, ["path/no-keys", ""]),
            (r#"{"keys": [{"t_s": -1}]}"#, ["path/time", "-1"]),
            (r#"{"keys": [{"t_s": 1}, {"t_s": 0.5}]}"#, ["path/time", "0.5"]),
            (r#"{"keys": [{"t_s": 0, "x": 1}]}"#, ["path", "`x`"]),
            (r#"{"keys": [{"t_s": 0, "x_mm": 1e9}]}"#, ["path/key-range", "x_mm"]),
            (r#"{"keys": [{"t_s": 0, "diameter_mm": 0}]}"#, ["path/key-range", "diameter_mm"]),
            (r#"{"keys": [{"t_s": 0, "focus": "near"}]}"#, ["path", "near"]),
            (r#"{"keys": [{"t_s": 1e6}]}"#, ["path/frames-count", "100000"]),
            (r#"{"rate_hz": 0, "keys": [{"t_s": 0}]}"#, ["path/rate", "rate_hz"]),
        ] {
            let error = EyePath::from_json(text, "p.json").unwrap_err();
            assert_eq!(ErrorData::of(&error).code, code, "{text}");
            let said = error.to_string();
            assert!(["p.json", part, EXAMPLE].iter().all(|part| said.contains(part)), "{text}: {said}");
            assert_eq!(said.lines().count(), 1, "{said}");
        }
        assert!(matches!(EyePath::read(Path::new("none.json")), Err(FilmError::Path { .. })));
    }
}
