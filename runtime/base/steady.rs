//! Reads the monotonic clock of the system, which trackers, displays and sessions share and which never steps.

/// True if other programs and drivers count from the same beginning.
pub const IS_SYSTEM_WIDE: bool = cfg!(unix);

/// Returns nanoseconds of the system's monotonic clock. On Unix this is `CLOCK_MONOTONIC`, the same in every program.
#[cfg(unix)]
pub fn now_ns() -> u64 {
    let now = rustix::time::clock_gettime(rustix::time::ClockId::Monotonic);
    u64::try_from(now.tv_sec).unwrap_or(0) * 1_000_000_000 + u64::try_from(now.tv_nsec).unwrap_or(0)
}

/// Returns nanoseconds of the system's monotonic clock, counted from an hour before the first call in this program.
#[cfg(not(unix))]
pub fn now_ns() -> u64 {
    use std::{sync::OnceLock, time::Duration, time::Instant};
    static START: OnceLock<Instant> = OnceLock::new();
    let passed = Duration::from_secs(3600) + START.get_or_init(Instant::now).elapsed();
    u64::try_from(passed.as_nanos()).unwrap_or(u64::MAX)
}
