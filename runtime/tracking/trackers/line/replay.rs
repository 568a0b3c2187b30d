//! Replays recorded lines of samples.

use super::{EXAMPLE, LONGEST_LINE, Line, parse};
use crate::trackers::guard::Units;
use crate::trackers::source::{end_of, wait_for};
use crate::trackers::time_unit::{TimeUnit, timeline, unit_of_steps};
use crate::trackers::{About, Dropped, Event, Source, TrackerError, now_ns};
use eyebox_base::error::Reason;
use eyebox_base::files::read;
use eyebox_base::reason;
use std::collections::VecDeque;
use std::io::{BufRead, Read};
use std::path::Path;
use std::time::Duration;

/// Largest number of lines of a recording.
const MOST_LINES: usize = 10_000_000;

/// A line with its time and its arrival, nanoseconds from the first sample.
#[derive(Debug)]
struct Timed {
    time_ns: u64,
    received_ns: u64,
    line: Line,
}

/// Replays the lines of a recording.
#[derive(Debug)]
pub struct LineSource {
    name: String,
    lines: VecDeque<Timed>,
    start_ns: u64,
    real_time: bool,
    latency_ns: u64,
    notes: Vec<String>,
    dropped: Dropped,
}

impl LineSource {
    /// Reads a file of lines.
    ///
    /// # Errors
    /// [`TrackerError::File`] with file and line. [`TrackerError::TimeUnit`] and [`TrackerError::PositionUnit`] are for
    /// numbers of an unknown unit.
    pub fn open(file: &Path, real_time: bool, latency_ns: u64) -> Result<Self, TrackerError> {
        let (lines, notes) = lines_of(file)?;
        let (name, start_ns) = (file.display().to_string(), now_ns());
        let (dropped, lines) = (Dropped::default(), VecDeque::from(lines));
        let mut source = Self { name, lines: VecDeque::new(), start_ns, real_time, latency_ns, notes, dropped };
        source.place(file, lines)?;
        Ok(source)
    }

    fn place(&mut self, file: &Path, mut lines: VecDeque<Line>) -> Result<(), TrackerError> {
        let all = lines.len();
        if all > 1 {
            lines.retain(|line| line.time.is_some());
        }
        if lines.is_empty() {
            return Err(TrackerError::file(
                file,
                reason!("no-time", "no line has a time: add t, in seconds of any clock, to every line"),
            ));
        }
        let untimed = all - lines.len();
        if untimed > 0 {
            self.dropped.messages += untimed as u64;
            self.notes.push(format!("{untimed} lines without a time were dropped"));
        }
        let mut units = Units::default();
        for line in &lines {
            units.take(&line.readings, line.states_unit);
        }
        if let Some(largest) = units.in_doubt() {
            return Err(TrackerError::PositionUnit { name: self.name.clone(), largest_mm: largest * 1e3 });
        }
        let times: Vec<f64> = lines.iter().map(|line| line.time.unwrap_or(0.0)).collect();
        let stated = lines.iter().find_map(|line| line.time_unit);
        // Recordings of eyebox contain arrivals, and their times are seconds.
        let is_own = lines.iter().all(|line| line.received.is_some());
        let unit = match (stated, unit_of_steps(&times)) {
            (Some(stated), _) => stated,
            (None, Err(step)) if !is_own => return Err(TrackerError::TimeUnit { file: self.name.clone(), step }),
            (None, Ok(found)) if !is_own => found,
            _ => TimeUnit::Seconds,
        };
        if unit != TimeUnit::Seconds {
            self.notes.push(format!("its times are {unit}"));
        }
        let to_ns = 1e9 / unit.per_second() as f64;
        let whole: Vec<i128> = times.iter().map(|t| (t * to_ns).round() as i128).collect();
        let (placed, sets) = timeline(&whole);
        self.dropped.clock_sets = sets;
        if sets > 0 {
            self.notes.push(format!("its clock was set {sets} times, and the replay continues with its usual step"));
        }
        let timed = lines.into_iter().zip(placed).map(|(line, time_ns)| {
            let delay = line.received.zip(line.time).map_or(0.0, |(received, time)| (received - time).max(0.0) * to_ns);
            Timed { time_ns, received_ns: time_ns.saturating_add(delay as u64), line }
        });
        let mut timed: Vec<Timed> = timed.collect();
        // Lines of two cameras may be out of order.
        timed.sort_by_key(|line| line.time_ns);
        self.lines = timed.into();
        Ok(())
    }
}

/// The lines of a file, and notes about it.
fn lines_of(file: &Path) -> Result<(Vec<Line>, Vec<String>), TrackerError> {
    let wrong = |reason: Reason| TrackerError::file(file, reason);
    let unreadable = |e: std::io::Error| TrackerError::file(file, e.to_string());
    let mut text = read::lines(file, read::RESULTS).map_err(unreadable)?;
    let (mut lines, mut notes) = (Vec::new(), Vec::new());
    let mut line = Vec::new();
    for number in 1.. {
        line.clear();
        let most = LONGEST_LINE as u64 + 2;
        if (&mut text).take(most).read_until(b'\n', &mut line).map_err(unreadable)? == 0 {
            break;
        }
        let (line, whole) = (line.trim_ascii(), line.ends_with(b"\n"));
        match parse(line) {
            _ if line.is_empty() => {}
            Ok(line) => lines.push(line),
            // The recording program was killed, or its disk was full.
            Err(_) if !whole && line.len() < LONGEST_LINE && !lines.is_empty() => {
                notes.push(format!("the recording is cut off in line {number}, which is left out"));
            }
            Err(e) => return Err(wrong(e.within(format!("line {number}")))),
        }
        if lines.len() > MOST_LINES {
            return Err(wrong(reason!("lines-count", "more than ten million lines")));
        }
    }
    if lines.is_empty() { Err(wrong(reason!("no-samples", "no samples: {EXAMPLE}"))) } else { Ok((lines, notes)) }
}

impl Source for LineSource {
    fn about(&self) -> About {
        About { name: self.name.clone(), kind: "recording", rate_hz: None, notes: self.notes.clone() }
    }

    fn next(&mut self, timeout: Duration) -> Result<Event, TrackerError> {
        let Some(timed) = self.lines.front() else { return Ok(Event::End) };
        let at = |ns: u64| self.start_ns.saturating_add(ns);
        let (time, received) = (at(timed.time_ns), at(timed.received_ns));
        if self.real_time && !wait_for(received, end_of(timeout)) {
            return Ok(Event::Nothing);
        }
        let sample = timed.line.sample(time.saturating_sub(self.latency_ns), received, None);
        self.lines.pop_front();
        Ok(Event::Sample(sample, None))
    }

    fn dropped(&self) -> Dropped {
        self.dropped
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
        assert!(LineSource::open(&file, false, 0).unwrap_err().to_string().contains("line 2"));
    }

    /// The placed times of a recording with these lines, nanoseconds from the first, and the number of changes of its
    /// clock.
    fn replayed(lines: &[String]) -> Result<(Vec<u64>, u64), TrackerError> {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("a.jsonl");
        std::fs::write(&file, lines.join("\n")).unwrap();
        let mut source = LineSource::open(&file, false, 0)?;
        let mut times = Vec::new();
        while let Event::Sample(sample, _) = source.next(Duration::ZERO).unwrap() {
            times.push(sample.time_ns);
        }
        let first = times[0];
        Ok((times.into_iter().map(|t| t - first).collect(), source.dropped().clock_sets))
    }

    fn line(t: impl std::fmt::Display, more: &str) -> String {
        format!("{{\"t\": {t}, \"x\": 1, \"y\": 2{more}}}")
    }

    /// For any origin, sign and unit, at the rates of real trackers, the times between samples are the true ones.
    #[test]
    fn a_recording_may_begin_at_any_time_in_any_unit() {
        let mut cases = 0;
        for unit in TimeUnit::ALL {
            for origin_s in [0.0, -323_801.5, 98.397541, 1.69e9, -0.1] {
                for rate_hz in [30.0, 60.0, 120.0, 250.0, 500.0] {
                    let scale = unit.per_second() as f64;
                    let time = |i: usize| (origin_s + i as f64 / rate_hz) * scale;
                    let lines: Vec<String> = (0..60).map(|i| line(time(i), "")).collect();
                    let (times, sets) =
                        replayed(&lines).unwrap_or_else(|e| panic!("{unit}, {origin_s}, {rate_hz}: {e}"));
                    for (i, at) in times.iter().enumerate() {
                        let off = (*at as f64 - i as f64 / rate_hz * 1e9).abs();
                        assert!(off < 1000.0, "{unit} from {origin_s} s at {rate_hz} Hz, sample {i}: {off} ns");
                    }
                    assert_eq!((times.len(), sets), (60, 0));
                    cases += 1;
                }
            }
        }
        assert_eq!(cases, 100);
    }

    /// Times are refused if no rate is plausible, or two are, until the unit is stated. Then they are read.
    #[test]
    fn times_of_an_unknown_unit_are_asked_for() {
        for step in [1.0, 0.5, 0.4, 1.25, 1e-5, 1e10, 4e8, 2e-4, 1.5, 0.35] {
            let lines = |more: &str| -> Vec<String> { (0..40).map(|i| line(f64::from(i) * step, more)).collect() };
            let refused = replayed(&lines("")).unwrap_err();
            let TrackerError::TimeUnit { step: found, .. } = refused else { panic!("{refused}") };
            assert!((found / step - 1.0).abs() < 1e-6, "{found} for {step}");
            for (name, scale) in [("s", 1e9), ("ms", 1e6), ("us", 1e3), ("ns", 1.0)] {
                if (1.0..5e11).contains(&(step * scale)) {
                    let (times, _) = replayed(&lines(&format!(", \"t_unit\": \"{name}\""))).unwrap();
                    let off = (times[39] as f64 - 39.0 * step * scale).abs();
                    assert!(off <= 1.0 + 1e-6 * times[39] as f64, "{step} {name}: {off} ns off");
                }
            }
        }
    }

    /// Each recording has a clock that is set, duplicates, lines out of order, or lines without a time.
    #[test]
    fn what_clocks_do_in_a_recording_is_followed() {
        let step = 1.0 / 120.0;
        for by in [-2.0, -100.0, 1e6, -1e6, 1.69e9, -0.5, -323_801.0, 700.0, -5000.0, 1e5] {
            let time = |i: usize| 10.0 + i as f64 * step + if i >= 30 { by } else { 0.0 };
            let (times, sets) = replayed(&(0..60).map(|i| line(time(i), "")).collect::<Vec<_>>()).unwrap();
            assert_eq!((times.len(), sets), (60, 1), "{by} s");
            let worst = times.iter().enumerate().map(|(i, t)| (*t as f64 * 1e-9 - i as f64 * step).abs());
            assert!(worst.fold(0.0, f64::max) < 1e-4, "{by} s: {times:?}");
        }
        // A pause stays a pause.
        let time = |i: usize| i as f64 * step + if i >= 30 { 20.0 } else { 0.0 };
        let (times, sets) = replayed(&(0..60).map(|i| line(time(i), "")).collect::<Vec<_>>()).unwrap();
        assert_eq!((times[30] - times[29]) / 1_000_000, 20_008);
        assert_eq!(sets, 0);
        // Two cameras are out of order by less than a picture, and each line is repeated.
        let mut order: Vec<usize> = (0..60).collect();
        order.chunks_exact_mut(2).for_each(|two| two.swap(0, 1));
        let lines: Vec<String> =
            order.iter().flat_map(|i| [line(*i as f64 * step, ""), line(*i as f64 * step, "")]).collect();
        let (times, sets) = replayed(&lines).unwrap();
        assert!(times.is_sorted() && times.len() == 120 && sets == 0 && times[1] == times[0]);
        // Some times are unknown.
        let mut lines: Vec<String> = (0..60).map(|i| line(i as f64 * step, "")).collect();
        (lines[7], lines[20]) = (line("NaN", ""), line("null", ""));
        assert_eq!(replayed(&lines).unwrap().0.len(), 58);
        assert!(matches!(replayed(&vec![line("null", ""); 30]), Err(TrackerError::File { .. })));
    }

    /// Positions in meters without a diameter are refused until the unit is stated. Then they are read.
    #[test]
    fn positions_in_metres_are_asked_for() {
        let lines = |more: &str| -> Vec<String> {
            let x = |i: i32| 0.003 * f64::from(i).sin();
            (0..200).map(|i| format!("{{\"t\": {}, \"x\": {}, \"y\": 0{more}}}", f64::from(i) / 120.0, x(i))).collect()
        };
        assert!(
            matches!(replayed(&lines("")), Err(TrackerError::PositionUnit { largest_mm, .. }) if largest_mm < 0.0031)
        );
        for unit in ["m", "mm"] {
            assert_eq!(replayed(&lines(&format!(", \"unit\": \"{unit}\""))).unwrap().0.len(), 200);
        }
    }
}
