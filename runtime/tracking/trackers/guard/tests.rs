//! Tests samples in the wrong unit and with impossible diameters.

use super::*;
use crate::trackers::line;

struct Scripted(VecDeque<Event>);

impl Source for Scripted {
    fn about(&self) -> About {
        About { name: "scripted".into(), kind: "test", rate_hz: None, notes: Vec::new() }
    }

    fn next(&mut self, _: Duration) -> Result<Event, TrackerError> {
        Ok(self.0.pop_front().unwrap_or(Event::End))
    }
}

/// The readings of these lines behind the guard, the number of its notes, and the dropped data.
fn guarded(lines: &[String]) -> (Vec<Reading>, usize, Dropped) {
    let event = |text: &String| Event::Sample(line::parse(text.as_bytes()).unwrap().sample(1, 1, None), None);
    let mut guard = Guard::new(Box::new(Scripted(lines.iter().map(event).collect())));
    let (mut readings, mut notes) = (Vec::new(), 0);
    loop {
        match guard.next(Duration::ZERO).unwrap() {
            Event::Sample(sample, _) => {
                readings.extend([sample.left, sample.right, sample.combined].into_iter().flatten())
            }
            Event::Note(_) => notes += 1,
            _ => return (readings, notes, guard.dropped()),
        }
    }
}

/// The columns are x, unit and diameter of a line, and the expected x and diameter in mm.
#[test]
fn lengths_in_another_unit_are_recognised_by_the_diameters() {
    for (x, unit, diameter, want) in [
        ("0.003", "", "0.004", (3.0, Some(4.0))),
        ("-0.012", "", "0.0025", (-12.0, Some(2.5))),
        ("0.0", "", "0.008", (0.0, Some(8.0))),
        ("0.003", ", \"unit\": \"mm\"", "0.004", (3.0, Some(4.0))),
        ("0.003", ", \"unit\": \"m\"", "0.004", (3.0, Some(4.0))),
        ("0.003", ", \"unit\": \"m\"", "4", (3.0, Some(4.0))),
        ("3", "", "4", (3.0, Some(4.0))),
        ("3", ", \"unit\": \"m\"", "4000", (3.0, Some(4.0))),
        ("0.003", "", "4", (0.003, Some(4.0))),
        // Positions in mm fit no factor.
        ("8", "", "0.004", (8.0, None)),
        ("3", "", "41", (3.0, None)),
        ("3", "", "0.2", (3.0, None)),
        ("3", "", "1000", (3.0, None)),
    ] {
        let lines = vec![format!("{{\"x\": {x}, \"y\": 0, \"diameter\": {diameter}{unit}}}"); 20];
        let (readings, notes, dropped) = guarded(&lines);
        for reading in &readings {
            let near = |a: f64, b: f64| (a * 1e3 - b).abs() < 1e-9;
            assert!(reading.valid && near(reading.position[0], want.0), "{x}{unit}, {diameter}: {reading}");
            assert!(
                reading.diameter.map_or(want.1.is_none(), |d| want.1.is_some_and(|w| near(d, w))),
                "{x}{unit}, {diameter}: {reading}"
            );
        }
        let drops = if want.1.is_none() { 20 } else { 0 };
        assert_eq!((readings.len(), dropped.diameters), (20, drops), "{x}{unit}, {diameter}");
        assert!(notes <= 1 && (drops == 0 || notes == 1), "said once: {notes}");
    }
}

/// An impossible diameter leaves the rest of its sample. Unknown diameters are not impossible.
#[test]
fn impossible_diameters_are_dropped_and_counted() {
    let diameters = ["3", "0.05", "400", "NaN", "-1", "0", "null", "12.5", "Infinity", "5"];
    let lines = diameters.map(|d| format!("{{\"x\": 5, \"y\": 0, \"diameter\": {d}}}"));
    let (readings, notes, dropped) = guarded(&lines);
    let found: Vec<Option<f64>> = readings.iter().map(|r| r.diameter.map(|d| (d * 1e4).round() / 10.0)).collect();
    let none = None;
    assert_eq!(found, [Some(3.0), none, none, none, none, none, none, none, none, Some(5.0)]);
    assert!(readings.iter().all(|r| r.valid && r.position[0] == 5e-3));
    assert_eq!((notes, dropped.diameters), (1, 3));
}

/// Without diameters and without a unit, an eye that does not leave a few micrometers is doubted.
#[test]
fn an_eye_that_hardly_moves_is_in_doubt_unless_its_unit_is_stated() {
    // The columns are the amplitude in the unit of the line, the unit, the number of samples, and true if it is
    // doubted.
    for (size, unit, samples, doubt) in [
        (0.003, "", 200, true),
        (0.012, "", 200, true),
        (0.0005, "", 1000, true),
        (0.02, "", 200, true),
        (0.003, ", \"unit\": \"mm\"", 200, false),
        (0.003, ", \"unit\": \"m\"", 200, false),
        (0.003, ", \"diameter\": 4", 200, false),
        (0.003, ", \"what\": \"gaze\"", 200, false),
        (0.003, "", 50, false),
        (0.0, "", 1000, false),
        (0.1, "", 200, false),
        (3.0, "", 200, false),
    ] {
        let mut units = Units::default();
        for i in 0..samples {
            let x = size * f64::from(i).sin();
            let line = line::parse(format!("{{\"x\": {x}, \"y\": 0{unit}}}").as_bytes()).unwrap();
            units.take(&line.readings, line.states_unit);
        }
        assert_eq!(units.in_doubt().is_some(), doubt, "{size}{unit}, {samples} samples");
    }
}
