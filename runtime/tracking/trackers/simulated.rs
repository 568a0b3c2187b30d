//! Simulates an eye and its tracker for development and tests, with a known truth at every time.
//!
//! The eye fixates, drifts and trembles. It jumps by saccades whose duration follows the main sequence (Carpenter 1988:
//! 21 ms + 2.2 ms per degree) with some scatter and a speed that peaks early. It follows smoothly, blinks, and changes
//! the size of its pupil. The tracker samples it at a rate, with noise and delay. The tracker loses it while the lid is
//! down, and is wrong while the lid moves. One seed gives one eye. The numbers come from `fastrand`, because another
//! generator would give each seed another eye.

use super::source::{end_of, wait_for};
use super::{About, Event, Quantity, Reading, Sample, Source, TrackerError, Unit, now_ns};
use crate::gaze::saccade::{duration, progress};
use eyebox_base::reason;
use fastrand::Rng;
use std::collections::VecDeque;
use std::f64::consts::TAU;
use std::time::Duration;

/// The behavior of the eye and the errors of its tracker.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// Seed of the eye and of the noise.
    pub seed: u64,
    /// Rate of the tracker, samples per second.
    pub rate_hz: f64,
    /// Delay between the eye and the arrival of its sample, seconds.
    pub delay: f64,
    /// Variation of the delay, seconds.
    pub jitter: f64,
    /// Standard deviation of each measured coordinate, meters.
    pub noise: f64,
    /// Shortest and longest duration of a fixation, seconds.
    pub fixation: [f64; 2],
    /// Share of fixations that become a pursuit.
    pub pursuit: f64,
    /// Rate of blinks, per minute.
    pub blinks: f64,
    /// Shortest and longest time for which the lid is down, seconds.
    pub blink: [f64; 2],
    /// Largest direction of the eye to the side and up, radians.
    pub field: [f64; 2],
    /// Distance from the center of rotation to the pupil, meters.
    pub radius: f64,
    /// Distance of the two eyes, meters. With 0, both are one eye.
    pub ipd: f64,
    /// Smallest and largest focus of fixations, dioptres. Both eyes turn towards it.
    pub focus: [f64; 2],
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            seed: 0,
            rate_hz: 120.0,
            delay: 8e-3,
            jitter: 1e-3,
            noise: 0.1e-3,
            fixation: [0.2, 0.8],
            pursuit: 0.3,
            blinks: 12.0,
            blink: [0.1, 0.3],
            field: [12f64.to_radians(), 8f64.to_radians()],
            radius: 11e-3,
            ipd: 0.0,
            focus: [0.0; 2],
        }
    }
}

/// The current movement of the eye.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum Doing {
    /// The eye rests, except for drift and tremor.
    Fixation,
    /// The eye follows something.
    Pursuit,
    /// The eye makes a saccade.
    Saccade {
        /// Start of the saccade, nanoseconds.
        began_ns: u64,
        /// End of the saccade, nanoseconds.
        lands_ns: u64,
        /// Place of its end, meters.
        landing: [f64; 2],
    },
}

/// The eye at one time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Truth {
    /// Center of the pupil in the pupil plane, meters.
    pub position: [f64; 2],
    /// Diameter of the pupil, meters.
    pub diameter: f64,
    /// Opening of the lid, 0 to 1.
    pub lid: f64,
    /// The current movement of the eye.
    pub doing: Doing,
    /// Focus of the eye, dioptres.
    pub dioptres: f64,
}

/// One of the two eyes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Side {
    /// The left eye, which turns to the right towards near objects.
    Left,
    /// The right eye, which turns to the left towards near objects.
    Right,
}

#[derive(Debug, Clone, Copy)]
enum Move {
    Rest,
    Follow,
    Jump { early: f64 },
}

/// A movement from one direction to another, radians.
#[derive(Debug, Clone, Copy)]
struct Segment {
    start_ns: u64,
    end_ns: u64,
    from: [f64; 2],
    to: [f64; 2],
    /// The focus at the start and at the end, dioptres.
    focus: [f64; 2],
    kind: Move,
}

/// Number of movements and blinks that are stored.
const REMEMBERED: usize = 64;
const LID_MOVES: f64 = 0.06;

/// A simulated eye. Times may run back a little (some ten seconds), to get the truth at an earlier time.
#[derive(Debug, Clone)]
pub struct Eye {
    settings: Settings,
    /// The eye whose position counts, or the middle between both.
    side: Option<Side>,
    rng: Rng,
    focus_rng: Rng,
    segments: VecDeque<Segment>,
    /// The times at which the lid begins to close and at which it is open again, nanoseconds.
    blinks: VecDeque<[u64; 2]>,
    blink_rng: Rng,
    /// Amplitude (radians), frequency (hertz) and phase of the waves of x and y.
    wander: [[[f64; 3]; 5]; 2],
    breath: [[f64; 3]; 3],
}

fn seconds(s: f64) -> u64 {
    (s * 1e9) as u64
}

impl Eye {
    /// An eye that rests in the middle at `start_ns`.
    pub fn new(settings: Settings, start_ns: u64) -> Self {
        let mut rng = Rng::with_seed(settings.seed);
        let blink_rng = Rng::with_seed(settings.seed ^ 0x6c69_6473);
        let focus_rng = Rng::with_seed(settings.seed ^ 0x6e65_6172);
        let mut wave = |amplitude: f64, hertz: f64| [amplitude, hertz * (0.8 + 0.4 * rng.f64()), TAU * rng.f64()];
        let arc_minute = (1.0f64 / 60.0).to_radians();
        // Drift of a few minutes of arc, and a tremor of a quarter of one near 85 Hz (Martinez-Conde et al. 2004).
        let wander = [(); 2].map(|()| {
            [
                wave(3.0 * arc_minute, 0.4),
                wave(2.0 * arc_minute, 1.0),
                wave(1.0 * arc_minute, 2.3),
                wave(0.2 * arc_minute, 80.0),
                wave(0.15 * arc_minute, 92.0),
            ]
        });
        let breath = [wave(0.35e-3, 0.11), wave(0.2e-3, 0.4), wave(0.08e-3, 1.3)];
        let rest = Segment {
            start_ns,
            end_ns: start_ns + seconds(settings.fixation[0].max(0.05)),
            from: [0.0; 2],
            to: [0.0; 2],
            focus: [settings.focus[0]; 2],
            kind: Move::Rest,
        };
        let mut segments = VecDeque::with_capacity(REMEMBERED + 1);
        segments.push_back(rest);
        let mut eye = Self {
            settings,
            side: None,
            rng,
            focus_rng,
            segments,
            blinks: VecDeque::with_capacity(REMEMBERED + 1),
            blink_rng,
            wander,
            breath,
        };
        eye.next_blink(start_ns);
        eye
    }

    /// The same eye as the left or the right one of two.
    #[must_use]
    pub fn of(self, side: Side) -> Self {
        Self { side: Some(side), ..self }
    }

    /// The eye at a time.
    pub fn at(&mut self, time_ns: u64) -> Truth {
        while self.segments.back().is_some_and(|s| s.end_ns <= time_ns) {
            self.next_segment();
        }
        while self.blinks.back().is_some_and(|b| b[1] <= time_ns) {
            let from = self.blinks.back().map_or(time_ns, |b| b[1]);
            self.next_blink(from);
        }
        let segment = self.segments.iter().rev().find(|s| s.start_ns <= time_ns).or(self.segments.front());
        let Some(segment) = segment.copied() else { unreachable!("there is always a segment") };
        let lasts = (segment.end_ns - segment.start_ns).max(1) as f64;
        let u = (time_ns.saturating_sub(segment.start_ns) as f64 / lasts).clamp(0.0, 1.0);
        let (share, doing) = match segment.kind {
            Move::Rest => (0.0, Doing::Fixation),
            Move::Follow => (u, Doing::Pursuit),
            Move::Jump { early } => {
                let landing = self.place(segment.to, segment.focus[1], segment.end_ns);
                (
                    progress(u.powf(early)),
                    Doing::Saccade { began_ns: segment.start_ns, lands_ns: segment.end_ns, landing },
                )
            }
        };
        let at = |i: usize| segment.from[i] + (segment.to[i] - segment.from[i]) * share;
        let dioptres = segment.focus[0] + (segment.focus[1] - segment.focus[0]) * share;
        let t = time_ns as f64 * 1e-9;
        let diameter = 4e-3 + waves(&self.breath, t);
        let lid = self.blinks.iter().map(|b| lid(*b, time_ns)).fold(1.0, f64::min);
        Truth { position: self.place([at(0), at(1)], dioptres, time_ns), diameter, lid, doing, dioptres }
    }

    /// The left or the right eye at a time.
    fn seen(&mut self, side: Side, time_ns: u64) -> Truth {
        self.side = Some(side);
        let truth = self.at(time_ns);
        self.side = None;
        truth
    }

    /// The place of a direction in the pupil plane, with drift and tremor.
    fn place(&self, direction: [f64; 2], dioptres: f64, time_ns: u64) -> [f64; 2] {
        let t = time_ns as f64 * 1e-9;
        let inwards = (0.5 * self.settings.ipd * dioptres).atan();
        let turned = match self.side {
            None => 0.0,
            Some(Side::Left) => inwards,
            Some(Side::Right) => -inwards,
        };
        let direction = [direction[0] + turned, direction[1]];
        [0, 1].map(|i| self.settings.radius * (direction[i] + waves(&self.wander[i], t)).sin())
    }

    fn between(&mut self, [low, high]: [f64; 2]) -> f64 {
        low + (high - low) * self.rng.f64()
    }

    fn next_segment(&mut self) {
        let Some(last) = self.segments.back().copied() else { return };
        let field = self.settings.field;
        let inside = |to: [f64; 2]| (0..2).all(|i| to[i].abs() <= field[i]);
        let (kind, to, lasts) = match last.kind {
            Move::Rest if self.rng.f64() < self.settings.pursuit => {
                // The pursuit has 3 to 15 degrees per second, for half a second to one and a half, turned inwards at
                // the edge.
                let (speed, angle) = (self.between([3.0, 15.0]).to_radians(), TAU * self.rng.f64());
                let mut lasts = self.between([0.5, 1.5]);
                let mut step = [angle.cos() * speed, angle.sin() * speed];
                let target = |step: [f64; 2], lasts: f64| [0, 1].map(|i| last.to[i] + step[i] * lasts);
                if !inside(target(step, lasts)) {
                    step = step.map(|s| -s);
                }
                while !inside(target(step, lasts)) && lasts > 0.05 {
                    lasts *= 0.7;
                }
                (Move::Follow, target(step, lasts), lasts)
            }
            Move::Rest | Move::Follow => {
                let mut to = last.to;
                for _ in 0..64 {
                    to = field.map(|f| f * (2.0 * self.rng.f64() - 1.0));
                    if (0.5..15.0).contains(&distance(last.to, to).to_degrees()) {
                        break;
                    }
                }
                let amplitude = distance(last.to, to).to_degrees();
                let scatter = self.between([0.88, 1.12]);
                let early = self.between([0.85, 1.0]);
                (Move::Jump { early }, to, duration(amplitude) * scatter)
            }
            Move::Jump { .. } => {
                let lasts = self.between(self.settings.fixation).max(0.05);
                (Move::Rest, last.to, lasts)
            }
        };
        let (start_ns, end_ns) = (last.end_ns, last.end_ns + seconds(lasts).max(1));
        let [near, far] = self.settings.focus;
        let focus = match kind {
            Move::Jump { .. } => near + (far - near) * self.focus_rng.f64(),
            Move::Rest | Move::Follow => last.focus[1],
        };
        self.segments.push_back(Segment { start_ns, end_ns, from: last.to, to, focus: [last.focus[1], focus], kind });
        if self.segments.len() > REMEMBERED {
            self.segments.pop_front();
        }
    }

    fn next_blink(&mut self, from_ns: u64) {
        let rng = &mut self.blink_rng;
        let wait = if self.settings.blinks > 0.0 { 60.0 / self.settings.blinks * (0.4 + 1.2 * rng.f64()) } else { 1e9 };
        let [short, long] = self.settings.blink;
        let down = short + (long - short) * rng.f64();
        let start = from_ns.saturating_add(seconds(wait));
        self.blinks.push_back([start, start.saturating_add(seconds(down + 2.0 * LID_MOVES))]);
        if self.blinks.len() > REMEMBERED {
            self.blinks.pop_front();
        }
    }
}

fn distance(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}

fn waves<const N: usize>(waves: &[[f64; 3]; N], t: f64) -> f64 {
    waves.iter().map(|[amplitude, hertz, phase]| amplitude * (TAU * hertz * t + phase).sin()).sum()
}

fn lid([close, open]: [u64; 2], time: u64) -> f64 {
    if time <= close || time >= open {
        return 1.0;
    }
    let edge = (time - close).min(open - time) as f64 * 1e-9;
    (1.0 - edge / LID_MOVES).max(0.0)
}

/// The simulated eye with its tracker.
#[derive(Debug)]
pub struct SimulatedSource {
    eye: Eye,
    settings: Settings,
    noise: Rng,
    start_ns: u64,
    count: u64,
    waiting: Option<Sample>,
    real_time: bool,
}

impl SimulatedSource {
    /// Starts now. In `real_time` samples arrive at their times, otherwise as fast as they are requested.
    ///
    /// # Errors
    /// [`TrackerError::Setting`] if a setting is out of its range.
    pub fn new(settings: Settings, real_time: bool) -> Result<Self, TrackerError> {
        Self::starting(settings, real_time, now_ns())
    }

    /// Starts like [`new`](Self::new), at a time of the caller's own clock.
    ///
    /// # Errors
    /// [`TrackerError::Setting`] if a setting is out of its range.
    pub fn starting(settings: Settings, real_time: bool, start_ns: u64) -> Result<Self, TrackerError> {
        let wrong = |text: &str| Err(TrackerError::Setting(reason!("simulated", "the simulated eye: {text}")));
        if !(1.0..=20_000.0).contains(&settings.rate_hz) {
            return wrong("the rate must be 1 to 20000 Hz");
        }
        let s = &settings;
        let lengths = [s.delay, s.jitter, s.noise, s.pursuit, s.blinks, s.radius, s.ipd, s.field[0], s.field[1]];
        if !lengths.into_iter().chain(s.fixation).chain(s.blink).chain(s.focus).all(|v| (0.0..1e4).contains(&v)) {
            return wrong("times, lengths and rates must be finite and not negative");
        }
        let noise = Rng::with_seed(settings.seed.wrapping_add(1));
        let eye = Eye::new(settings.clone(), start_ns);
        Ok(Self { eye, settings, noise, start_ns, count: 0, waiting: None, real_time })
    }

    /// The true eye at a time.
    pub fn truth(&mut self, time_ns: u64) -> Truth {
        self.eye.at(time_ns)
    }

    fn gauss(&mut self) -> f64 {
        let (u, v) = (1.0 - self.noise.f64(), self.noise.f64());
        (-2.0 * u.ln()).sqrt() * (TAU * v).cos()
    }

    fn sample(&mut self) -> Sample {
        let time_ns = self.start_ns + (self.count as f64 * 1e9 / self.settings.rate_hz) as u64;
        self.count += 1;
        let late = self.settings.delay + self.settings.jitter * self.noise.f64();
        let mut sample = Sample::empty(time_ns + seconds(late));
        sample.time_ns = time_ns;
        sample.tracker_ns = i64::try_from(time_ns - self.start_ns).ok();
        let eyes = [Side::Left, Side::Right].map(|side| self.eye.seen(side, time_ns));
        let mut eye = |truth: Truth| {
            // The visible part of a half-covered pupil has its center lower down.
            let covered = 1.0 - truth.lid;
            let position = [0, 1].map(|i| truth.position[i] + self.settings.noise * self.gauss());
            let mut reading =
                Reading::new(Quantity::Pupil, Unit::Metres, [position[0], position[1] + 0.6e-3 * covered]);
            reading.diameter = Some(truth.diameter * (1.0 + 0.01 * self.gauss()));
            reading.confidence = truth.lid;
            reading.valid = truth.lid > 0.3;
            Some(reading.checked())
        };
        (sample.left, sample.right) = (eye(eyes[0]), eye(eyes[1]));
        sample
    }
}

impl Source for SimulatedSource {
    fn about(&self) -> About {
        let s = &self.settings;
        let notes =
            vec![format!("noise {:.2} mm, delay {:.1} ms", s.noise * 1e3, s.delay * 1e3), format!("seed {}", s.seed)];
        About { name: "simulated eye".into(), kind: "simulated", rate_hz: Some(s.rate_hz), notes }
    }

    fn next(&mut self, timeout: Duration) -> Result<Event, TrackerError> {
        let sample = self.waiting.take().unwrap_or_else(|| self.sample());
        if self.real_time && !wait_for(sample.received_ns, end_of(timeout)) {
            self.waiting = Some(sample);
            return Ok(Event::Nothing);
        }
        Ok(Event::Sample(sample, None))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn saccades_follow_the_main_sequence_and_nothing_else_is_fast() {
        let mut eye = Eye::new(Settings { seed: 3, ..Settings::default() }, 0);
        let (mut jumps, mut last) = (std::collections::BTreeMap::new(), eye.at(0));
        for ms in 1..60_000u64 {
            let truth = eye.at(ms * 1_000_000);
            let speed = distance(truth.position, last.position) / 1e-3 / 11e-3;
            match truth.doing {
                Doing::Saccade { began_ns, lands_ns, landing } => {
                    let before = eye.at(began_ns).position;
                    let amplitude = (distance(before, landing) / 11e-3).to_degrees();
                    jumps.insert(began_ns, (amplitude, (lands_ns - began_ns) as f64 * 1e-6));
                }
                _ if !matches!(last.doing, Doing::Saccade { .. }) => {
                    assert!(speed.to_degrees() < 25.0, "{speed} rad/s at {ms} ms");
                }
                _ => {}
            }
            assert!((2e-3..8e-3).contains(&truth.diameter) && (0.0..=1.0).contains(&truth.lid));
            last = truth;
        }
        assert!(jumps.len() > 40, "{}", jumps.len());
        for (amplitude, lasts) in jumps.into_values() {
            assert!((lasts / (21.0 + 2.2 * amplitude) - 1.0).abs() < 0.16, "{amplitude} deg in {lasts} ms");
        }
    }

    #[test]
    fn one_seed_one_eye() {
        let run = |seed| {
            let settings = Settings { seed, ..Settings::default() };
            let mut source = SimulatedSource::starting(settings, false, 1_000).unwrap();
            (0..500).map(|_| source.next(Duration::ZERO).unwrap()).collect::<Vec<_>>()
        };
        assert_eq!(run(1), run(1));
        assert_ne!(run(1), run(2));
    }

    #[test]
    fn noise_delay_and_blinks_are_as_set() {
        let settings = Settings { blinks: 20.0, jitter: 0.0, pursuit: 0.0, rate_hz: 500.0, ..Settings::default() };
        let mut source = SimulatedSource::starting(settings, false, 0).unwrap();
        let (mut sum, mut seen, mut lost) = (0.0, 0u32, 0u32);
        for _ in 0..30_000 {
            let Event::Sample(sample, None) = source.next(Duration::ZERO).unwrap() else { panic!("a sample") };
            assert_eq!(sample.received_ns - sample.time_ns, 8_000_000);
            let truth = source.truth(sample.time_ns);
            let left = sample.left.unwrap();
            if truth.lid == 1.0 {
                sum += (left.position[0] - truth.position[0]).powi(2);
                seen += 1;
            }
            lost += u32::from(!left.valid);
        }
        let sd = (sum / f64::from(seen)).sqrt();
        assert!((sd / 0.1e-3 - 1.0).abs() < 0.05, "{sd}");
        assert!((0.03..0.2).contains(&(f64::from(lost) / 30_000.0)), "{lost}");
        assert!(SimulatedSource::new(Settings { rate_hz: 0.0, ..Settings::default() }, false).is_err());
        assert!(SimulatedSource::new(Settings { noise: f64::NAN, ..Settings::default() }, false).is_err());
    }
}
