//! Reads and writes samples as JSON, one object per line.
//!
//! Datagrams and recordings of sources without reports have this form.
//!
//! ```json
//! {"t": 12.345, "x": 1.5, "y": -0.2, "diameter": 4.1}
//! {"t": 12.345, "x": 1.5, "y": -0.2, "vx": 12.0, "vy": 0.5}
//! {"t": 12.345, "left": {"x": 1.5, "y": -0.2, "confidence": 0.9}, "right": {"x": 1.4, "y": -0.2, "valid": false}}
//! ```
//!
//! - `t` is the sender's time. Its clock may begin anywhere. `t_unit` is `s`, `ms`, `us` or `ns`. Without it, eyebox
//!   finds the unit from the clock's rate.
//! - A position has `x` and `y`, and may have `z`. Its `unit` is `mm` (the default), `m`, `deg`, `normalized` or
//!   `counts`. Its quantity `what` is `pupil` (the default) or `gaze`.
//! - A position may have its velocity `vx` and `vy` (`unit` per second, both or none), `confidence` (0 to 1) and
//!   `valid`. `diameter` is in mm, or in meters if `unit` is `m` and the number is small.
//! - A position is at the top, or under `left`, `right` and `combined`. At the top, `eye` may state its eye (`left`,
//!   `right`, or Pupil Core's 0 and 1).
//! - At the top, `focus_d` is the focus of the eyes, dioptres. Without it, `ipd_mm`, the distance between the eyes,
//!   gives the focus from both directions (`what` is `gaze`, `unit` is `deg`).
//! - A value of `null` or `NaN` is unknown. Other keys are ignored.

use super::time_unit::TimeUnit;
use super::{Quantity, Reading, Sample, Unit};
use eyebox_base::error::Reason;
use eyebox_base::reason;
use serde::{Deserialize, Deserializer, Serialize};

mod replay;

pub use replay::LineSource;

/// An example line, for users whose lines have another form.
pub(super) const EXAMPLE: &str = r#"each sample is a line such as {"t": 12.5, "x": 1.5, "y": -0.2, "diameter": 4}"#;
/// Longest line that is read, bytes.
pub const LONGEST_LINE: usize = 2048;

/// The unit in a line. Other files cannot state `m`.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
enum LineUnit {
    Mm,
    M,
    Deg,
    Normalized,
    Counts,
}

#[derive(Debug, Clone, Copy, Default, Serialize, Deserialize)]
struct ReadingText {
    /// The outer option is none without the key, the inner one if its value is unknown.
    #[serde(default, deserialize_with = "present")]
    x: Option<Option<f64>>,
    #[serde(default, deserialize_with = "present")]
    y: Option<Option<f64>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    z: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    vx: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    vy: Option<f64>,
    unit: Option<LineUnit>,
    what: Option<Quantity>,
    #[serde(skip_serializing_if = "Option::is_none")]
    diameter: Option<f64>,
    confidence: Option<f64>,
    #[serde(default, deserialize_with = "flag")]
    valid: Option<bool>,
}

#[derive(Debug, Serialize, Deserialize)]
struct SampleText {
    /// Index among left, right and combined of the position at the top.
    #[serde(skip_serializing, default, deserialize_with = "eye")]
    eye: Option<usize>,
    t: Option<f64>,
    #[serde(skip_serializing)]
    t_unit: Option<TimeUnit>,
    #[serde(skip_serializing_if = "Option::is_none")]
    received: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none", skip_deserializing)]
    tracker_ns: Option<i64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    focus_d: Option<f64>,
    #[serde(skip_serializing)]
    ipd_mm: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    left: Option<ReadingText>,
    #[serde(skip_serializing_if = "Option::is_none")]
    right: Option<ReadingText>,
    #[serde(skip_serializing_if = "Option::is_none")]
    combined: Option<ReadingText>,
}

fn present<'de, D: Deserializer<'de>>(from: D) -> Result<Option<Option<f64>>, D::Error> {
    Option::deserialize(from).map(Some)
}

/// The eye of a position at the top. Pupil Core counts eyes, and 0 is the right one.
fn eye<'de, D: Deserializer<'de>>(from: D) -> Result<Option<usize>, D::Error> {
    let place = match serde_json::Value::deserialize(from)? {
        serde_json::Value::Null => return Ok(None),
        serde_json::Value::String(name) => match &name.to_ascii_lowercase()[..] {
            "left" | "l" | "eye1" => Some(0),
            "right" | "r" | "eye0" => Some(1),
            "combined" | "both" | "mean" => Some(2),
            _ => None,
        },
        serde_json::Value::Number(number) => [1, 0].iter().position(|eye| number.as_u64() == Some(*eye)),
        _ => None,
    };
    let wrong = || {
        serde::de::Error::custom("eye: expected \"left\" or \"right\", or 0 (right) or 1 (left) as Pupil Core has it")
    };
    place.map(Some).ok_or_else(wrong)
}

/// A truth value, which may be a number because trackers send their validity as 0 and 1.
fn flag<'de, D: Deserializer<'de>>(from: D) -> Result<Option<bool>, D::Error> {
    #[derive(Deserialize)]
    #[serde(untagged)]
    enum Flag {
        Truth(bool),
        Number(f64),
    }
    Ok(Option::deserialize(from)?.map(|flag| match flag {
        Flag::Truth(truth) => truth,
        Flag::Number(number) => number != 0.0,
    }))
}

/// Smaller diameters are in meters if positions are.
const SMALLEST_MM: f64 = 0.1;

impl ReadingText {
    fn reading(self) -> Reading {
        let (unit, scale) = match self.unit.unwrap_or(LineUnit::Mm) {
            LineUnit::Mm => (Unit::Metres, 1e-3),
            LineUnit::M => (Unit::Metres, 1.0),
            LineUnit::Deg => (Unit::Radians, 1f64.to_radians()),
            LineUnit::Normalized => (Unit::Normalized, 1.0),
            LineUnit::Counts => (Unit::Counts, 1.0),
        };
        let position = [self.x, self.y].map(|v| v.flatten().map_or(f64::NAN, |v| v * scale));
        let in_metres = |d: f64| matches!(self.unit, Some(LineUnit::M)) && d < SMALLEST_MM;
        Reading {
            quantity: self.what.unwrap_or_default(),
            unit,
            position,
            distance: self.z.map(|z| z * scale),
            velocity: self.vx.zip(self.vy).map(|(x, y)| [x * scale, y * scale]),
            diameter: self.diameter.map(|d| if in_metres(d) { d } else { d * 1e-3 }),
            valid: self.valid.unwrap_or(true),
            confidence: self.confidence.unwrap_or(1.0),
        }
        .checked()
    }

    fn of(reading: &Reading) -> Self {
        let (unit, scale) = match reading.unit {
            Unit::Metres => (LineUnit::Mm, 1e3),
            Unit::Radians => (LineUnit::Deg, 1f64.to_degrees()),
            Unit::Normalized => (LineUnit::Normalized, 1.0),
            Unit::Counts => (LineUnit::Counts, 1.0),
        };
        // The factor rounds to a billionth, so that 1.5 mm are not written as 1.5000000000000002.
        let scaled = |v: f64| (v * scale * 1e9).round() / 1e9;
        let [x, y] = reading.position.map(|v| Some(reading.valid.then(|| scaled(v))));
        let velocity = reading.velocity.filter(|_| reading.valid).map(|v| v.map(scaled));
        Self {
            x,
            y,
            z: reading.distance.filter(|_| reading.valid).map(scaled),
            vx: velocity.map(|v| v[0]),
            vy: velocity.map(|v| v[1]),
            unit: Some(unit),
            what: Some(reading.quantity),
            diameter: reading.diameter.map(|d| (d * 1e12).round() / 1e9),
            confidence: Some(reading.confidence),
            valid: Some(reading.valid),
        }
    }
}

/// A parsed line with the sender's times and the readings.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Line {
    /// Time of the sender's clock, in its unit.
    pub time: Option<f64>,
    /// The unit of its times, if the line states one.
    pub time_unit: Option<TimeUnit>,
    /// Arrival of a recorded line, in the same clock and unit.
    pub received: Option<f64>,
    /// The readings of left, right and combined.
    pub readings: [Option<Reading>; 3],
    /// True if any reading states the unit of its position.
    pub states_unit: bool,
    /// Focus of the eyes, dioptres.
    pub focus_dioptres: Option<f64>,
}

impl Line {
    /// The sample with these times.
    pub(super) fn sample(self, time_ns: u64, received_ns: u64, tracker_ns: Option<i64>) -> Sample {
        let [left, right, combined] = self.readings;
        Sample { time_ns, received_ns, tracker_ns, left, right, combined, focus_dioptres: self.focus_dioptres }
    }
}

/// Possible focus of eyes, dioptres. Values beyond are errors of the tracker.
const FOCUS: std::ops::RangeInclusive<f64> = -10.0..=30.0;
/// Returns true if eyes can focus at this many dioptres.
pub(super) fn is_focus(dioptres: f64) -> bool {
    FOCUS.contains(&dioptres)
}

/// Possible distances between eyes, mm.
const BETWEEN_EYES: std::ops::RangeInclusive<f64> = 40.0..=85.0;
/// Times beyond this are not times in any unit. It is 300 years of nanoseconds.
const LATEST: f64 = 1e19;

/// The focus (dioptres) of two eyes that are `apart_mm` apart and look at one point. It is the difference of the
/// tangents of their directions, divided by their distance.
fn vergence(left: Option<Reading>, right: Option<Reading>, apart_mm: f64) -> Option<f64> {
    let is_direction = |r: &Reading| r.valid && r.quantity == Quantity::Gaze && r.unit == Unit::Radians;
    let (left, right) = (left.filter(is_direction)?, right.filter(is_direction)?);
    Some((left.position[0].tan() - right.position[0].tan()) / (apart_mm * 1e-3))
}

/// Reads one line of JSON.
///
/// # Errors
/// The reason if it is not a sample.
pub fn parse(line: &[u8]) -> Result<Line, Reason> {
    if line.len() > LONGEST_LINE {
        return Err(reason!("line-length", "{} bytes, but a line has {LONGEST_LINE} at most", line.len()));
    }
    match read(line) {
        // Python, C and others write numbers that JSON does not have.
        Err(reason) => read(&without_nan(line).ok_or(reason)?),
        read => read,
    }
}

fn read(line: &[u8]) -> Result<Line, Reason> {
    if !line.trim_ascii_start().starts_with(b"{") {
        return Err(reason!("not-json", "not a JSON object: {EXAMPLE}"));
    }
    let text: SampleText = serde_json::from_slice(line).map_err(|e| e.to_string())?;
    let mut texts = [text.left, text.right, text.combined];
    if texts.iter().all(Option::is_none) {
        let top: ReadingText = serde_json::from_slice(line).map_err(|e| e.to_string())?;
        texts[text.eye.unwrap_or(2)] = Some(top).filter(|t| t.x.is_some() || t.y.is_some() || t.valid == Some(false));
    }
    let readings = texts.map(|r| r.map(ReadingText::reading));
    if readings.iter().all(Option::is_none) {
        return Err(reason!(
            "no-position",
            "no position: expected x and y, at the top or under left, right or combined"
        ));
    }
    if let Some(apart) = text.ipd_mm.filter(|apart| !BETWEEN_EYES.contains(apart)) {
        return Err(reason!(
            "ipd",
            "ipd_mm is {apart}, but eyes are {} to {} mm apart",
            BETWEEN_EYES.start(),
            BETWEEN_EYES.end()
        ));
    }
    let focus = text.focus_d.or_else(|| vergence(readings[0], readings[1], text.ipd_mm?));
    let focus_dioptres = focus.filter(|focus| is_focus(*focus));
    let time = |t: Option<f64>| t.filter(|t| t.abs() <= LATEST);
    Ok(Line {
        time: time(text.t),
        time_unit: text.t_unit,
        received: time(text.received),
        readings,
        states_unit: texts.iter().flatten().any(|t| t.unit.is_some()),
        focus_dioptres,
    })
}

/// The line with `null` for every NaN and infinity outside of its strings, or none if it has neither.
fn without_nan(line: &[u8]) -> Option<Vec<u8>> {
    const WORDS: [&[u8]; 3] = [b"nan", b"inf", b"infinity"];
    let (mut out, mut found, mut at) = (Vec::with_capacity(line.len() + 16), false, 0);
    while let Some(byte) = line.get(at) {
        let rest = &line[at..];
        let length = match byte {
            b'"' => {
                let mut escaped = false;
                let end = rest.iter().skip(1).position(|b| {
                    let ends = *b == b'"' && !escaped;
                    escaped = *b == b'\\' && !escaped;
                    ends
                });
                end.map_or(rest.len(), |end| end + 2)
            }
            b if b.is_ascii_alphanumeric() => {
                rest.iter().position(|b| !b.is_ascii_alphanumeric()).unwrap_or(rest.len())
            }
            _ => 1,
        };
        let word = &rest[..length];
        if WORDS.iter().any(|w| word.eq_ignore_ascii_case(w)) {
            if matches!(out.last(), Some(b'-' | b'+')) {
                out.pop();
            }
            out.extend(b"null");
            found = true;
            at += length;
            // C libraries write nan(ind) and -nan(snan).
            if line.get(at) == Some(&b'(') {
                at += line[at..].iter().position(|b| *b == b')').map_or(0, |end| end + 1);
            }
        } else {
            out.extend(word);
            at += length;
        }
    }
    found.then_some(out)
}

/// Writes a sample as one line, without its end.
pub fn write(sample: &Sample) -> String {
    let seconds = |ns: u64| ns as f64 * 1e-9;
    let text = SampleText {
        eye: None,
        t: Some(seconds(sample.time_ns)),
        t_unit: None,
        received: Some(seconds(sample.received_ns)),
        tracker_ns: sample.tracker_ns,
        focus_d: sample.focus_dioptres,
        ipd_mm: None,
        left: sample.left.as_ref().map(ReadingText::of),
        right: sample.right.as_ref().map(ReadingText::of),
        combined: sample.combined.as_ref().map(ReadingText::of),
    };
    // The text has only numbers and names, which JSON can always contain.
    serde_json::to_string(&text).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_say_what_they_mean() {
        let line = parse(br#"{"t": 2.5, "x": 1.5, "y": -2, "diameter": 4, "mood": "fine"}"#).unwrap();
        assert_eq!(line.time, Some(2.5));
        let reading = line.readings[2].unwrap();
        assert_eq!((reading.position, reading.unit, reading.valid), ([1.5e-3, -2e-3], Unit::Metres, true));
        assert!((reading.diameter.unwrap() - 4e-3).abs() < 1e-12);

        let both = br#"{"left": {"x": 90, "y": 0, "unit": "deg", "what": "gaze"}, "right": {"valid": false}}"#;
        let [left, right, combined] = parse(both).unwrap().readings;
        assert!((left.unwrap().position[0] - std::f64::consts::FRAC_PI_2).abs() < 1e-12);
        assert_eq!(left.unwrap().quantity, Quantity::Gaze);
        assert!(!right.unwrap().valid && combined.is_none());

        let moves = |text: &str| parse(text.as_bytes()).unwrap().readings[2].unwrap().velocity;
        assert_eq!(moves(r#"{"x": 1, "y": 0, "vx": 12, "vy": -4}"#), Some([12e-3, -4e-3]));
        let turns = moves(r#"{"x": 1, "y": 0, "vx": 180, "vy": 0, "unit": "deg", "what": "gaze"}"#).unwrap();
        assert!((turns[0] - std::f64::consts::PI).abs() < 1e-12 && turns[1] == 0.0, "{turns:?}");
        let none = ["\"vx\": 1", "\"vy\": 1", "\"vx\": null, \"vy\": 1", "\"vx\": 1, \"vy\": 0, \"valid\": false"];
        assert!(none.iter().all(|v| moves(&format!("{{\"x\": 1, \"y\": 0, {v}}}")).is_none()));

        let of = |eye: &str| {
            parse(format!(r#"{{"eye": {eye}, "x": 1, "y": 0}}"#).as_bytes()).unwrap().readings.map(|r| r.is_some())
        };
        for (eyes, slot) in
            [(["\"left\"", "\"L\"", "1"], 0), (["\"Right\"", "\"r\"", "0"], 1), (["null", "\"both\"", "\"mean\""], 2)]
        {
            for eye in eyes {
                assert_eq!(of(eye), [0, 1, 2].map(|i| i == slot), "{eye}");
            }
        }
        assert!(parse(br#"{"eye": "third", "x": 1, "y": 0}"#).unwrap_err().text().contains("left"));
        assert_eq!(parse(b"timestamp,x,y").unwrap_err().code(), "not-json");
        for bad in ["", "{}", "[]", "null", "{\"x\": \"1\"}", "{\"x\": 1", "{\"t\": 1}", "{\"left\": 3}", "\u{1}"] {
            assert!(parse(bad.as_bytes()).is_err(), "{bad}");
        }
        assert!(!parse(br#"{"x": 1}"#).unwrap().readings[2].unwrap().valid, "half a position");
        assert!(!parse(br#"{"x": 1e999, "y": 0}"#).is_ok_and(|l| l.readings[2].unwrap().valid));
        assert!(!parse(br#"{"x": 1, "y": 0, "confidence": 7}"#).unwrap().readings[2].unwrap().valid);
        assert_eq!(parse(br#"{"x": 1, "y": 0, "t": -5}"#).unwrap().time, Some(-5.0));
    }

    #[test]
    fn the_focus_is_said_or_follows_from_where_both_eyes_look() {
        let focus = |text: &str| parse(text.as_bytes()).unwrap().focus_dioptres;
        assert_eq!(focus(r#"{"x": 1, "y": 2, "focus_d": 1.5}"#), Some(1.5));
        assert_eq!(focus(r#"{"x": 1, "y": 2}"#), None);
        assert_eq!(focus(r#"{"x": 1, "y": 2, "focus_d": 500}"#), None, "no eye does");
        // Both eyes look at a point half a meter away and 0.1 m to the right, 64 mm apart, which is 2 dioptres.
        let degrees = |x: f64| (x / 0.5).atan().to_degrees();
        let eyes = |left: f64, right: f64, rest: &str| {
            let eye = |x: f64| format!(r#"{{"what": "gaze", "unit": "deg", "x": {x}, "y": 3}}"#);
            format!(r#"{{"left": {}, "right": {}{rest}}}"#, eye(degrees(left)), eye(degrees(right)))
        };
        let found = focus(&eyes(0.132, 0.068, r#", "ipd_mm": 64"#)).unwrap();
        assert!((found - 2.0).abs() < 1e-9, "{found}");
        assert_eq!(focus(&eyes(0.132, 0.068, "")), None, "not asked for");
        assert_eq!(focus(&eyes(0.132, 0.068, r#", "ipd_mm": 64, "focus_d": 0.5"#)), Some(0.5), "what is said wins");
        assert!(parse(eyes(0.1, 0.1, r#", "ipd_mm": 0.064"#).as_bytes()).unwrap_err().code() == "ipd");
    }

    #[test]
    fn what_is_written_is_read_again() {
        let mut sample = Sample::empty(5_000_000_000);
        sample.time_ns = 4_990_000_000;
        let reading = Reading::new(Quantity::Gaze, Unit::Radians, [0.25, -0.5]);
        sample.left = Some(Reading { diameter: Some(3e-3), confidence: 0.5, distance: Some(1.0), ..reading });
        sample.combined =
            Some(Reading { velocity: Some([2e-3, -0.5]), ..Reading::new(Quantity::Pupil, Unit::Metres, [0.0; 2]) });
        sample.focus_dioptres = Some(0.75);
        let line = parse(write(&sample).as_bytes()).unwrap();
        assert_eq!(line.readings[2].unwrap().velocity, Some([2e-3, -0.5]));
        assert!(line.readings[0].unwrap().velocity.is_none() && !write(&Sample::empty(1)).contains("vx"));
        assert_eq!(line.focus_dioptres, Some(0.75));
        let again = line.readings[0].unwrap();
        assert!((again.position[0] - 0.25).abs() < 1e-10 && (again.diameter.unwrap() - 3e-3).abs() < 1e-12);
        assert_eq!((again.confidence, again.quantity, line.received), (0.5, Quantity::Gaze, Some(5.0)));
        assert!((line.time.unwrap() - 4.99).abs() < 1e-12);
    }

    /// An unknown value in any notation does not affect the other values. x and diameter are in mm.
    #[test]
    fn unknown_parts_leave_the_known_ones() {
        let numbers =
            ["NaN", "nan", "-nan", "NAN", "null", "Infinity", "-Infinity", "inf", "-inf", "nan(ind)", "-nan(snan)"];
        for unknown in numbers {
            let read = |text: String| parse(text.as_bytes()).unwrap_or_else(|e| panic!("{text}: {e}"));
            let one = |line: Line| line.readings[2].unwrap();
            let mm = |v: f64| (v * 1e6).round() / 1e3;
            let reading = one(read(format!("{{\"t\": 1, \"x\": 1.5, \"y\": -2, \"diameter\": {unknown}}}")));
            assert!(reading.valid && mm(reading.position[0]) == 1.5 && reading.diameter.is_none(), "{unknown}");
            let line =
                read(format!("{{\"t\": {unknown}, \"x\": 1.5, \"y\": -2, \"diameter\": 4, \"focus_d\": {unknown}}}"));
            let reading = one(line);
            assert!(reading.valid && line.time.is_none() && line.focus_dioptres.is_none(), "{unknown}");
            assert_eq!(mm(reading.diameter.unwrap()), 4.0, "{unknown}");
            let shut = one(read(format!("{{\"t\": 1, \"x\": {unknown}, \"y\": {unknown}, \"diameter\": 4}}")));
            assert!(!shut.valid, "{unknown}: an eye whose place is unknown is not seen");
            let line = read(format!(
                "{{\"t\": 1, \"left\": {{\"x\": {unknown}, \"y\": 0}}, \"right\": {{\"x\": 3, \"y\": 1, \"confidence\": {unknown}}}}}"
            ));
            assert!(!line.readings[0].unwrap().valid && line.readings[1].unwrap().valid, "{unknown}");
            let moving = one(read(format!("{{\"x\": 1, \"y\": 0, \"vx\": {unknown}, \"vy\": 2, \"valid\": 1}}")));
            assert!(moving.valid && moving.velocity.is_none(), "{unknown}");
        }
        let quoted = parse(br#"{"x": 1, "y": 0, "note": "a \" nan: inf", "diameter": NaN}"#).unwrap();
        assert!(quoted.readings[2].unwrap().valid);
        for bad in ["{\"x\": nanny, \"y\": 0}", "{\"x\": 1, \"y\": 0 NaN}", "NaN", "{\"x\": 1nan, \"y\": 0}"] {
            assert!(parse(bad.as_bytes()).is_err(), "{bad}");
        }
        assert!(!parse(br#"{"x": 1, "y": 0, "valid": 0}"#).unwrap().readings[2].unwrap().valid);
    }
}
