//! The time that work takes: as this machine takes it, or as it is said to take.

use crate::present::RealClock;
use crate::session::refinement::set_timing::as_ns;
use std::time::{Duration, Instant};

/// What work costs in a study's time, and in that of a session on a simulated clock.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Cost {
    /// What it takes on this machine.
    Measured,
    /// The same on every machine, so that one study gives one result.
    Fixed {
        /// A step of one colour.
        step: Duration,
        /// Encoding a set.
        encode: Duration,
    },
}

impl Cost {
    /// What a step of each of so many colours is expected to take, where `measured` says it of this machine.
    pub fn round_ns(self, colors: usize, measured: impl FnOnce() -> Duration) -> i64 {
        match self {
            Self::Measured => as_ns(measured()),
            Self::Fixed { step, .. } => as_ns(step).saturating_mul(colors as i64),
        }
    }
}

/// Time that passes by what work costs, nanoseconds.
pub struct WorkTime {
    cost: Cost,
    began_ns: i64,
    begun: Instant,
    spent: Duration,
}

impl WorkTime {
    /// Begins at a time, nanoseconds.
    pub fn begin(cost: Cost, now_ns: i64) -> Self {
        Self { cost, began_ns: now_ns, begun: Instant::now(), spent: Duration::ZERO }
    }

    /// Returns the time by now, nanoseconds.
    pub fn now_ns(&self) -> i64 {
        let spent = if self.cost == Cost::Measured { self.begun.elapsed() } else { self.spent };
        self.began_ns.saturating_add(as_ns(spent))
    }

    /// Whether so many steps, which are `expected` to take so long together where it is measured, end in time; if so, they are taken.
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

    /// So many losses were looked at: no more than as many steps.
    pub(crate) fn looked(&mut self, looks: u32) {
        if let Cost::Fixed { step, .. } = self.cost {
            self.spent += step * looks;
        }
    }

    /// A set was encoded.
    pub fn encoded(&mut self) {
        if let Cost::Fixed { encode, .. } = self.cost {
            self.spent += encode;
        }
    }
}

/// The player's clock beside the trackers', which a simulated one is itself.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Times(pub Option<RealClock>);

impl Times {
    /// What the trackers' clock says when the player's says `time_ns`.
    pub(crate) fn monotonic_ns(self, time_ns: i64) -> u64 {
        self.0.map_or_else(|| u64::try_from(time_ns).unwrap_or(0), |clock| clock.monotonic_ns(time_ns))
    }

    /// What the player's clock said when the trackers' said `time_ns`.
    pub(crate) fn at_monotonic_ns(self, time_ns: u64) -> i64 {
        self.0.map_or_else(|| i64::try_from(time_ns).unwrap_or(i64::MAX), |clock| clock.at_monotonic_ns(time_ns))
    }
}
