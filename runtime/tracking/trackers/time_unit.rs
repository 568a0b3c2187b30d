//! The unit that a foreign clock counts in, by its rate, and the timeline of a recording.

use serde::{Deserialize, Serialize};

/// A unit of time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub enum TimeUnit {
    /// Seconds.
    #[serde(rename = "s")]
    Seconds,
    /// Milliseconds.
    #[serde(rename = "ms")]
    Milliseconds,
    /// Microseconds.
    #[serde(rename = "us")]
    Microseconds,
    /// Nanoseconds.
    #[serde(rename = "ns")]
    Nanoseconds,
}

impl TimeUnit {
    /// All of them, each 1000 times as long as the next.
    pub const ALL: [Self; 4] = [Self::Seconds, Self::Milliseconds, Self::Microseconds, Self::Nanoseconds];

    /// How many of this unit make a second.
    pub fn per_second(self) -> i128 {
        1000i128.pow(self as u32)
    }
}

impl std::fmt::Display for TimeUnit {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(["seconds", "milliseconds", "microseconds", "nanoseconds"][*self as usize])
    }
}

/// The clock and the arrivals are compared over this time, first and later.
const FIRST_NS: u64 = 100_000_000;
const LATER_NS: u64 = 1_000_000_000;
/// The rate agrees with a unit within this factor, first and later: the first arrivals may be 50 ms late.
const FIRST_FACTOR: f64 = 4.0;
const LATER_FACTOR: f64 = 1.5;
/// Comparisons in a row that disagree before the unit is given up.
const AGAINST: u32 = 3;

/// What a comparison of clock and arrivals shows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Evidence {
    /// The clock counts in this unit; whether that was another before, and whether it is the one that was expected.
    Unit { unit: TimeUnit, changed: bool, expected: bool },
    /// The clock counts in no unit of time, but this much per second.
    None(f64),
}

/// Finds the unit of a clock by its rate against the arrivals.
#[derive(Debug, Clone)]
pub(super) struct UnitFinder {
    unit: TimeUnit,
    stated: bool,
    /// Whether the rate was compared and agreed, or the unit is stated.
    certain: bool,
    /// Where the comparison began: clock, arrival.
    begun: Option<(i128, u64)>,
    against: u32,
    hopeless: bool,
}

impl UnitFinder {
    pub(super) fn new() -> Self {
        let (unit, begun) = (TimeUnit::Seconds, None);
        Self { unit, stated: false, certain: false, begun, against: 0, hopeless: false }
    }

    pub(super) fn stated(unit: TimeUnit) -> Self {
        Self { unit, stated: true, certain: true, ..Self::new() }
    }

    /// Uses a stated unit: whether it is news.
    pub(super) fn state(&mut self, unit: TimeUnit) -> bool {
        let news = !self.stated || self.unit != unit;
        if news {
            *self = Self::stated(unit);
        }
        news
    }

    /// A time, nanoseconds if the clock counted seconds, in true nanoseconds.
    pub(super) fn scaled(&self, expected_ns: i128) -> i128 {
        let by = self.unit.per_second();
        (expected_ns + by.signum() * (by / 2) * expected_ns.signum()) / by
    }

    /// Whether times may be used.
    pub(super) fn is_certain(&self) -> bool {
        self.certain && !self.hopeless
    }

    /// Takes a time, nanoseconds if the clock counted seconds, and its arrival.
    pub(super) fn observe(&mut self, expected_ns: i128, received_ns: u64) -> Option<Evidence> {
        let (began, since) = *self.begun.get_or_insert((expected_ns, received_ns));
        let (counted, passed) = (expected_ns - began, received_ns.saturating_sub(since));
        if counted < 0 || received_ns < since {
            // The clock was set: the comparison begins again.
            self.begun = Some((expected_ns, received_ns));
            return None;
        }
        let (long, factor) = if self.certain { (LATER_NS, LATER_FACTOR) } else { (FIRST_NS, FIRST_FACTOR) };
        if passed < long || counted == 0 {
            return None;
        }
        self.begun = Some((expected_ns, received_ns));
        let rate = counted as f64 / passed as f64;
        let off = |unit: &TimeUnit| (rate / unit.per_second() as f64).ln().abs();
        let agrees = |unit: &TimeUnit| off(unit) <= factor.ln();
        let found = if self.stated { Some(self.unit) } else { TimeUnit::ALL.into_iter().find(agrees) };
        match found.filter(agrees) {
            Some(unit) if !self.certain || self.hopeless || unit == self.unit => {
                self.against = 0;
                let changed = unit != self.unit;
                let news = !std::mem::replace(&mut self.certain, true);
                (self.unit, self.hopeless) = (unit, false);
                (news || changed).then_some(Evidence::Unit { unit, changed, expected: unit == TimeUnit::Seconds })
            }
            other => {
                self.against += 1;
                if self.against < AGAINST {
                    return None;
                }
                self.against = 0;
                if let Some(unit) = other {
                    (self.unit, self.hopeless) = (unit, false);
                    return Some(Evidence::Unit { unit, changed: true, expected: unit == TimeUnit::Seconds });
                }
                let news = !std::mem::replace(&mut self.hopeless, true);
                news.then_some(Evidence::None(rate))
            }
        }
    }
}

/// Steps of a clock between samples of 3 Hz to 3 kHz are one unit's and no other's, in it.
const STEPS_S: [f64; 2] = [1.0 / 3000.0, 1.0 / 3.0];
/// With fewer steps, times are the documented seconds unless they cannot be.
const FEW_STEPS: usize = 8;
/// Steps of so many milliseconds are of a tracker of 700 Hz to 3 kHz, or, as seconds, of a slow one.
const AMBIGUOUS: [f64; 2] = [1.0 / 3.0, 1.5];

/// The unit of times that nobody states, by the step that is usual from one to the next.
///
/// # Errors
/// The usual step, where several units or none make a plausible tracker of it.
pub(super) fn unit_of_steps(times: &[f64]) -> Result<TimeUnit, f64> {
    let Some((usual, count)) = usual_step(times) else { return Ok(TimeUnit::Seconds) };
    if count < FEW_STEPS && usual <= 1.0 {
        return Ok(TimeUnit::Seconds);
    }
    if (AMBIGUOUS[0]..=AMBIGUOUS[1]).contains(&usual) {
        return Err(usual);
    }
    let plausible = |unit: &TimeUnit| {
        let seconds = usual / unit.per_second() as f64;
        (STEPS_S[0]..STEPS_S[1]).contains(&seconds)
    };
    TimeUnit::ALL.into_iter().find(plausible).ok_or(usual)
}

/// The median of the steps forward, and how many there are.
fn usual_step(times: &[f64]) -> Option<(f64, usize)> {
    let mut steps: Vec<f64> = times.windows(2).map(|t| t[1] - t[0]).filter(|step| *step > 0.0).collect();
    steps.sort_by(f64::total_cmp);
    Some((*steps.get(steps.len() / 2)?, steps.len()))
}

/// A step back beyond this is a clock that was set, and no sample out of order; a step forward beyond that, too.
const SET_BACK_NS: i128 = 250_000_000;
const SET_FORWARD_NS: i128 = 600_000_000_000;

/// One timeline of recorded times (nanoseconds), from 0 on, and how often the clock was set. It goes on by the usual step
/// where the clock was set.
pub(super) fn timeline(times: &[i128]) -> (Vec<u64>, u64) {
    let seconds: Vec<f64> = times.iter().map(|t| (t - times[0]) as f64 * 1e-9).collect();
    let usual_ns = usual_step(&seconds).map_or(0, |(step, _)| (step * 1e9).round() as i128).min(SET_FORWARD_NS);
    let (mut at, mut sets, mut all) = (0i128, 0, Vec::with_capacity(times.len()));
    for (i, time) in times.iter().enumerate() {
        let step = i.checked_sub(1).map_or(0, |before| time - times[before]);
        let is_set = !(-SET_BACK_NS..=SET_FORWARD_NS).contains(&step);
        sets += u64::from(is_set);
        at += if is_set { usual_ns } else { step };
        all.push(at);
    }
    let first = all.iter().copied().min().unwrap_or(0);
    (all.into_iter().map(|at| u64::try_from(at - first).unwrap_or(u64::MAX)).collect(), sets)
}
