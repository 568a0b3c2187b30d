//! Maps the clock of a tracker to the steady clock, for any origin, sign and unit.
//!
//! Offset and drift come from arrivals.

use super::time_unit::{Evidence, TimeUnit, UnitFinder};
use std::collections::VecDeque;

/// Number of slices of time whose quickest arrivals are kept. They cover 16 s, in which a drift of 50 ppm makes 0.8 ms.
const SLICES: usize = 32;
const SLICE_NS: u64 = 500_000_000;
/// A shorter span of slices, nanoseconds, shows more jitter than drift.
const SHORTEST_DRIFT_NS: f64 = 6e9;
/// Quartz clocks drift by 100 ppm at most. A steeper slope is a change of the delay.
const MOST_DRIFT: f64 = 3e-4;
/// A difference this far from the line is another setting of the clock, or a delay.
const STEP_NS: i128 = 250_000_000;
/// An arrival that is later than this is not a delay any more.
const MOST_DELAY_NS: i128 = 5_000_000_000;
/// A new setting is certain after this time and number of samples.
const CERTAIN_NS: u64 = 100_000_000;
const CERTAIN_SAMPLES: u32 = 3;
/// A clock that shows one time for this long is not running.
const STANDS_NS: u64 = 100_000_000;

/// A tracker time in both clocks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Stamp {
    /// The tracker's own time, nanoseconds from an origin of its own.
    pub tracker_ns: i64,
    /// Time on the steady clock, nanoseconds. It is at most the arrival.
    pub time_ns: u64,
}

/// A change of the clock that may interest the user.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ClockEvent {
    /// The clock does not count in the expected unit, but in this one.
    Unit(TimeUnit),
    /// The clock was set by this much, nanoseconds.
    Set(i128),
    /// The clock always shows one time, so arrivals are used instead.
    Stands,
    /// The rate of the clock fits no unit of time. It counts this much per second, in the expected unit.
    NoUnit(f64),
}

impl std::fmt::Display for ClockEvent {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Unit(unit) => write!(f, "its clock counts {unit}"),
            Self::Set(by) => write!(f, "its clock was set by {:.3} s", *by as f64 * 1e-9),
            Self::Stands => f.write_str("its clock does not advance, so arrival times are used"),
            Self::NoUnit(rate) => {
                write!(f, "its clock counts {rate:.4} per second, not a unit of time, so arrival times are used")
            }
        }
    }
}

/// Maps the clock of a tracker to the steady clock.
///
/// Only differences of the tracker's times mean something. A sample never arrives before it was taken, and some are
/// hardly delayed. The points (tracker time, arrival - tracker time) of the last 16 seconds therefore have a line below
/// them. This line is offset and drift of the clock plus the least delay. The resulting times are free of the jitter of
/// USB, network and scheduler. The least delay cannot be measured this way, so it is the latency setting.
#[derive(Debug, Clone)]
pub struct ForeignClock {
    unit: UnitFinder,
    line: Option<Line>,
    /// Another setting of the clock, until it is certain.
    candidate: Option<Line>,
    /// True if the candidate's first sample had a time before the sample before it.
    ran_back: bool,
    /// The newest tracker time, its first arrival, and its mapped time.
    last: Option<(i128, [u64; 2])>,
    stands: bool,
    /// Number of times that the clock was set.
    pub sets: u64,
    events: VecDeque<ClockEvent>,
}

impl ForeignClock {
    /// A clock whose unit is found from its rate. Seconds are expected.
    pub fn new() -> Self {
        Self::with(UnitFinder::new())
    }

    /// A clock with a given unit.
    pub fn of(unit: TimeUnit) -> Self {
        Self::with(UnitFinder::stated(unit))
    }

    fn with(unit: UnitFinder) -> Self {
        let (line, candidate, last, events) = (None, None, None, VecDeque::new());
        Self { unit, line, candidate, ran_back: false, last, stands: false, sets: 0, events }
    }

    /// Uses this unit from now on.
    pub fn state(&mut self, unit: TimeUnit) {
        if self.unit.state(unit) {
            (self.line, self.candidate, self.last) = (None, None, None);
        }
    }

    /// Returns and removes the next change.
    pub fn event(&mut self) -> Option<ClockEvent> {
        self.events.pop_front()
    }

    /// Places a sample that arrived at `received_ns`. `expected_ns` is its tracker time, nanoseconds in the expected
    /// unit.
    pub fn place(&mut self, expected_ns: i128, received_ns: u64) -> Stamp {
        match self.unit.observe(expected_ns, received_ns) {
            Some(Evidence::Unit { unit, changed, expected }) => {
                if changed {
                    (self.line, self.candidate, self.last) = (None, None, None);
                }
                if !expected {
                    self.say(ClockEvent::Unit(unit));
                }
            }
            Some(Evidence::None(rate)) => {
                // A clock that runs at another rate than expected looks as if it were set again and again.
                self.events.retain(|event| !matches!(event, ClockEvent::Set(_)));
                self.sets = 0;
                self.say(ClockEvent::NoUnit(rate));
            }
            None => {}
        }
        let tracker = self.unit.scaled(expected_ns);
        let mapped = self.map(tracker, received_ns).min(received_ns);
        if let Some((_, [_, placed])) = &mut self.last {
            *placed = mapped;
        }
        let time_ns = if self.unit.is_certain() && !self.stands { mapped } else { received_ns };
        let tracker_ns = tracker.clamp(i128::from(i64::MIN), i128::from(i64::MAX)) as i64;
        Stamp { tracker_ns, time_ns }
    }

    fn say(&mut self, event: ClockEvent) {
        if self.events.len() < 8 {
            self.events.push_back(event);
        }
    }

    fn map(&mut self, x: i128, received_ns: u64) -> u64 {
        let before = self.last;
        match before {
            Some((last, [since, placed])) if last == x => {
                if received_ns.saturating_sub(since) >= STANDS_NS && !self.stands {
                    self.stands = true;
                    self.say(ClockEvent::Stands);
                }
                return placed;
            }
            _ => (self.last, self.stands) = (Some((x, [received_ns; 2])), false),
        }
        let y = i128::from(received_ns) - x;
        let Some(line) = &mut self.line else {
            let line = self.line.insert(Line::new(x, y, received_ns));
            return line.time(x, received_ns);
        };
        let off = y - line.at(x);
        if off.abs() <= STEP_NS {
            self.candidate = None;
            line.add(x, y, received_ns);
            return line.time(x, received_ns);
        }
        match &mut self.candidate {
            Some(candidate) if (y - candidate.at(x)).abs() <= STEP_NS => candidate.add(x, y, received_ns),
            candidate => {
                *candidate = Some(Line::new(x, y, received_ns));
                self.ran_back = before.is_some_and(|(last, _)| x < last);
            }
        }
        if let Some(candidate) = self.candidate.take_if(|candidate| candidate.is_certain()) {
            let by = line.at(x) - candidate.at(x);
            *line = candidate;
            let time = line.time(x, received_ns);
            self.sets += 1;
            self.say(ClockEvent::Set(by));
            return time;
        }
        // The time of a sample that was held up on its way is correct. A clock that runs back or arrives early was set.
        let delayed = !self.ran_back && (0..=MOST_DELAY_NS).contains(&off);
        let line = if delayed { self.line.as_ref() } else { self.candidate.as_ref() };
        line.map_or(received_ns, |line| line.time(x, received_ns))
    }
}

/// A line below the differences (arrival - tracker time) of one setting of a clock.
#[derive(Debug, Clone)]
struct Line {
    /// Tracker time and difference of the first sample, nanoseconds. Points are relative to these.
    origin: [i128; 2],
    /// For each slice of time, its number and the point of its quickest arrival.
    slices: VecDeque<(u64, [f64; 2])>,
    slope: f64,
    through: [f64; 2],
    begun_ns: u64,
    newest_ns: u64,
    samples: u32,
}

impl Line {
    fn new(x: i128, y: i128, received_ns: u64) -> Self {
        let slices = VecDeque::from([(received_ns / SLICE_NS, [0.0; 2])]);
        let (slope, through, begun_ns) = (0.0, [0.0; 2], received_ns);
        Self { origin: [x, y], slices, slope, through, begun_ns, newest_ns: received_ns, samples: 1 }
    }

    fn relative(&self, x: i128) -> f64 {
        (x - self.origin[0]) as f64
    }

    /// The difference of this line at a tracker time.
    fn at(&self, x: i128) -> i128 {
        self.origin[1] + (self.through[1] + self.slope * (self.relative(x) - self.through[0])).round() as i128
    }

    /// A tracker time on the steady clock, at most the arrival.
    fn time(&self, x: i128, received_ns: u64) -> u64 {
        u64::try_from((x + self.at(x)).max(0)).unwrap_or(u64::MAX).min(received_ns)
    }

    fn is_certain(&self) -> bool {
        self.samples >= CERTAIN_SAMPLES && self.newest_ns.saturating_sub(self.begun_ns) >= CERTAIN_NS
    }

    fn add(&mut self, x: i128, y: i128, received_ns: u64) {
        self.samples = self.samples.saturating_add(1);
        self.newest_ns = self.newest_ns.max(received_ns);
        let (slice, slope) = (received_ns / SLICE_NS, self.slope);
        let point = [self.relative(x), (y - self.origin[1]) as f64];
        let above = move |[x, y]: [f64; 2]| y - slope * x;
        match self.slices.back_mut() {
            Some((last, quickest)) if *last >= slice => {
                if above(point) >= above(*quickest) {
                    return;
                }
                *quickest = point;
            }
            _ => self.slices.push_back((slice, point)),
        }
        while self.slices.len() > SLICES || self.slices.front().is_some_and(|s| s.0 + SLICES as u64 <= slice) {
            self.slices.pop_front();
        }
        self.fit();
    }

    /// Fits the line below all points that is highest in their middle.
    fn fit(&mut self) {
        let points = || self.slices.iter().map(|s| s.1);
        let (Some(first), Some(last)) = (points().next(), points().next_back()) else { return };
        let (mut slope, mut lowest) = (0.0, f64::INFINITY);
        if last[0] - first[0] >= SHORTEST_DRIFT_NS {
            let middle = f64::midpoint(first[0], last[0]);
            for a in points().filter(|p| p[0] <= middle) {
                for b in points().filter(|p| p[0] > middle) {
                    let steep = (b[1] - a[1]) / (b[0] - a[0]);
                    let there = a[1] + steep * (middle - a[0]);
                    if there < lowest {
                        (lowest, slope) = (there, steep);
                    }
                }
            }
        }
        let slope = if slope.abs() <= MOST_DRIFT { slope } else { 0.0 };
        let above = |p: &[f64; 2]| p[1] - slope * p[0];
        self.through = points().min_by(|a, b| above(a).total_cmp(&above(b))).unwrap_or_default();
        self.slope = slope;
    }
}

/// Extends a counter that may be narrow and wrap around.
#[derive(Debug, Clone, Default)]
pub struct Unwrap {
    last: Option<u64>,
    turns: u64,
}

impl Unwrap {
    /// The count without wrap-around, for a counter of `bits` bits. A step back by less than half the range is a real
    /// step back, because the clock was set or a report came late.
    pub fn count(&mut self, value: u64, bits: u32) -> u64 {
        if bits >= 64 {
            return value;
        }
        let range = 1u64 << bits;
        if let Some(last) = self.last
            && value < last
            && last - value > range / 2
        {
            self.turns += 1;
        }
        self.last = Some(value);
        self.turns.saturating_mul(range).saturating_add(value)
    }
}

#[cfg(test)]
mod tests;
