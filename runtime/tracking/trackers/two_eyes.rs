//! Shares one tracker between the estimators of two eyes, each before a panel of its own.
//!
//! Both estimators receive every sample. Positions of both eyes in one frame, as trackers report them that see a face,
//! become positions before the panel of each eye. If the tracker measures no focus, the directions of both eyes give
//! it.

use super::{About, Dropped, Event, Head, Quantity, Reading, Sample, Source, TrackerError, Unit};
use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// Samples that wait for an estimator. A session that does not read one of its eyes must not use all memory.
const WAITING: usize = 4096;
/// Smallest distance along x of two pupils in one frame, meters. Pupils before panels of their own are closer.
const APART: f64 = 30e-3;

/// Computes the focus of two eyes from their directions.
#[derive(Debug, Clone)]
pub struct Vergence {
    /// Distance of the pupils, meters.
    ipd: f64,
    /// Distance from the center of rotation to the pupil, meters.
    radius: f64,
    /// Sums over the samples since the last movement, which are the direction (x, y) and the difference of the tangents
    /// of both directions. The last field is their number.
    direction: [f64; 2],
    difference: f64,
    count: u32,
}

/// A change of the direction that ends a fixation, radians. At 0.1 mm of noise, the direction of both eyes has a standard
/// deviation of 6.4e-3 at a radius of 11 mm, of which this is 3.4. Saccades of less than 1.3 degrees hardly change the
/// vergence.
const MOVED: f64 = 0.022;
/// The largest number of samples in a mean, which is half a second at 120 Hz.
const MOST: u32 = 64;

impl Vergence {
    /// Creates it for pupils at this distance (meters) that are `radius` before their centers of rotation.
    pub fn new(ipd: f64, radius: f64) -> Self {
        Self { ipd, radius, direction: [0.0; 2], difference: 0.0, count: 0 }
    }

    /// The direction of an eye in radians, from its direction or from its pupil before its own panel.
    fn direction(&self, reading: Option<&Reading>) -> Option<[f64; 2]> {
        let reading = reading.filter(|r| r.valid)?;
        match (reading.quantity, reading.unit) {
            (Quantity::Gaze, Unit::Radians) => Some(reading.position),
            (Quantity::Pupil, Unit::Metres) => {
                Some(reading.position.map(|p| (p / self.radius).clamp(-1.0, 1.0).asin()))
            }
            _ => None,
        }
    }

    /// Processes the readings of both eyes. Returns the focus in dioptres, averaged over a fixation.
    pub fn update(&mut self, left: Option<&Reading>, right: Option<&Reading>) -> Option<f64> {
        let (left, right) = (self.direction(left)?, self.direction(right)?);
        let middle = [0, 1].map(|i| 0.5 * (left[i] + right[i]));
        let before = self.direction.map(|sum| sum / f64::from(self.count.max(1)));
        let moved = (middle[0] - before[0]).hypot(middle[1] - before[1]) > MOVED;
        if moved || self.count == 0 {
            (self.direction, self.difference, self.count) = ([0.0; 2], 0.0, 0);
        } else if self.count == MOST {
            let share = 1.0 - 1.0 / f64::from(MOST);
            self.direction = self.direction.map(|sum| sum * share);
            self.difference *= share;
            self.count -= 1;
        }
        self.direction = [0, 1].map(|i| self.direction[i] + middle[i]);
        self.difference += left[0].tan() - right[0].tan();
        self.count += 1;
        Some(self.difference / f64::from(self.count) / self.ipd)
    }
}

struct Shared {
    source: Box<dyn Source>,
    vergence: Vergence,
    /// The events that an eye has not taken.
    waiting: [VecDeque<Event>; 2],
}

/// The tracker as one of the two eyes reads it.
pub struct EyeSource {
    shared: Arc<Mutex<Shared>>,
    eye: usize,
}

/// Shares a tracker between the left and the right eye.
pub fn share(source: Box<dyn Source>, vergence: Vergence) -> [EyeSource; 2] {
    let shared = Arc::new(Mutex::new(Shared { source, vergence, waiting: Default::default() }));
    [0, 1].map(|eye| EyeSource { shared: Arc::clone(&shared), eye })
}

impl Shared {
    /// Puts the readings of a sample before the panels of their eyes, and adds the focus.
    fn prepare(&mut self, sample: &mut Sample) {
        if let (Some(left), Some(right)) = (&mut sample.left, &mut sample.right) {
            let in_metres = |r: &Reading| r.valid && r.quantity == Quantity::Pupil && r.unit == Unit::Metres;
            let apart = right.position[0] - left.position[0];
            if in_metres(left) && in_metres(right) && apart.abs() > APART {
                // The tracker's x axis may point to the other side.
                let half = 0.5 * self.vergence.ipd.copysign(apart);
                left.position[0] += half;
                right.position[0] -= half;
            }
        }
        let focus = self.vergence.update(sample.left.as_ref(), sample.right.as_ref());
        sample.focus_dioptres = sample.focus_dioptres.or(focus.filter(|focus| super::line::is_focus(*focus)));
    }
}

impl EyeSource {
    fn lock(&self) -> MutexGuard<'_, Shared> {
        // The state is complete between two events.
        self.shared.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Source for EyeSource {
    fn about(&self) -> About {
        self.lock().source.about()
    }

    /// The eye that waits reads for both. The other one waits for the lock, and then finds the sample.
    fn next(&mut self, timeout: Duration) -> Result<Event, TrackerError> {
        let mut shared = self.lock();
        if let Some(event) = shared.waiting[self.eye].pop_front() {
            return Ok(event);
        }
        let mut event = shared.source.next(timeout)?;
        if let Event::Sample(sample, _) = &mut event {
            shared.prepare(sample);
        }
        // Notes are for people, who need them once.
        if matches!(event, Event::Sample(..) | Event::End) {
            let other = &mut shared.waiting[1 - self.eye];
            if other.len() == WAITING {
                other.pop_front();
            }
            other.push_back(event.clone());
        }
        Ok(event)
    }

    fn dropped(&self) -> Dropped {
        self.lock().source.dropped()
    }

    fn recording_head(&self) -> Option<Head> {
        self.lock().source.recording_head()
    }

    fn tracker(&self) -> Option<String> {
        self.lock().source.tracker()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::trackers::simulated::{Eye, Settings, Side, SimulatedSource};

    const IPD: f64 = 63e-3;

    fn settings(noise: f64) -> Settings {
        let (ipd, focus) = (IPD, [0.0, 3.0]);
        Settings { seed: 5, noise, ipd, focus, blinks: 0.0, ..Settings::default() }
    }

    fn samples(eye: &mut EyeSource, count: usize) -> Vec<Sample> {
        let next = |_| match eye.next(Duration::ZERO).unwrap() {
            Event::Sample(sample, _) => sample,
            other => panic!("{other:?}"),
        };
        (0..count).map(next).collect()
    }

    /// Returns the median error of the vergence in minutes of arc.
    fn median_error(noise: f64) -> f64 {
        let source = SimulatedSource::starting(settings(noise), false, 0).unwrap();
        let [mut left, mut right] = share(Box::new(source), Vergence::new(IPD, 11e-3));
        let mut truth = Eye::new(settings(noise), 0).of(Side::Left);
        let of_left = samples(&mut left, 2000);
        assert_eq!(of_left, samples(&mut right, 2000), "both eyes receive the same samples");
        let error = |sample: &Sample| {
            let off = sample.focus_dioptres.unwrap() - truth.at(sample.time_ns).dioptres;
            (off * IPD).abs().to_degrees() * 60.0
        };
        let mut errors: Vec<f64> = of_left.iter().map(error).collect();
        errors.sort_by(f64::total_cmp);
        errors[errors.len() / 2]
    }

    #[test]
    fn directions_give_the_focus() {
        let (exact, noisy) = (median_error(0.0), median_error(0.1e-3));
        println!("vergence: {exact:.2} arcmin without noise, {noisy:.2} arcmin with 0.1 mm");
        assert!(exact < 2.0, "{exact} arcmin without noise");
        assert!((1.0..8.0).contains(&noisy), "{noisy} arcmin with 0.1 mm of noise");
    }

    /// A tracker that sees a face reports pupils as far apart as they are.
    #[test]
    fn positions_in_one_frame_become_positions_before_each_panel() {
        struct Face(u64, f64);
        impl Source for Face {
            fn about(&self) -> About {
                About { name: "face".into(), kind: "program", rate_hz: None, notes: Vec::new() }
            }
            fn next(&mut self, _: Duration) -> Result<Event, TrackerError> {
                self.0 += 1_000_000;
                let at = |x: f64| Some(Reading::new(Quantity::Pupil, Unit::Metres, [x, 1e-3]));
                let (left, right) = (at(-self.1 * 30.5e-3), at(self.1 * 33.5e-3));
                Ok(Event::Sample(Sample { left, right, ..Sample::empty(self.0) }, None))
            }
        }
        for side in [1.0, -1.0] {
            let [mut left, _right] = share(Box::new(Face(0, side)), Vergence::new(IPD, 11e-3));
            let sample = samples(&mut left, 1).remove(0);
            let x = [sample.left, sample.right].map(|eye| eye.unwrap().position[0] * side);
            assert!((x[0] - 1e-3).abs() < 1e-12 && (x[1] - 2e-3).abs() < 1e-12, "{x:?}");
        }
    }
}
