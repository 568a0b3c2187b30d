//! The system's monotonic clock, which never steps: one clock for trackers, displays and sessions.

/// Whether other programs and drivers count from the same beginning.
pub const IS_SYSTEM_WIDE: bool = cfg!(unix);

/// Nanoseconds of the system's monotonic clock; on Unix `CLOCK_MONOTONIC`, the same in every program.
#[cfg(unix)]
pub fn now_ns() -> u64 {
    let now = rustix::time::clock_gettime(rustix::time::ClockId::Monotonic);
    u64::try_from(now.tv_sec).unwrap_or(0) * 1_000_000_000 + u64::try_from(now.tv_nsec).unwrap_or(0)
}

/// Nanoseconds of the system's monotonic clock, counted from an hour before this program first asked.
#[cfg(not(unix))]
pub fn now_ns() -> u64 {
    use std::{sync::OnceLock, time::Duration, time::Instant};
    static START: OnceLock<Instant> = OnceLock::new();
    let passed = Duration::from_secs(3600) + START.get_or_init(Instant::now).elapsed();
    u64::try_from(passed.as_nanos()).unwrap_or(u64::MAX)
}
