//! Finds the unit of a foreign clock by its rate, and the timeline of a recording.

use serde::{Deserialize, Serialize};

/// A unit of time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub enum TimeUnit {
    /// Unit `s`, which is a second.
    #[serde(rename = "s")]
    Seconds,
    /// Unit `ms`, a thousandth of a second.
    #[serde(rename = "ms")]
    Milliseconds,
    /// Unit `us`, a millionth of a second.
    #[serde(rename = "us")]
    Microseconds,
    /// Unit `ns`, a billionth of a second.
    #[serde(rename = "ns")]
    Nanoseconds,
}

impl TimeUnit {
    /// All units, each 1000 times as long as the next.
    pub const ALL: [Self; 4] = [Self::Seconds, Self::Milliseconds, Self::Microseconds, Self::Nanoseconds];

    /// Number of these units per second.
    pub fn per_second(self) -> i128 {
        1000i128.pow(self as u32)
    }
}

impl std::fmt::Display for TimeUnit {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(["seconds", "milliseconds", "microseconds", "nanoseconds"][*self as usize])
    }
}

/// The clock and the arrivals are compared over this time, at first and later.
const FIRST_NS: u64 = 100_000_000;
const LATER_NS: u64 = 1_000_000_000;
/// The rate must agree with a unit within this factor, at first and later. The first arrivals may be 50 ms late.
const FIRST_FACTOR: f64 = 4.0;
const LATER_FACTOR: f64 = 1.5;
/// Number of consecutive disagreements after which the unit is dropped.
const AGAINST: u32 = 3;

/// The result of a comparison of clock and arrivals.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Evidence {
    /// The clock counts in this unit. `changed` is true if it was another unit before, and `expected` if it is the
    /// expected one.
    Unit { unit: TimeUnit, changed: bool, expected: bool },
    /// The clock counts in no unit of time, but advances this much per second.
    None(f64),
}

/// Finds the unit of a clock by its rate against the arrivals.
#[derive(Debug, Clone)]
pub(super) struct UnitFinder {
    unit: TimeUnit,
    stated: bool,
    /// True if the rate was compared and agreed, or the unit is stated.
    certain: bool,
    /// Start of the comparison, as clock and arrival.
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

    /// Uses a stated unit. Returns true if it differs from before.
    pub(super) fn state(&mut self, unit: TimeUnit) -> bool {
        let news = !self.stated || self.unit != unit;
        if news {
            *self = Self::stated(unit);
        }
        news
    }

    /// Converts a time to true nanoseconds. `expected_ns` is in nanoseconds if the clock counts seconds.
    pub(super) fn scaled(&self, expected_ns: i128) -> i128 {
        let by = self.unit.per_second();
        (expected_ns + by.signum() * (by / 2) * expected_ns.signum()) / by
    }

    /// True if times may be used.
    pub(super) fn is_certain(&self) -> bool {
        self.certain && !self.hopeless
    }

    /// Adds a time and its arrival. `expected_ns` is in nanoseconds if the clock counts seconds.
    pub(super) fn observe(&mut self, expected_ns: i128, received_ns: u64) -> Option<Evidence> {
        let (began, since) = *self.begun.get_or_insert((expected_ns, received_ns));
        let (counted, passed) = (expected_ns - began, received_ns.saturating_sub(since));
        if counted < 0 || received_ns < since {
            // The clock was set, so the comparison starts again.
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

/// Seconds between samples of 3 kHz and of 3 Hz. Steps in this range fit one unit only.
const STEPS_S: [f64; 2] = [1.0 / 3000.0, 1.0 / 3.0];
/// With fewer steps, times are the documented seconds unless that is impossible.
const FEW_STEPS: usize = 8;
/// In this range, milliseconds per step fit a tracker of 700 Hz to 3 kHz, and seconds per step fit a slow one.
const AMBIGUOUS: [f64; 2] = [1.0 / 3.0, 1.5];

/// The unit of times that nobody states, by the usual step between them.
///
/// # Errors
/// The usual step, if no unit or several units give a plausible tracker.
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

/// The median of the steps forward, and their number.
fn usual_step(times: &[f64]) -> Option<(f64, usize)> {
    let mut steps: Vec<f64> = times.windows(2).map(|t| t[1] - t[0]).filter(|step| *step > 0.0).collect();
    steps.sort_by(f64::total_cmp);
    Some((*steps.get(steps.len() / 2)?, steps.len()))
}

/// A step back beyond this is a clock that was set, not a sample out of order. A step forward beyond `SET_FORWARD_NS`
/// is one, too.
const SET_BACK_NS: i128 = 250_000_000;
const SET_FORWARD_NS: i128 = 600_000_000_000;

/// The timeline of recorded times (nanoseconds) from 0 on, and the number of changes of the clock. It advances by the
/// usual step at each change.
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
