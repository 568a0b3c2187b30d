//! Provides real and simulated time.

use eyebox_base::steady;
use std::cell::Cell;
use std::time::{Duration, Instant};

/// A source of time, in nanoseconds since its own origin.
pub trait Clock {
    /// The current time in nanoseconds.
    fn now_ns(&self) -> i64;
    /// Returns when the time is `time_ns` or later.
    fn wait_until_ns(&self, time_ns: i64);
    /// Waits until the program requests the next video frame, if the program sets the pace.
    fn wait_for_tick(&self) {}
    /// True if the clock advances only in its own waits. Then other waits cost no time.
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
    /// Starts a clock that is 0 now.
    pub fn start() -> Self {
        Self { origin: Instant::now(), origin_monotonic_ns: steady::now_ns() }
    }

    /// The time of this clock when the system's monotonic clock was `time_ns`.
    pub fn at_monotonic_ns(&self, time_ns: u64) -> i64 {
        super::rate::saturate(i128::from(time_ns) - i128::from(self.origin_monotonic_ns))
    }

    /// The time of the system's monotonic clock when this clock is `time_ns`.
    pub fn monotonic_ns(&self, time_ns: i64) -> u64 {
        self.origin_monotonic_ns.saturating_add_signed(time_ns)
    }

    /// The time of this clock at an instant.
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

/// A clock that advances only while something waits for it.
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
