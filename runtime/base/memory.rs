//! Checks that memory is available before it is taken, so that no size in a file or an argument ends in an abort.

use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

/// Most that this process may have, bytes, where somebody said so.
static LIMIT: AtomicU64 = AtomicU64::new(u64::MAX);

/// More memory than there is.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error, serde::Serialize)]
#[error("{what} would take {} of memory, and {} are there: {remedy}", amount(*bytes), amount(*available))]
pub struct TooLarge {
    /// What it is for.
    pub what: String,
    /// Bytes that it would take.
    pub bytes: u64,
    /// Bytes that can be had.
    pub available: u64,
    /// What would fit.
    pub remedy: &'static str,
}

/// From now on nothing is promised that would bring this process beyond so many bytes.
pub fn limit(bytes: u64) {
    LIMIT.store(bytes, Relaxed);
}

/// Bytes that this process can still have: what its control group and its own limits leave it, what the machine has; none
/// where the system does not say.
pub fn available() -> Option<u64> {
    [machine(), control_group(), address_space(), stated()].into_iter().flatten().min()
}

/// Refuses what would take more than there is.
///
/// # Errors
/// [`TooLarge`].
pub fn check_available(what: impl FnOnce() -> String, bytes: u64, remedy: &'static str) -> Result<(), TooLarge> {
    match available() {
        Some(available) if bytes > available => Err(TooLarge { what: what(), bytes, available, remedy }),
        _ => Ok(()),
    }
}

/// Of `count` values of `size` bytes each; what no number holds is the largest.
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

/// What [`limit`] leaves.
fn stated() -> Option<u64> {
    let limit = LIMIT.load(Relaxed);
    (limit < u64::MAX).then(|| limit.saturating_sub(of_process("VmRSS:").unwrap_or(0)))
}

/// What `ulimit -v` leaves.
fn address_space() -> Option<u64> {
    let most = said("/proc/self/limits", "Max address space")?.split_whitespace().next()?.parse::<u64>().ok()?;
    Some(most.saturating_sub(of_process("VmSize:")?))
}

/// A number of bytes that the system says of this process.
fn of_process(name: &str) -> Option<u64> {
    kib(&said("/proc/self/status", name)?)
}

/// Bytes, where the system writes `123 kB`.
fn kib(text: &str) -> Option<u64> {
    text.strip_suffix("kB")?.trim().parse::<u64>().ok()?.checked_mul(1024)
}

/// What is left to the control group that this process is in, of the second version.
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
