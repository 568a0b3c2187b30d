//! Estimates the pupil's distribution at the time of light from samples.

use super::one_euro::OneEuro;
use super::place::{Counts, Placed, Placer, Refusal};
use super::saccade::{Jump, Point, slope};
use super::stages::{Phase, Stages};
use super::{Calibration, GazeError, Settings};
use crate::trackers::Sample;
use eyebox_optics::{PupilDistribution, depth_of_dioptres};
use serde::Serialize;
use std::collections::VecDeque;

#[derive(Debug, Clone)]
enum State {
    Unseen,
    Steady(OneEuro),
    Jumping(Jump),
    Lost { held: [f64; 2], spread: f64, since_ns: u64 },
    Returning { held: [f64; 2], spread: f64, since_ns: u64, seen_ns: u64, points: VecDeque<Point> },
}

/// The velocity of an eye, if the samples determine it.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct EyeVelocity {
    /// Velocity of the pupil in the pupil plane, meters per second (x, y). It is the tracker's own value, or the
    /// velocity that [`Estimator::predict`] uses.
    pub pupil: [f64; 2],
    /// Angular velocity of the eye about its center, radians per second (x, y), and the standard deviation of each
    /// component. It is none during a saccade, or if the eye has been seen for too short a time.
    pub turning: Option<([f64; 2], f64)>,
}

/// Follows one pupil. It is deterministic, and all times come with the samples.
#[derive(Debug, Clone)]
pub struct Estimator {
    settings: Settings,
    placer: Placer,
    state: State,
    /// The accepted measurements of the last tenth of a second.
    recent: VecDeque<Point>,
    /// The filter after each of these measurements.
    filters: VecDeque<OneEuro>,
    /// Measurements of at most half a second since the eye came to rest or began to follow. They give its angular
    /// velocity.
    course: VecDeque<Point>,
    /// Storage for the measurements of a saccade, or of an eye that returns.
    room: VecDeque<Point>,
    /// Variance of each measured coordinate.
    noise: f64,
    /// Number of measurements behind `noise`. The first assumption counts as ten.
    noise_count: u32,
    bias: f64,
    diameter: Option<(f64, f64)>,
    /// Mean and variance of the focus of the eyes, dioptres.
    focus: Option<(f64, f64)>,
    /// Velocity of the pupil as the tracker reports it, meters per second. `told_noise` is its variance along each
    /// axis, from the changes between samples of a steady eye.
    told: Option<[f64; 2]>,
    told_noise: f64,
    /// Time of the last accepted measurement.
    last_ns: u64,
    counts: Counts,
}

const REMEMBERED_NS: u64 = 100_000_000;
const REMEMBERED: usize = 256;
/// Duration of the slope of the eye's course, and the largest and least number of its measurements.
const COURSE_NS: u64 = 500_000_000;
const LONGEST_COURSE: usize = 512;
const FEWEST: usize = 4;
/// Drift of an eye that fixates, radians per second. It is a quarter of a degree per second (Martinez-Conde et al.
/// 2004).
const DRIFT: f64 = 4.4e-3;
/// Window of the residuals.
const WINDOW_NS: u64 = 8_000_000;
/// A saccade is detected this long after its start, seconds. The steady prediction is wrong until then.
const NOTICED: f64 = 0.02;
/// Lids spoil measurements for about this time before and after they cover the eye.
const LID_NS: u64 = 45_000_000;
/// A gap of one or two missing samples is not a loss.
const MISSED_NS: u64 = 20_000_000;
/// Losses shorter than this are not blinks.
const DROPOUT_NS: u64 = 40_000_000;
/// Longest time of an extrapolation, seconds.
const FARTHEST: f64 = 0.1;
/// Unforeseen acceleration of smooth pursuit, meters per square second (100 degrees per square second, Robinson 1965).
const ACCELERATION: f64 = 0.02;
/// Amplitude of drift and tremor, meters.
const TREMBLE: f64 = 0.02e-3;
/// Assumed noise before any is measured, meters.
const FIRST_NOISE: f64 = 0.15e-3;

impl Estimator {
    /// Follows the pupil of `settings.eye`.
    ///
    /// # Errors
    /// [`GazeError::Setting`] if a setting is out of its range.
    pub fn new(settings: Settings, calibration: Option<Calibration>) -> Result<Self, GazeError> {
        let settings = settings.check()?;
        Ok(Self {
            placer: Placer::new(settings.clone(), calibration),
            settings,
            state: State::Unseen,
            recent: VecDeque::new(),
            filters: VecDeque::new(),
            course: VecDeque::new(),
            room: VecDeque::new(),
            noise: FIRST_NOISE * FIRST_NOISE,
            noise_count: 10,
            bias: 0.0,
            diameter: None,
            focus: None,
            told: None,
            told_noise: 0.0,
            last_ns: 0,
            counts: Counts::default(),
        })
    }

    /// Processes the next sample.
    pub fn update(&mut self, sample: &Sample) -> Stages {
        let placed = self.placer.place(sample, self.noise.sqrt());
        self.counts.count(&placed);
        if self.placer.begins_again() {
            self.state = State::Unseen;
            self.forget();
        }
        if let (Ok(_), Some(focus)) = (&placed, sample.focus_dioptres) {
            self.focus = Some(averaged(self.focus, focus));
        }
        match &placed {
            Ok(placed) => self.seen(placed),
            Err(Refusal::NotSeen | Refusal::Confidence | Refusal::NoMap)
                if sample.time_ns.saturating_sub(self.last_ns) > MISSED_NS =>
            {
                self.unseen();
            }
            // One or two wrong samples are skipped. A tracker that sends only wrong ones has lost the eye.
            Err(_) if sample.time_ns.saturating_sub(self.last_ns) > 60_000_000 => self.unseen(),
            Err(_) => {}
        }
        Stages {
            placed,
            filtered: if let State::Steady(filter) = &self.state { Some(*filter) } else { None },
            saccade: if let State::Jumping(jump) = &self.state { Some(jump.flight) } else { None },
            phase: self.phase(),
            noise: self.noise.sqrt(),
        }
    }

    /// A note for the user if the calibration was made with another tracker than the one of this name.
    pub fn note_on(&self, tracker: &str) -> Option<String> {
        self.placer.calibration.as_ref()?.note_on(tracker)
    }

    /// Counts the samples by their results.
    pub fn counts(&self) -> Counts {
        self.counts
    }

    /// The current movement of the eye.
    pub fn phase(&self) -> Phase {
        match &self.state {
            State::Unseen => Phase::Unseen,
            State::Steady(_) => Phase::Steady,
            State::Jumping(_) => Phase::Saccade,
            State::Lost { .. } => Phase::Lost,
            State::Returning { .. } => Phase::Returning,
        }
    }

    fn one_euro(&self, time_ns: u64, position: [f64; 2], count: u32) -> OneEuro {
        OneEuro::new(time_ns, position, count, [self.settings.cutoff, self.settings.beta, self.settings.speed_cutoff])
    }

    fn seen(&mut self, placed: &Placed) {
        let (time, position) = (placed.time_ns, placed.position);
        // A silence has the same effect as a loss.
        if !matches!(self.state, State::Unseen) && time.saturating_sub(self.last_ns) > 2 * DROPOUT_NS {
            self.unseen();
        }
        self.last_ns = time;
        self.bias = placed.bias;
        if let (State::Steady(_), Some(velocity), Some(before)) = (&self.state, placed.velocity, self.told) {
            let change = (0..2).map(|i| (velocity[i] - before[i]).powi(2)).sum::<f64>() / 4.0;
            // The eye causes outliers when it begins to move or to jump.
            let usual = self.told_noise.max((DRIFT * self.settings.radius).powi(2));
            self.told_noise += 0.05 * (change.min(8.0 * usual) - self.told_noise);
        }
        self.told = placed.velocity;
        if let Some(d) = placed.diameter.filter(|d| (0.5e-3..12e-3).contains(d)) {
            self.diameter = Some(averaged(self.diameter, d));
        }
        self.recent.push_back((time, position));
        keep_newest(&mut self.recent, REMEMBERED, |p| p.0.saturating_add(REMEMBERED_NS) >= time);
        self.state = match std::mem::replace(&mut self.state, State::Unseen) {
            State::Unseen => State::Steady(self.one_euro(time, position, 1)),
            State::Steady(filter) => self.steady(filter, time, position),
            State::Jumping(mut jump) => {
                jump.update((time, position), self.noise, &self.settings);
                if jump.over(self.noise, &self.settings) {
                    let filter = self.landed(&jump, time);
                    self.room = jump.into_room();
                    State::Steady(filter)
                } else {
                    State::Jumping(jump)
                }
            }
            State::Lost { held, spread, since_ns } => {
                if time.saturating_sub(since_ns) < DROPOUT_NS {
                    State::Steady(self.again(held, spread, time, &[(time, position)]))
                } else {
                    State::Returning { held, spread, since_ns, seen_ns: time, points: self.empty_room() }
                }
            }
            State::Returning { held, spread, since_ns, seen_ns, mut points } => {
                if time.saturating_sub(seen_ns) >= LID_NS && points.len() < REMEMBERED {
                    points.push_back((time, position));
                }
                let long = points.front().is_some_and(|p| time - p.0 >= WINDOW_NS);
                if long && points.len() >= 2 {
                    let filter = self.again(held, spread, time, points.make_contiguous());
                    self.room = points;
                    State::Steady(filter)
                } else {
                    State::Returning { held, spread, since_ns, seen_ns, points }
                }
            }
        };
        match &self.state {
            State::Steady(filter) => {
                self.filters.push_back(*filter);
                keep_newest(&mut self.filters, REMEMBERED, |f| f.time_ns.saturating_add(REMEMBERED_NS) >= time);
                self.course.push_back((time, position));
                keep_newest(&mut self.course, LONGEST_COURSE, |p| p.0.saturating_add(COURSE_NS) >= time);
            }
            _ => {
                self.filters.clear();
                self.course.clear();
            }
        }
    }

    fn steady(&mut self, mut filter: OneEuro, time: u64, position: [f64; 2]) -> State {
        if let Some(jump) = self.noticed(time) {
            return State::Jumping(jump);
        }
        self.measure_noise();
        filter.update(time, position);
        State::Steady(filter)
    }

    /// Measures the variance of the coordinates from second differences, which no steady motion changes.
    fn measure_noise(&mut self) {
        let mut last = self.recent.iter().rev().map(|p| p.1);
        let (Some(c), Some(b), Some(a)) = (last.next(), last.next(), last.next()) else { return };
        let square = [0, 1].map(|i| (c[i] - 2.0 * b[i] + a[i]).powi(2)).iter().sum::<f64>() / 12.0;
        // Outliers are saccades or artifacts, not noise.
        self.noise_count = self.noise_count.saturating_add(1);
        let share = (1.0 / f64::from(self.noise_count)).max(0.01);
        self.noise += share * (square.min(8.0 * self.noise) - self.noise);
        self.noise = self.noise.max(1e-12);
    }

    /// Detects a saccade if the newest measurements have left the steady prediction at high speed.
    fn noticed(&mut self, time: u64) -> Option<Jump> {
        // The reference is a filter without the measurements of the window.
        let before = self.filters.iter().rev().find(|f| f.time_ns.saturating_add(WINDOW_NS) < time)?;
        let (mut mean, mut n) = ([0.0; 2], 0.0);
        for (t, p) in
            self.recent.iter().rev().take_while(|p| p.0.saturating_add(WINDOW_NS) >= time && p.0 > before.time_ns)
        {
            let expected = before.at(*t, self.noise);
            mean = [0, 1].map(|i| mean[i] + p[i] - expected[i]);
            n += 1.0;
        }
        let off = (mean[0] / n).hypot(mean[1] / n);
        let ahead = (time - before.time_ns) as f64 * 1e-9 + before.lag;
        let variance = self.noise * (1.0 / n + before.gain + ahead * ahead * before.velocity_gain);
        let degree = self.settings.radius * 1f64.to_radians();
        if off <= degree.max(4.8 * variance.sqrt()) {
            return None;
        }
        let longest = 16_700_000;
        let newest = self.recent.iter().rev();
        let window = newest.clone().take_while(|p| p.0.saturating_add(longest) >= time).count().max(3);
        let (speed, variance) = slope(self.recent.range(self.recent.len().saturating_sub(window)..))?;
        let limit = (self.settings.saccade_speed * self.settings.radius).max(2.0 * (self.noise * variance).sqrt());
        if speed[0].hypot(speed[1]) <= limit {
            return None;
        }
        // The start comes from the filter before all of this.
        let start = time.saturating_sub(25_000_000);
        let calm = self.calm(start)?;
        let from = calm.at(start.max(calm.time_ns), self.noise);
        let mut points = self.empty_room();
        points.extend(self.recent.iter().copied().filter(|p| p.0.saturating_add(48_000_000) >= time));
        Some(Jump::new(from, time, points, self.noise, &self.settings))
    }

    /// Returns the newest filter without measurements after `time`, or the oldest.
    fn calm(&self, time: u64) -> Option<&OneEuro> {
        self.filters.iter().rev().find(|f| f.time_ns <= time).or(self.filters.front())
    }

    fn empty_room(&mut self) -> VecDeque<Point> {
        self.room.clear();
        std::mem::take(&mut self.room)
    }

    /// The filter after a saccade, from the measurements since the eye came to rest.
    fn landed(&self, jump: &Jump, time: u64) -> OneEuro {
        let since = jump.flight.lands_ns.saturating_add(2_000_000).max(time.saturating_sub(24_000_000)).min(time);
        mean(jump.since(since)).map_or_else(
            || self.one_euro(time, jump.flight.landing, 1),
            |(position, n)| self.one_euro(time, position, n),
        )
    }

    /// The filter after a loss. An eye that has not moved continues from its held position, so that nothing steps.
    fn again(&self, held: [f64; 2], spread: f64, time: u64, points: &[Point]) -> OneEuro {
        let Some((position, n)) = mean(points.iter()) else { return self.one_euro(time, held, 1) };
        let off = (position[0] - held[0]).hypot(position[1] - held[1]);
        let noise = (self.noise / f64::from(n)).sqrt();
        if off > (4.0 * spread.hypot(noise)).max(0.5e-3) {
            return self.one_euro(time, position, n);
        }
        let mut filter = self.one_euro(time, held, 8);
        // The remaining glide is uncertainty, and fades as the glide does.
        filter.gain = filter.gain.max((off * off + spread * spread) / (2.0 * self.noise));
        filter
    }

    fn unseen(&mut self) {
        let noise = self.noise;
        self.state = match std::mem::replace(&mut self.state, State::Unseen) {
            State::Steady(filter) => {
                // Measurements during the closing of the lid are ignored.
                let before = self.last_ns.saturating_sub(LID_NS);
                let calm = self.calm(before).copied().unwrap_or(filter);
                let held = calm.at(calm.time_ns, noise);
                let spread = self.steady_spread(&calm, 0.05);
                State::Lost { held, spread, since_ns: self.last_ns }
            }
            State::Jumping(jump) => {
                // A closing lid looks like a small saccade.
                let held = if jump.flight.size() > 1e-3 { jump.flight.landing } else { jump.flight.from };
                let spread = jump.flight.spread.max(jump.flight.size() / 4.0);
                self.room = jump.into_room();
                State::Lost { held, spread, since_ns: self.last_ns }
            }
            State::Returning { held, spread, since_ns, points, .. } => {
                self.room = points;
                State::Lost { held, spread, since_ns }
            }
            other => other,
        };
        if matches!(self.state, State::Lost { .. }) {
            self.forget();
        }
    }

    /// Drops the measurements from before a loss.
    fn forget(&mut self) {
        self.recent.clear();
        self.filters.clear();
        self.course.clear();
        self.told = None;
    }

    /// The velocity of the eye while it rests or follows something. It is the tracker's own value if it reports one,
    /// otherwise the slope of half a second of samples.
    pub fn velocity(&self) -> EyeVelocity {
        let State::Steady(filter) = &self.state else { return EyeVelocity::default() };
        let radius = self.settings.radius;
        if let Some(velocity) = self.told {
            let spread = (self.told_noise.sqrt() / radius).hypot(DRIFT);
            return EyeVelocity { pupil: velocity, turning: Some((velocity.map(|v| v / radius), spread)) };
        }
        let turning = match slope(self.course.iter()) {
            Some((speed, variance)) if self.course.len() >= FEWEST => {
                let spread = (self.noise * variance).sqrt() / radius;
                Some((speed.map(|v| v / radius), spread.hypot(DRIFT)))
            }
            _ => None,
        };
        EyeVelocity { pupil: filter.calm_velocity(self.noise), turning }
    }

    fn steady_spread(&self, filter: &OneEuro, horizon: f64) -> f64 {
        let ahead = horizon + filter.lag;
        let still = self.noise * (filter.gain + ahead * ahead * filter.velocity_gain);
        let pushed = ACCELERATION * horizon * (horizon / 2.0 + 0.05);
        (still + pushed * pushed + TREMBLE * TREMBLE + self.bias * self.bias).sqrt()
    }

    /// The distribution of the pupil at a time, usually the time when the next light is seen.
    pub fn predict(&self, light_ns: u64) -> PupilDistribution {
        let s = &self.settings;
        let seconds = |from: u64| light_ns.saturating_sub(from) as f64 * 1e-9;
        let age = seconds(self.last_ns);
        let jumps_within = |t: f64| 1.0 - (-s.saccades * t).exp();
        let widened = |spread: f64, age: f64| {
            let more = (age - s.hold).max(0.0) * s.widen;
            spread.hypot(more).min(s.widest.max(spread))
        };
        let (centre, spread, elsewhere) = match &self.state {
            State::Unseen => ([0.0; 2], s.unknown, 1.0),
            State::Steady(filter) => {
                let horizon = age.min(FARTHEST);
                let velocity = filter.calm_velocity(self.noise);
                let centre = [0, 1].map(|i| filter.position[i] + velocity[i] * (horizon + filter.lag));
                (centre, widened(self.steady_spread(filter, horizon), age), jumps_within(age + NOTICED))
            }
            State::Jumping(jump) => {
                let early = (jump.flight.lands_ns as f64 - light_ns as f64) / jump.flight.lands_spread_ns;
                // The logistic curve is close to the integral of the normal distribution.
                let flying = 1.0 / (1.0 + (-1.702 * early).exp());
                let after = jumps_within(seconds(jump.flight.lands_ns));
                (
                    jump.flight.landing,
                    widened(jump.flight.spread.hypot(self.bias), age),
                    flying + (1.0 - flying) * after,
                )
            }
            State::Lost { held, spread, since_ns } | State::Returning { held, spread, since_ns, .. } => {
                let age = seconds(*since_ns);
                (*held, widened(*spread, age), jumps_within(age + NOTICED))
            }
        };
        let reach = |v: f64| v.clamp(-s.reach, s.reach);
        let diameter = self.diameter.map_or(s.diameter, |(mean, square)| {
            let off = 2.0 * square.sqrt() + 0.05 * mean;
            [(mean - off).max(0.5e-3), mean + off]
        });
        let focus = self.focus.zip(s.eyepiece).map_or(s.focus, |((mean, square), eyepiece)| {
            let off = 2.0 * square.sqrt();
            let [low, high] = eyepiece.depths;
            [mean - off, mean + off].map(|d| depth_of_dioptres(d, eyepiece.focal_length).clamp(low, high))
        });
        let elsewhere = elsewhere.clamp(0.0, 1.0);
        PupilDistribution { centre: centre.map(reach), spread, diameter, focus, elsewhere }
    }
}

/// Removes the oldest values until at most `most` are left and `kept` is true for the oldest.
fn keep_newest<T>(queue: &mut VecDeque<T>, most: usize, kept: impl Fn(&T) -> bool) {
    while queue.len() > most || queue.front().is_some_and(|oldest| !kept(oldest)) {
        queue.pop_front();
    }
}

/// Mean and variance over about ten values, after one more value.
fn averaged(before: Option<(f64, f64)>, value: f64) -> (f64, f64) {
    let (mean, square) = before.unwrap_or((value, 0.0));
    let off = value - mean;
    (mean + 0.1 * off, square + 0.1 * (off * off - square))
}

fn mean<'a>(points: impl Iterator<Item = &'a Point>) -> Option<([f64; 2], u32)> {
    let (mut sum, mut n) = ([0.0; 2], 0u32);
    for (_, p) in points {
        sum = [sum[0] + p[0], sum[1] + p[1]];
        n += 1;
    }
    (n > 0).then(|| (sum.map(|v| v / f64::from(n)), n))
}
