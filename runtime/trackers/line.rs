//! Samples as JSON, one object a line: what datagrams carry, and what is recorded of sources without reports.
//!
//! ```json
//! {"t": 12.345, "x": 1.5, "y": -0.2, "diameter": 4.1}
//! {"t": 12.345, "x": 1.5, "y": -0.2, "vx": 12.0, "vy": 0.5}
//! {"t": 12.345, "left": {"x": 1.5, "y": -0.2, "confidence": 0.9}, "right": {"x": 1.4, "y": -0.2, "valid": false}}
//! ```
//!
//! `t` is the sender's time in seconds, of any clock that is steady; without it the arrival counts. A position has `x`
//! and `y`, and may have `z`, `unit` (`mm`, `deg`, `normalized`, `counts`; default `mm`), `what` (`pupil` or `gaze`;
//! default `pupil`), `vx` and `vy` (how fast it moves, `unit` a second: both or none), `diameter` (mm), `confidence` (0 to 1)
//! and `valid`. It stands at the top, or under `left`, `right`
//! and `combined`. Beside it, at the top, `focus_d` is what the eyes focus at, dioptres; without it, `ipd_mm`, the distance
//! between the eyes, makes a focus of where both look (`what` `gaze`, `unit` `deg`). What else an object has is ignored.

use super::{About, Event, Quantity, Reading, Sample, Source, TrackerError, Unit, now_ns};
use serde::{Deserialize, Serialize};
use std::collections::VecDeque;
use std::io::{BufRead, BufReader, Read};
use std::path::Path;
use std::time::Duration;

/// Longest line, bytes.
pub(crate) const LONGEST_LINE: usize = 2048;

#[derive(Debug, Clone, Copy, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
enum UnitText {
    #[default]
    Mm,
    Deg,
    Normalized,
    Counts,
}

#[derive(Debug, Clone, Copy, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
enum WhatText {
    #[default]
    Pupil,
    Gaze,
}

#[derive(Debug, Clone, Copy, Default, Serialize, Deserialize)]
struct ReadingText {
    x: Option<f64>,
    y: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    z: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    vx: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    vy: Option<f64>,
    #[serde(default)]
    unit: UnitText,
    #[serde(default)]
    what: WhatText,
    #[serde(skip_serializing_if = "Option::is_none")]
    diameter: Option<f64>,
    #[serde(default = "one")]
    confidence: f64,
    #[serde(default = "yes")]
    valid: bool,
}

#[derive(Debug, Serialize, Deserialize)]
struct SampleText {
    t: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    received: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    tracker_ns: Option<u64>,
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

fn one() -> f64 {
    1.0
}

fn yes() -> bool {
    true
}

impl ReadingText {
    fn reading(self) -> Reading {
        let (unit, scale) = match self.unit {
            UnitText::Mm => (Unit::Metres, 1e-3),
            UnitText::Deg => (Unit::Radians, 1f64.to_radians()),
            UnitText::Normalized => (Unit::Normalized, 1.0),
            UnitText::Counts => (Unit::Counts, 1.0),
        };
        let quantity = match self.what {
            WhatText::Pupil => Quantity::Pupil,
            WhatText::Gaze => Quantity::Gaze,
        };
        let position = [self.x, self.y].map(|v| v.map_or(f64::NAN, |v| v * scale));
        Reading {
            quantity,
            unit,
            position,
            distance: self.z.map(|z| z * scale),
            velocity: self.vx.zip(self.vy).map(|(x, y)| [x * scale, y * scale]),
            diameter: self.diameter.map(|d| d * 1e-3),
            valid: self.valid,
            confidence: self.confidence,
        }
        .checked()
    }

    fn of(reading: &Reading) -> Self {
        let (unit, scale) = match reading.unit {
            Unit::Metres => (UnitText::Mm, 1e3),
            Unit::Radians => (UnitText::Deg, 1f64.to_degrees()),
            Unit::Normalized => (UnitText::Normalized, 1.0),
            Unit::Counts => (UnitText::Counts, 1.0),
        };
        // To a billionth, so that 1.5 mm are not written as 1.5000000000000002.
        let scaled = |v: f64| (v * scale * 1e9).round() / 1e9;
        let [x, y] = reading.position.map(|v| reading.valid.then(|| scaled(v)));
        let velocity = reading.velocity.filter(|_| reading.valid).map(|v| v.map(scaled));
        Self {
            x,
            y,
            z: reading.distance.filter(|_| reading.valid).map(scaled),
            vx: velocity.map(|v| v[0]),
            vy: velocity.map(|v| v[1]),
            unit,
            what: if reading.quantity == Quantity::Gaze { WhatText::Gaze } else { WhatText::Pupil },
            diameter: reading.diameter.map(|d| (d * 1e12).round() / 1e9),
            confidence: reading.confidence,
            valid: reading.valid,
        }
    }
}

/// A line, understood: the sender's time in seconds, when it says that it received it, and the readings.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Line {
    /// Seconds of the sender's clock.
    pub seconds: Option<f64>,
    /// Of the same clock, in recorded lines.
    pub received: Option<f64>,
    /// Left, right, combined.
    pub readings: [Option<Reading>; 3],
    /// What the eyes focus at, dioptres.
    pub focus_dioptres: Option<f64>,
}

impl Line {
    /// The sample that it is, with its times.
    pub(super) fn sample(self, time_ns: u64, received_ns: u64, tracker_ns: Option<u64>) -> Sample {
        let [left, right, combined] = self.readings;
        Sample { time_ns, received_ns, tracker_ns, left, right, combined, focus_dioptres: self.focus_dioptres }
    }
}

/// Dioptres that eyes focus at; what is beyond is a mistake of the tracker.
const FOCUS: std::ops::RangeInclusive<f64> = -10.0..=30.0;
/// Distances between eyes, mm.
const BETWEEN_EYES: std::ops::RangeInclusive<f64> = 40.0..=85.0;

/// What two eyes that are so far apart (mm) focus at, dioptres, where they look at one point: the difference of the tangents
/// of their directions, over their distance.
fn vergence(left: Option<Reading>, right: Option<Reading>, apart_mm: f64) -> Option<f64> {
    let is_direction = |r: &Reading| r.valid && r.quantity == Quantity::Gaze && r.unit == Unit::Radians;
    let (left, right) = (left.filter(is_direction)?, right.filter(is_direction)?);
    Some((left.position[0].tan() - right.position[0].tan()) / (apart_mm * 1e-3))
}

/// Reads one line.
///
/// # Errors
/// What is wrong with it.
pub fn parse(line: &[u8]) -> Result<Line, String> {
    if line.len() > LONGEST_LINE {
        return Err(format!("{} bytes: a line has {LONGEST_LINE} at most", line.len()));
    }
    let text: SampleText = serde_json::from_slice(line).map_err(|e| e.to_string())?;
    let mut combined = text.combined;
    if combined.is_none() && text.left.is_none() && text.right.is_none() {
        let top: ReadingText = serde_json::from_slice(line).map_err(|e| e.to_string())?;
        combined = Some(top).filter(|t| t.x.is_some() || t.y.is_some() || !t.valid);
    }
    let readings = [text.left, text.right, combined].map(|r| r.map(ReadingText::reading));
    if readings.iter().all(Option::is_none) {
        return Err("no position: expected x and y, at the top or under left, right or combined".into());
    }
    if let Some(apart) = text.ipd_mm.filter(|apart| !BETWEEN_EYES.contains(apart)) {
        return Err(format!("ipd_mm is {apart}: eyes are {} to {} mm apart", BETWEEN_EYES.start(), BETWEEN_EYES.end()));
    }
    let focus = text.focus_d.or_else(|| vergence(readings[0], readings[1], text.ipd_mm?));
    let focus_dioptres = focus.filter(|focus| FOCUS.contains(focus));
    let time = |t: Option<f64>| t.filter(|t| (0.0..1e10).contains(t));
    Ok(Line { seconds: time(text.t), received: time(text.received), readings, focus_dioptres })
}

/// Writes a sample as one line, without its end.
pub fn write(sample: &Sample) -> String {
    let seconds = |ns: u64| ns as f64 * 1e-9;
    let text = SampleText {
        t: Some(seconds(sample.time_ns)),
        received: Some(seconds(sample.received_ns)),
        tracker_ns: sample.tracker_ns,
        focus_d: sample.focus_dioptres,
        ipd_mm: None,
        left: sample.left.as_ref().map(ReadingText::of),
        right: sample.right.as_ref().map(ReadingText::of),
        combined: sample.combined.as_ref().map(ReadingText::of),
    };
    // Numbers and names only: nothing that JSON cannot say.
    serde_json::to_string(&text).unwrap_or_default()
}

/// Replays recorded lines.
#[derive(Debug)]
pub struct LineSource {
    name: String,
    lines: VecDeque<Line>,
    first: Option<f64>,
    start_ns: u64,
    real_time: bool,
    latency_ns: u64,
    notes: Vec<String>,
}

impl LineSource {
    /// Reads a file of lines.
    ///
    /// # Errors
    /// [`TrackerError::File`], naming file and line.
    pub fn open(file: &Path, real_time: bool, latency_ns: u64) -> Result<Self, TrackerError> {
        let wrong = |reason: String| TrackerError::file(file, reason);
        let mut text = BufReader::new(crate::files::read::open(file).map_err(|e| wrong(e.to_string()))?);
        let (mut lines, mut notes) = (VecDeque::new(), Vec::new());
        let mut line = Vec::new();
        for number in 1.. {
            line.clear();
            let most = LONGEST_LINE as u64 + 2;
            if (&mut text).take(most).read_until(b'\n', &mut line).map_err(|e| wrong(e.to_string()))? == 0 {
                break;
            }
            let (line, whole) = (line.trim_ascii(), line.ends_with(b"\n"));
            match parse(line) {
                _ if line.is_empty() => {}
                Ok(line) => lines.push_back(line),
                // What recorded it was ended by force, or its disk was full.
                Err(_) if !whole && line.len() < LONGEST_LINE && !lines.is_empty() => {
                    notes.push(format!("the recording is cut off in line {number}, which is left out"));
                }
                Err(e) => return Err(wrong(format!("line {number}: {e}"))),
            }
            if lines.len() > 10_000_000 {
                return Err(wrong("more than ten million lines".into()));
            }
        }
        if lines.is_empty() {
            return Err(wrong("no samples".into()));
        }
        let (name, start_ns) = (file.display().to_string(), now_ns());
        Ok(Self { name, lines, first: None, start_ns, real_time, latency_ns, notes })
    }
}

impl Source for LineSource {
    fn about(&self) -> About {
        About { name: self.name.clone(), kind: "recording", rate_hz: None, notes: self.notes.clone() }
    }

    fn next(&mut self, timeout: Duration) -> Result<Event, TrackerError> {
        let Some(line) = self.lines.front() else { return Ok(Event::End) };
        let seen = line.seconds.unwrap_or(0.0);
        let first = *self.first.get_or_insert(seen);
        let at = |seconds: f64| self.start_ns.saturating_add(((seconds - first).max(0.0) * 1e9) as u64);
        let (time, received) = (at(seen), at(line.received.unwrap_or(seen).max(seen)));
        if self.real_time {
            let until = now_ns().saturating_add(u64::try_from(timeout.as_nanos()).unwrap_or(u64::MAX));
            let now = now_ns();
            std::thread::sleep(Duration::from_nanos(received.min(until).saturating_sub(now)));
            if received > until {
                return Ok(Event::Nothing);
            }
        }
        let sample = line.sample(time.saturating_sub(self.latency_ns), received, None);
        self.lines.pop_front();
        Ok(Event::Sample(sample, None))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_say_what_they_mean() {
        let line = parse(br#"{"t": 2.5, "x": 1.5, "y": -2, "diameter": 4, "mood": "fine"}"#).unwrap();
        assert_eq!(line.seconds, Some(2.5));
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

        for bad in ["", "{}", "[]", "null", "{\"x\": \"1\"}", "{\"x\": 1", "{\"t\": 1}", "{\"left\": 3}", "\u{1}"] {
            assert!(parse(bad.as_bytes()).is_err(), "{bad}");
        }
        assert!(!parse(br#"{"x": 1}"#).unwrap().readings[2].unwrap().valid, "half a position");
        assert!(!parse(br#"{"x": 1e999, "y": 0}"#).is_ok_and(|l| l.readings[2].unwrap().valid));
        assert!(!parse(br#"{"x": 1, "y": 0, "confidence": 7}"#).unwrap().readings[2].unwrap().valid);
        assert_eq!(parse(br#"{"x": 1, "y": 0, "t": -5}"#).unwrap().seconds, None);
    }

    #[test]
    fn the_focus_is_said_or_follows_from_where_both_eyes_look() {
        let focus = |text: &str| parse(text.as_bytes()).unwrap().focus_dioptres;
        assert_eq!(focus(r#"{"x": 1, "y": 2, "focus_d": 1.5}"#), Some(1.5));
        assert_eq!(focus(r#"{"x": 1, "y": 2}"#), None);
        assert_eq!(focus(r#"{"x": 1, "y": 2, "focus_d": 500}"#), None, "no eye does");
        // Both look at a point half a metre away and 0.1 m to the right, 64 mm apart: 2 dioptres.
        let degrees = |x: f64| (x / 0.5).atan().to_degrees();
        let eyes = |left: f64, right: f64, rest: &str| {
            let eye = |x: f64| format!(r#"{{"what": "gaze", "unit": "deg", "x": {x}, "y": 3}}"#);
            format!(r#"{{"left": {}, "right": {}{rest}}}"#, eye(degrees(left)), eye(degrees(right)))
        };
        let found = focus(&eyes(0.132, 0.068, r#", "ipd_mm": 64"#)).unwrap();
        assert!((found - 2.0).abs() < 1e-9, "{found}");
        assert_eq!(focus(&eyes(0.132, 0.068, "")), None, "not asked for");
        assert_eq!(focus(&eyes(0.132, 0.068, r#", "ipd_mm": 64, "focus_d": 0.5"#)), Some(0.5), "what is said wins");
        assert!(parse(eyes(0.1, 0.1, r#", "ipd_mm": 0.064"#).as_bytes()).unwrap_err().contains("40 to 85 mm"));
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
        assert!((line.seconds.unwrap() - 4.99).abs() < 1e-12);
    }

    #[test]
    fn recorded_lines_are_replayed_with_their_times() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("a.jsonl");
        std::fs::write(
            &file,
            "{\"t\": 1.0, \"received\": 1.01, \"x\": 1, \"y\": 2}\n\n{\"t\": 1.5, \"x\": 1, \"y\": 2}\n",
        )
        .unwrap();
        let mut source = LineSource::open(&file, false, 0).unwrap();
        let mut next = || match source.next(Duration::ZERO).unwrap() {
            Event::Sample(sample, None) => Some(sample),
            _ => None,
        };
        let (a, b) = (next().unwrap(), next().unwrap());
        assert_eq!((b.time_ns - a.time_ns, a.received_ns - a.time_ns), (500_000_000, 10_000_000));
        assert_eq!(next(), None);
        std::fs::write(&file, "{\"t\": 1.0, \"x\": 1, \"y\": 2}\nx\n").unwrap();
        assert!(LineSource::open(&file, false, 0).unwrap_err().to_string().contains("a.jsonl: line 2"));
    }
}
