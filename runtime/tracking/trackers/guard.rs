//! Checks the samples of every source for wrong units and impossible pupil diameters.

use super::{About, Dropped, Event, Head, Quantity, Reading, Sample, Source, TrackerError, Unit};
use std::collections::VecDeque;
use std::time::Duration;

/// Possible diameters of pupils, meters.
const DIAMETERS: std::ops::RangeInclusive<f64> = 0.5e-3..=12e-3;
/// Largest distance of a pupil in its plane from the center, meters.
const REACH: f64 = 30e-3;
/// Largest distance of an eye in space from its tracker, meters.
const SPACE: f64 = 2.0;
/// An eye that moves by no more than this is measured in another unit, meters. Tremor alone is 20 um.
const STILLEST: f64 = 20e-6;
/// Number of samples, and of different positions among them, before positions are doubted.
const DOUBT_SAMPLES: u32 = 100;
const DOUBT_PLACES: u32 = 10;

/// A source whose lengths are checked. Impossible diameters are dropped.
pub(super) struct Guard {
    source: Box<dyn Source>,
    lengths: Lengths,
    dropped: u64,
    notes: VecDeque<String>,
}

impl Guard {
    pub(super) fn new(source: Box<dyn Source>) -> Self {
        Self { source, lengths: Lengths::default(), dropped: 0, notes: VecDeque::new() }
    }

    fn check(&mut self, sample: &mut Sample) {
        let before = self.lengths.factor;
        for reading in [&mut sample.left, &mut sample.right, &mut sample.combined].into_iter().flatten() {
            self.lengths.learn(reading);
        }
        let factor = self.lengths.factor;
        if factor != before {
            let name = self.source.about().name;
            self.notes.push_back(match factor {
                1.0 => format!("{name}: positions use their stated unit again"),
                1e3 => format!("{name}: positions and diameters are in meters, as the diameters show"),
                _ => format!("{name}: positions and diameters are divided by 1000, as the diameters show (micrometers, or millimeters that are stated as meters)"),
            });
        }
        for reading in [&mut sample.left, &mut sample.right, &mut sample.combined].into_iter().flatten() {
            if is_pupil(reading) {
                reading.position = reading.position.map(|p| p * factor);
                reading.distance = reading.distance.map(|z| z * factor);
                reading.velocity = reading.velocity.map(|v| v.map(|v| v * factor));
                reading.diameter = reading.diameter.map(|d| d * factor);
            }
            let Some(wrong) = reading.diameter.take_if(|d| !DIAMETERS.contains(d)) else { continue };
            self.dropped += 1;
            if self.dropped == 1 {
                let name = self.source.about().name;
                let mm = wrong * 1e3;
                self.notes.push_back(format!(
                    "{name}: a pupil diameter of {mm:.4} mm is impossible (0.5 to 12 mm). Such diameters are dropped, \
                     and the rest of their samples is used"
                ));
            }
        }
    }
}

impl Source for Guard {
    fn about(&self) -> About {
        self.source.about()
    }

    fn next(&mut self, timeout: Duration) -> Result<Event, TrackerError> {
        if let Some(note) = self.notes.pop_front() {
            return Ok(Event::Note(note));
        }
        Ok(match self.source.next(timeout)? {
            Event::Sample(mut sample, report) => {
                self.check(&mut sample);
                Event::Sample(sample, report)
            }
            other => other,
        })
    }

    fn dropped(&self) -> Dropped {
        Dropped { diameters: self.dropped, ..Dropped::default() }.and(self.source.dropped())
    }

    fn recording_head(&self) -> Option<Head> {
        self.source.recording_head()
    }
}

fn is_pupil(reading: &Reading) -> bool {
    reading.quantity == Quantity::Pupil && reading.unit == Unit::Metres
}

/// The power of 1000 by which a source's lengths are wrong, as its diameters show.
struct Lengths {
    factor: f64,
    largest: f64,
}

impl Default for Lengths {
    fn default() -> Self {
        Self { factor: 1.0, largest: 0.0 }
    }
}

impl Lengths {
    fn learn(&mut self, reading: &Reading) {
        if !is_pupil(reading) || !reading.valid {
            return;
        }
        let (far, reach) = match reading.distance {
            Some(z) => (reading.position.iter().fold(z.abs(), |far, p| far.max(p.abs())), SPACE),
            None => (reading.position.iter().fold(0.0, |far: f64, p| far.max(p.abs())), REACH),
        };
        self.largest = self.largest.max(far);
        // Any position fits a factor that makes it smaller, so the position must need the factor.
        let fits = |factor: f64| self.largest * factor <= reach && (factor >= 1.0 || self.largest > reach);
        if let Some(diameter) = reading.diameter {
            let is = |factor: &f64| DIAMETERS.contains(&(diameter * factor));
            if let Some(factor) = [1.0, 1e3, 1e-3].into_iter().find(is) {
                self.factor = if fits(factor) { factor } else { 1.0 };
                return;
            }
        }
        if !fits(self.factor) {
            self.factor = 1.0;
        }
    }
}

/// Tests if positions in lines without a unit can be in the assumed millimeters.
#[derive(Debug, Clone, Default)]
pub(super) struct Units {
    samples: u32,
    places: u32,
    last: Option<[f64; 2]>,
    largest: f64,
    stated: bool,
}

impl Units {
    /// Adds the readings of a line, which may state their unit.
    pub(super) fn take(&mut self, readings: &[Option<Reading>], stated: bool) {
        for reading in readings.iter().flatten().filter(|r| r.valid) {
            // Diameters show the unit, and other quantities have another one.
            self.stated |= stated || !is_pupil(reading) || reading.diameter.is_some();
            self.samples = self.samples.saturating_add(1);
            if self.last.replace(reading.position) != Some(reading.position) {
                self.places = self.places.saturating_add(1);
            }
            self.largest = reading.position.iter().fold(self.largest, |far, p| far.max(p.abs()));
        }
    }

    /// The largest coordinate, meters, if an eye cannot move within it.
    pub(super) fn in_doubt(&self) -> Option<f64> {
        let enough = self.samples >= DOUBT_SAMPLES && self.places >= DOUBT_PLACES;
        (enough && !self.stated && self.largest <= STILLEST).then_some(self.largest)
    }
}

#[cfg(test)]
mod tests;
