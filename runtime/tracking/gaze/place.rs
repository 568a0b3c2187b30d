//! Maps tracker coordinates to meters in the pupil plane and refuses implausible samples.

use super::{Calibration, Eye, Fit, Settings};
use crate::trackers::{Quantity, Reading, Sample, Unit};
use serde::Serialize;

/// An accepted measurement of the pupil.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Placed {
    /// Time on the samples' clock, nanoseconds.
    pub time_ns: u64,
    /// Position in the pupil plane, meters.
    pub position: [f64; 2],
    /// Velocity in the pupil plane, meters per second, if the tracker reports it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub velocity: Option<[f64; 2]>,
    /// Diameter of the pupil, meters.
    pub diameter: Option<f64>,
    /// Standard deviation of errors that no filter removes, meters. They come from the calibration and from the other
    /// eye.
    pub bias: f64,
}

/// The reason for the refusal of a sample.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error, Serialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Refusal {
    /// The eye was not seen.
    #[error("the eye is not seen")]
    NotSeen,
    /// The confidence is too low.
    #[error("the confidence is too low")]
    Confidence,
    /// There is no map for the measured quantity, so it needs a calibration.
    #[error("the measured quantity needs a calibration")]
    NoMap,
    /// The pupil is farther out than the eyebox.
    #[error("outside the eyebox")]
    OutOfReach,
    /// The sample's time does not advance, runs back, or is later than its arrival.
    #[error("its time is wrong, or the time of an earlier sample")]
    Time,
    /// The eyes are too near to each other, or too far apart.
    #[error("the distance between the eyes is impossible")]
    BetweenEyes,
    /// The movement is faster than any eye.
    #[error("faster than any eye")]
    TooFast,
}

impl Refusal {
    /// All reasons, in the order of [`Counts::refused`].
    pub const ALL: [Self; 7] =
        [Self::NotSeen, Self::Confidence, Self::NoMap, Self::OutOfReach, Self::Time, Self::BetweenEyes, Self::TooFast];

    /// The key of its count in statistics.
    pub fn key(self) -> &'static str {
        ["not_seen", "confidence", "no_map", "out_of_reach", "time", "between_eyes", "too_fast"][self as usize]
    }
}

/// Numbers of samples by result.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Counts {
    /// Number of samples that show where the pupil is.
    pub placed: u64,
    /// Numbers of the other samples by reason, in the order of [`Refusal::ALL`].
    pub refused: [u64; 7],
}

impl Counts {
    pub(super) fn count(&mut self, placed: &Result<Placed, Refusal>) {
        match placed {
            Ok(_) => self.placed += 1,
            Err(refusal) => self.refused[*refusal as usize] += 1,
        }
    }

    /// Number of all samples.
    pub fn samples(&self) -> u64 {
        self.placed + self.refused.iter().sum::<u64>()
    }

    /// The reasons of refusals with their counts, the most frequent first.
    pub fn reasons(&self) -> Vec<(Refusal, u64)> {
        let mut all: Vec<_> = Refusal::ALL.into_iter().zip(self.refused).filter(|(_, count)| *count > 0).collect();
        all.sort_by_key(|(_, count)| std::cmp::Reverse(*count));
        all
    }
}

/// Number of samples that must agree with each other after a jump that no eye makes, or after a change of the clock.
/// The earlier samples were wrong then.
const AGREE: u32 = 3;
/// Readings of the two eyes within this time, nanoseconds, show the difference of the eyes. Cameras of 30 Hz that
/// alternate have this distance.
const TOGETHER_NS: u64 = 40_000_000;
/// A time this far back is not a sample out of order, nanoseconds.
const SET_BACK_NS: u64 = 250_000_000;
/// Assumed difference of the eyes before any was measured, meters.
const UNKNOWN_OFFSET: f64 = 0.5e-3;

/// Maps samples to places. It stores the difference of the eyes and the last accepted sample.
#[derive(Debug, Clone, Default)]
pub struct Placer {
    settings: Settings,
    /// The user's calibration, if there is one.
    pub(super) calibration: Option<Calibration>,
    /// Right minus left, its variance, and the number of its measurements.
    offset: [f64; 2],
    offset_square: f64,
    offset_count: u32,
    /// The newest reading of each eye, with time and place.
    eyes: [Option<(u64, [f64; 2])>; 2],
    /// True if the last sample was of one eye and the difference to the other eye was unknown.
    guessed: bool,
    /// True if earlier places do not belong to the current ones.
    begins_again: bool,
    last: Option<Placed>,
    last_time_ns: Option<u64>,
    /// Samples of a clock that was set back, as time and arrival of the newest and their number.
    set_back: Option<([u64; 2], u32)>,
    suspect: Option<(Placed, u32)>,
    /// The usual confidence of the left, the right and the combined reading.
    usual: [f64; 3],
}

/// A tracker's velocity is mapped by the movement of the reading in this time, seconds.
const SOON: f64 = 1e-4;
/// Below this share of the usual confidence a lid is moving, and the center of the visible part is not the center of
/// the pupil.
const UNUSUAL: f64 = 0.85;

impl Placer {
    /// Creates a placer. Without a calibration it uses the rotation of the eye.
    pub fn new(settings: Settings, calibration: Option<Calibration>) -> Self {
        Self { settings, calibration, ..Self::default() }
    }

    /// Maps a sample to the position of the pupil. `noise` is the standard deviation of its coordinates.
    ///
    /// # Errors
    /// The reason of the refusal.
    pub fn place(&mut self, sample: &Sample, noise: f64) -> Result<Placed, Refusal> {
        self.check_time(sample)?;
        self.between_eyes(sample)?;
        for (usual, reading) in self.usual.iter_mut().zip([&sample.left, &sample.right, &sample.combined]) {
            if let Some(r) = reading.filter(|r| r.valid && r.confidence >= self.settings.confidence) {
                let first = *usual == 0.0;
                *usual += if first { 1.0 } else { 0.01 } * (r.confidence - *usual);
            }
        }
        let placed = self.one(sample)?;
        if placed.position.iter().any(|p| !p.is_finite() || p.abs() > self.settings.reach) {
            return Err(Refusal::OutOfReach);
        }
        self.believe(placed, noise)
    }

    /// True if the last placed sample belongs to another clock, or was a guess from one eye. The next call returns
    /// false.
    pub(super) fn begins_again(&mut self) -> bool {
        std::mem::take(&mut self.begins_again)
    }

    fn check_time(&mut self, sample: &Sample) -> Result<(), Refusal> {
        if sample.time_ns > sample.received_ns {
            return Err(Refusal::Time);
        }
        let Some(last) = self.last_time_ns.filter(|last| sample.time_ns <= *last) else {
            (self.last_time_ns, self.set_back) = (Some(sample.time_ns), None);
            return Ok(());
        };
        if last - sample.time_ns < SET_BACK_NS {
            return Err(Refusal::Time);
        }
        let is = [sample.time_ns, sample.received_ns];
        let count = match self.set_back {
            Some((before, count)) if is[0] > before[0] && is[1] > before[1] => count + 1,
            _ => 1,
        };
        self.set_back = Some((is, count));
        if count < AGREE {
            return Err(Refusal::Time);
        }
        (self.last_time_ns, self.set_back) = (Some(sample.time_ns), None);
        (self.last, self.suspect, self.eyes, self.begins_again) = (None, None, [None; 2], true);
        Ok(())
    }

    fn between_eyes(&self, sample: &Sample) -> Result<(), Refusal> {
        let (Some(l), Some(r)) = (&sample.left, &sample.right) else { return Ok(()) };
        if !(in_space(l) && in_space(r) && l.valid && r.valid) {
            return Ok(());
        }
        let (Some(a), Some(b)) = (l.distance, r.distance) else { return Ok(()) };
        let apart = (l.position[0] - r.position[0]).hypot(l.position[1] - r.position[1]).hypot(a - b);
        let [low, high] = self.settings.between_eyes;
        if (low..=high).contains(&apart) { Ok(()) } else { Err(Refusal::BetweenEyes) }
    }

    /// The place from both eyes, from one eye, or from the combined reading.
    fn one(&mut self, sample: &Sample) -> Result<Placed, Refusal> {
        let (left, right) = (self.map(0, sample), self.map(1, sample));
        // Cameras may alternate, so that each sample has one eye.
        for (newest, found) in self.eyes.iter_mut().zip([&left, &right]) {
            if let Ok(found) = found {
                *newest = Some((found.time_ns, found.position));
            }
        }
        if let ([Some(l), Some(r)], true) = (self.eyes, left.is_ok() || right.is_ok())
            && l.0.abs_diff(r.0) <= TOGETHER_NS
        {
            if std::mem::take(&mut self.guessed) && self.offset_count == 0 {
                (self.last, self.suspect, self.begins_again) = (None, None, true);
            }
            self.compare(l.1, r.1);
        }
        let known = self.offset_count > 0;
        let shifted = |found: Placed, by: f64| {
            let position = [0, 1].map(|i| found.position[i] + by * self.offset[i]);
            // Vergence changes the difference, so the other eye adds uncertainty.
            let bias = found.bias.hypot(if known { self.offset_square.sqrt().min(1e-3) } else { UNKNOWN_OFFSET });
            Placed { position, bias, ..found }
        };
        self.guessed = !known && left.is_ok() != right.is_ok();
        match (self.settings.eye, left, right) {
            (Eye::Left, Ok(l), _) => Ok(l),
            (Eye::Right, _, Ok(r)) => Ok(r),
            (Eye::Left, Err(_), Ok(r)) => Ok(shifted(r, -1.0)),
            (Eye::Right, Ok(l), Err(_)) => Ok(shifted(l, 1.0)),
            (Eye::Mean, Ok(l), Ok(r)) => {
                let mean = |a: [f64; 2], b: [f64; 2]| [0, 1].map(|i| (a[i] + b[i]) / 2.0);
                Ok(Placed {
                    time_ns: sample.time_ns,
                    position: mean(l.position, r.position),
                    velocity: l.velocity.zip(r.velocity).map(|(a, b)| mean(a, b)).or(l.velocity).or(r.velocity),
                    diameter: l.diameter.zip(r.diameter).map(|(a, b)| (a + b) / 2.0).or(l.diameter).or(r.diameter),
                    bias: l.bias.max(r.bias),
                })
            }
            (Eye::Mean, Ok(l), Err(_)) => Ok(shifted(l, 0.5)),
            (Eye::Mean, Err(_), Ok(r)) => Ok(shifted(r, -0.5)),
            (_, Err(why_left), Err(why_right)) => {
                // The best reason is one of a reading that existed but was not good enough.
                self.map(2, sample).map_err(|why| {
                    let told = [why, why_left, why_right].into_iter().find(|w| *w != Refusal::NotSeen);
                    told.unwrap_or(Refusal::NotSeen)
                })
            }
        }
    }

    /// One reading (left, right, combined) in the pupil plane, with the standard deviation of its map.
    fn map(&self, index: usize, sample: &Sample) -> Result<Placed, Refusal> {
        let reading = [&sample.left, &sample.right, &sample.combined][index];
        let Some(reading) = reading.as_ref().filter(|r| r.valid) else { return Err(Refusal::NotSeen) };
        let least = self.settings.confidence.max(UNUSUAL * self.usual[index]);
        if reading.confidence.is_nan() || reading.confidence < least {
            return Err(Refusal::Confidence);
        }
        let fits = self.calibration.as_ref().map(|c| [&c.left, &c.right, &c.combined]);
        let its_unit = |fit: &&Fit| fit.unit == reading.unit;
        let fit = fits.map(|fits| fits[index].as_ref().filter(its_unit).ok_or(Refusal::NoMap)).transpose()?;
        let at = |reading: &Reading, gaze: Option<&Reading>| match fit {
            Some(fit) => Some(fit.map.apply(reading.position)),
            None => rotation(reading, gaze, &self.settings),
        };
        let position = at(reading, sample.combined.as_ref()).ok_or(Refusal::NoMap)?;
        // The place after a short time, by its own velocity and the velocity of the gaze point, if it is placed by one.
        let soon = |reading: &Reading| {
            let velocity = reading.velocity?;
            Some(Reading { position: [0, 1].map(|i| reading.position[i] + SOON * velocity[i]), ..*reading })
        };
        let needs_gaze = fit.is_none() && in_space(reading);
        let gaze = sample.combined.as_ref().filter(|_| needs_gaze);
        let velocity = match gaze {
            Some(gaze) => soon(reading).zip(soon(gaze)).and_then(|(reading, gaze)| at(&reading, Some(&gaze))),
            None => soon(reading).and_then(|reading| at(&reading, None)),
        };
        let velocity = velocity.map(|then| [0, 1].map(|i| (then[i] - position[i]) / SOON));
        let fastest = self.settings.fastest * self.settings.radius;
        Ok(Placed {
            time_ns: sample.time_ns,
            position,
            velocity: velocity.filter(|[x, y]| x.hypot(*y) <= fastest),
            diameter: reading.diameter,
            bias: fit.map_or(0.0, |fit| fit.residual),
        })
    }

    fn compare(&mut self, left: [f64; 2], right: [f64; 2]) {
        if self.offset_count == 0 {
            (self.offset, self.offset_square) = ([0, 1].map(|i| right[i] - left[i]), UNKNOWN_OFFSET.powi(2));
        }
        self.offset_count = self.offset_count.saturating_add(1);
        let share = (1.0 / f64::from(self.offset_count)).max(0.01);
        let difference = [0, 1].map(|i| right[i] - left[i] - self.offset[i]);
        self.offset = [0, 1].map(|i| self.offset[i] + share * difference[i]);
        let square = (difference[0].powi(2) + difference[1].powi(2)) / 2.0;
        let share = (1.0 / (1.0 + f64::from(self.offset_count))).max(0.01);
        self.offset_square += share * (square.min(1e-4) - self.offset_square);
    }

    /// Refuses jumps that no eye makes, until several samples agree on the new place.
    fn believe(&mut self, placed: Placed, noise: f64) -> Result<Placed, Refusal> {
        let near = |a: &Placed| {
            let seconds = placed.time_ns.saturating_sub(a.time_ns) as f64 * 1e-9;
            let far = (placed.position[0] - a.position[0]).hypot(placed.position[1] - a.position[1]);
            far <= self.settings.fastest * self.settings.radius * seconds + 5.0 * noise + 0.25e-3
        };
        let count = match &self.suspect {
            Some((before, count)) if near(before) => count + 1,
            _ => 1,
        };
        if self.last.as_ref().is_none_or(near) || count >= AGREE {
            (self.suspect, self.last) = (None, Some(placed));
            return Ok(placed);
        }
        self.suspect = Some((placed, count));
        Err(Refusal::TooFast)
    }
}

fn in_space(reading: &Reading) -> bool {
    reading.quantity == Quantity::Pupil && reading.unit == Unit::Metres && reading.distance.is_some()
}

/// The pupil's place without a calibration, for an eye that turns about its center, `radius` behind the pupil.
///
/// Positions in the plane are used directly. Directions and gaze points turn the eye. An eye in space is turned by the
/// direction to the gaze point, if there is one.
pub fn rotation(reading: &Reading, gaze: Option<&Reading>, settings: &Settings) -> Option<[f64; 2]> {
    let turned = |angles: [f64; 2]| angles.map(|a| settings.radius * a.sin());
    let towards = |point: [f64; 2], distance: f64| turned(point.map(|p| p.atan2(distance)));
    Some(match (reading.quantity, reading.unit) {
        (_, Unit::Counts) => return None,
        (_, Unit::Normalized) => reading.position.map(|p| (p - 0.5) * settings.picture),
        (_, Unit::Radians) => turned(reading.position),
        (Quantity::Gaze, Unit::Metres) => towards(reading.position, settings.screen_distance),
        (Quantity::Pupil, Unit::Metres) => {
            let gaze = gaze.filter(|g| g.valid && g.quantity == Quantity::Gaze && g.unit == Unit::Metres);
            match (reading.distance, gaze) {
                (Some(z), Some(gaze)) if z > 0.05 => towards([0, 1].map(|i| gaze.position[i] - reading.position[i]), z),
                _ => reading.position,
            }
        }
    })
}
