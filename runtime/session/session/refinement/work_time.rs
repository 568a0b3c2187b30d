//! Measures the time that work takes on this machine, or simulates it from fixed costs.

use crate::present::RealClock;
use crate::session::refinement::set_timing::as_ns;
use std::time::{Duration, Instant};

/// The cost of work in a study, and in a session on a simulated clock.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Cost {
    /// The cost is measured on this machine.
    Measured,
    /// The cost is the same on every machine, so that one study gives one result.
    Fixed {
        /// The time of a step of one color.
        step: Duration,
        /// The time of the encoding of a set.
        encode: Duration,
    },
}

impl Cost {
    /// Returns the expected time of a step of each color (ns). `measured` returns the time on this machine.
    pub fn round_ns(self, colors: usize, measured: impl FnOnce() -> Duration) -> i64 {
        match self {
            Self::Measured => as_ns(measured()),
            Self::Fixed { step, .. } => as_ns(step).saturating_mul(colors as i64),
        }
    }
}

/// A time that advances by the cost of work (ns).
pub struct WorkTime {
    cost: Cost,
    began_ns: i64,
    begun: Instant,
    spent: Duration,
}

impl WorkTime {
    /// Starts at a time (ns).
    pub fn begin(cost: Cost, now_ns: i64) -> Self {
        Self { cost, began_ns: now_ns, begun: Instant::now(), spent: Duration::ZERO }
    }

    /// Returns the current time (ns).
    pub fn now_ns(&self) -> i64 {
        let spent = if self.cost == Cost::Measured { self.begun.elapsed() } else { self.spent };
        self.began_ns.saturating_add(as_ns(spent))
    }

    /// Returns true if this number of steps ends before the deadline, and then counts their time. `expected` is their
    /// total time if it is measured.
    pub fn steps_before(&mut self, deadline_ns: i64, steps: u32, expected: Duration) -> bool {
        let cost = match self.cost {
            Cost::Measured => expected,
            Cost::Fixed { step, .. } => step * steps,
        };
        let in_time = self.now_ns().saturating_add(as_ns(cost)) <= deadline_ns;
        if in_time {
            self.spent += cost;
        }
        in_time
    }

    /// Counts the time of compared losses. A loss costs at most as much as a step.
    pub(crate) fn looked(&mut self, looks: u32) {
        if let Cost::Fixed { step, .. } = self.cost {
            self.spent += step * looks;
        }
    }

    /// Counts the time of the encoding of a set.
    pub fn encoded(&mut self) {
        if let Cost::Fixed { encode, .. } = self.cost {
            self.spent += encode;
        }
    }
}

/// Converts between the clock of the player and the clock of the trackers. A simulated clock is both.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Times(pub Option<RealClock>);

impl Times {
    /// Returns the time on the clock of the trackers for `time_ns` on the clock of the player.
    pub(crate) fn monotonic_ns(self, time_ns: i64) -> u64 {
        self.0.map_or_else(|| u64::try_from(time_ns).unwrap_or(0), |clock| clock.monotonic_ns(time_ns))
    }

    /// Returns the time on the clock of the player for `time_ns` on the clock of the trackers.
    pub(crate) fn at_monotonic_ns(self, time_ns: u64) -> i64 {
        self.0.map_or_else(|| i64::try_from(time_ns).unwrap_or(i64::MAX), |clock| clock.at_monotonic_ns(time_ns))
    }
}
