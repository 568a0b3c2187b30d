//! Checks that memory is available before it is allocated, so that no size in a file or argument causes an abort.

use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

/// Maximum memory of this process in bytes, if [`limit`] was called.
static LIMIT: AtomicU64 = AtomicU64::new(u64::MAX);

/// The refusal of a request for more memory than is available.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error, serde::Serialize)]
#[error("{what} would take {} of memory, but only {} are available: {remedy}", amount(*bytes), amount(*available))]
pub struct TooLarge {
    /// Purpose of the memory.
    pub what: String,
    /// Bytes that the purpose requires.
    pub bytes: u64,
    /// Bytes that are available.
    pub available: u64,
    /// Advice for a request that would fit.
    pub remedy: &'static str,
}

/// Sets a limit. From now on, requests that would bring this process beyond this number of bytes are refused.
pub fn limit(bytes: u64) {
    LIMIT.store(bytes, Relaxed);
}

/// Returns the bytes that this process can still allocate. Its control group, its own limits and the machine bound
/// them. The result is `None` if the system does not report them.
pub fn available() -> Option<u64> {
    [machine(), control_group(), address_space(), stated()].into_iter().flatten().min()
}

/// Refuses a request for more memory than is available.
///
/// # Errors
/// Returns [`TooLarge`] for such a request.
pub fn check_available(what: impl FnOnce() -> String, bytes: u64, remedy: &'static str) -> Result<(), TooLarge> {
    match available() {
        Some(available) if bytes > available => Err(TooLarge { what: what(), bytes, available, remedy }),
        _ => Ok(()),
    }
}

/// Returns the bytes of an array with these axes, whose values have `size` bytes. The result saturates at the largest
/// number.
pub fn bytes_of(counts: &[usize], size: usize) -> u64 {
    counts.iter().fold(size as u64, |n, m| n.saturating_mul(*m as u64))
}

/// Returns the rest of the line that begins with `name`, in a file of the system.
fn said(file: &str, name: &str) -> Option<String> {
    let text = std::fs::read_to_string(file).ok()?;
    Some(text.lines().find_map(|line| line.strip_prefix(name))?.trim().to_owned())
}

fn machine() -> Option<u64> {
    kib(&said("/proc/meminfo", "MemAvailable:")?)
}

/// Returns the memory that [`limit`] leaves.
fn stated() -> Option<u64> {
    let limit = LIMIT.load(Relaxed);
    (limit < u64::MAX).then(|| limit.saturating_sub(of_process("VmRSS:").unwrap_or(0)))
}

/// Returns the memory that `ulimit -v` leaves.
fn address_space() -> Option<u64> {
    let most = said("/proc/self/limits", "Max address space")?.split_whitespace().next()?.parse::<u64>().ok()?;
    Some(most.saturating_sub(of_process("VmSize:")?))
}

/// Returns a number of bytes that the system reports for this process.
fn of_process(name: &str) -> Option<u64> {
    kib(&said("/proc/self/status", name)?)
}

/// Reads a number of bytes that the system writes as `123 kB`.
fn kib(text: &str) -> Option<u64> {
    text.strip_suffix("kB")?.trim().parse::<u64>().ok()?.checked_mul(1024)
}

/// Returns the memory that the control group of this process has left, for control groups of version 2.
fn control_group() -> Option<u64> {
    let path = said("/proc/self/cgroup", "0::")?;
    let number = |name: &str| {
        let file = format!("/sys/fs/cgroup{}/{name}", if path == "/" { "" } else { &path });
        std::fs::read_to_string(file).ok()?.trim().parse::<u64>().ok()
    };
    Some(number("memory.max")?.saturating_sub(number("memory.current")?))
}

fn amount(bytes: u64) -> String {
    let gib = bytes as f64 / (1u64 << 30) as f64;
    if gib >= 1.0 { format!("{gib:.1} GiB") } else { format!("{:.1} MiB", bytes as f64 / (1u64 << 20) as f64) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_no_machine_has_is_refused_with_both_numbers() {
        check_available(String::new, 1, "").expect("a byte is there");
        let bytes = bytes_of(&[usize::MAX, 8], 4);
        assert_eq!(bytes, u64::MAX, "no number holds it");
        if available().is_some() {
            let error = check_available(|| "a hologram".into(), bytes, "take less").unwrap_err();
            assert_eq!((error.bytes, error.remedy), (bytes, "take less"));
            assert!(error.to_string().contains("17179869184.0 GiB"), "{error}");
        }
    }
}
