//! Time, real and simulated.

use eyebox_base::steady;
use std::cell::Cell;
use std::time::{Duration, Instant};

/// Where time comes from, in nanoseconds since a beginning of its own.
pub trait Clock {
    /// Now.
    fn now_ns(&self) -> i64;
    /// Returns once it is `time_ns` or later.
    fn wait_until_ns(&self, time_ns: i64);
    /// Waits until the program asks for the next video frame, where it is the program that says when.
    fn wait_for_tick(&self) {}
    /// Whether it stands still unless waited for, so that others can be waited for without loss.
    fn is_simulated(&self) -> bool {
        false
    }
}

/// The system's steady clock.
#[derive(Debug, Clone, Copy)]
pub struct RealClock {
    origin: Instant,
    /// The system's monotonic clock at that instant.
    origin_monotonic_ns: u64,
}

impl RealClock {
    /// It is 0 now.
    pub fn start() -> Self {
        Self { origin: Instant::now(), origin_monotonic_ns: steady::now_ns() }
    }

    /// What it said when the system's monotonic clock said `time_ns`.
    pub fn at_monotonic_ns(&self, time_ns: u64) -> i64 {
        super::rate::saturate(i128::from(time_ns) - i128::from(self.origin_monotonic_ns))
    }

    /// What the system's monotonic clock says when this one says `time_ns`.
    pub fn monotonic_ns(&self, time_ns: i64) -> u64 {
        self.origin_monotonic_ns.saturating_add_signed(time_ns)
    }

    /// What it said at an instant.
    pub fn at_ns(&self, instant: Instant) -> i64 {
        match instant.checked_duration_since(self.origin) {
            Some(after) => i64::try_from(after.as_nanos()).unwrap_or(i64::MAX),
            None => -i64::try_from(self.origin.duration_since(instant).as_nanos()).unwrap_or(i64::MAX),
        }
    }
}

impl Clock for RealClock {
    fn now_ns(&self) -> i64 {
        self.at_ns(Instant::now())
    }

    fn wait_until_ns(&self, time_ns: i64) {
        let left = time_ns.saturating_sub(self.now_ns());
        if left > 0 {
            std::thread::sleep(Duration::from_nanos(left as u64));
        }
    }
}

/// A clock that passes only when it is waited for.
#[derive(Debug, Default)]
pub struct SimulatedClock(Cell<i64>);

impl Clock for SimulatedClock {
    fn now_ns(&self) -> i64 {
        self.0.get()
    }

    fn wait_until_ns(&self, time_ns: i64) {
        self.0.set(self.0.get().max(time_ns));
    }

    fn is_simulated(&self) -> bool {
        true
    }
}
