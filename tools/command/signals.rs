//! Signals: ctrl-C, and its kin.

use eyebox::low_level::files::asked_to_end;
use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::flag;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, OnceLock};

/// Exit code of a process that ctrl-C ends, as a shell has it.
const INTERRUPTED: i32 = 130;
/// Of one that failed.
#[cfg(unix)]
const FAILED: i32 = 2;

/// Whether what runs catches ctrl-C.
static CAUGHT: AtomicBool = AtomicBool::new(false);

/// How often what runs asked whether ctrl-C was pressed.
static ASKED: AtomicU64 = AtomicU64::new(0);
/// Whoever presses ctrl-C gets a line when what runs has not asked for so long.
#[cfg(unix)]
const SILENCE: std::time::Duration = std::time::Duration::from_millis(300);

/// From now on ctrl-C, SIGTERM and a terminal that goes away (SIGHUP; not under nohup, which has it ignored) ask what runs to
/// stop with what it has; the second one ends the process at once.
pub fn catch_interrupt() {
    static ONCE: OnceLock<()> = OnceLock::new();
    ONCE.get_or_init(|| {
        let signals = signals();
        let arrived: Vec<(i32, Arc<AtomicBool>)> = signals.into_iter().map(|signal| (signal, Arc::default())).collect();
        let caught = |signal, own: &Arc<AtomicBool>| {
            // Handlers run in this order. Two threads may run those of two signals at the same time: each is set before
            // the others are read, so that one of the two finds the other.
            flag::register_conditional_shutdown(signal, INTERRUPTED, Arc::clone(own))?;
            flag::register(signal, Arc::clone(own))?;
            for (_, other) in arrived.iter().filter(|(other, _)| *other != signal) {
                flag::register_conditional_shutdown(signal, INTERRUPTED, Arc::clone(other))?;
            }
            flag::register(signal, Arc::clone(asked_to_end()))
        };
        for (signal, own) in &arrived {
            if let Err(error) = caught(*signal, own) {
                eprintln!("eyebox: signal {signal} will not be caught: {error}");
            }
        }
        CAUGHT.store(true, Ordering::SeqCst);
    });
}

/// From now on ctrl-C and its kin end the process at once again, without drafts of files: nothing that runs is worth waiting for.
pub fn let_interrupt() {
    CAUGHT.store(false, Ordering::SeqCst);
}

/// What does not catch ctrl-C and its kin ends by them at once, as any program does, but leaves no draft of a file.
#[cfg(unix)]
pub fn end_without_drafts() {
    use signal_hook::iterator::Signals;
    use signal_hook::low_level::emulate_default_handler;
    // A shell has ctrl-C ignored by what it runs in the background.
    let heard: Vec<i32> = signals().into_iter().filter(|signal| !is_ignored(*signal)).collect();
    let Ok(mut arriving) = Signals::new(&heard) else { return };
    let wait = move || {
        for signal in arriving.forever() {
            if CAUGHT.load(Ordering::SeqCst) {
                if is_silent(&ASKED, || std::thread::sleep(SILENCE)) {
                    eprintln!("eyebox: it ends after the work that is under way; press ctrl-C again to end it at once");
                }
                continue;
            }
            eyebox::low_level::files::end_without_drafts(|| drop(emulate_default_handler(signal)));
        }
    };
    // A thread that does little: the least stack that there is.
    let thread = std::thread::Builder::new().name("signals".into()).stack_size(64 << 10);
    if thread.spawn(wait).is_err() {
        let uncaught = Arc::new(AtomicBool::new(true));
        for signal in heard {
            let _ = flag::register_conditional_default(signal, Arc::clone(&uncaught));
        }
    }
}

/// Whether what runs did not ask during a pause.
#[cfg(unix)]
fn is_silent(asked: &AtomicU64, pause: impl FnOnce()) -> bool {
    let before = asked.load(Ordering::SeqCst);
    pause();
    asked.load(Ordering::SeqCst) == before
}

/// Whether ctrl-C was pressed.
pub fn interrupted() -> bool {
    ASKED.fetch_add(1, Ordering::SeqCst);
    asked_to_end().load(Ordering::SeqCst)
}

/// Those that ask a program to end; not SIGHUP under nohup.
#[cfg(unix)]
fn signals() -> Vec<i32> {
    use signal_hook::consts::SIGHUP;
    (!is_ignored(SIGHUP)).then_some(SIGHUP).into_iter().chain([SIGTERM, SIGINT]).collect()
}

#[cfg(not(unix))]
fn signals() -> Vec<i32> {
    vec![SIGINT, SIGTERM]
}

/// Whether whoever started this process had it ignore a signal.
#[cfg(unix)]
fn is_ignored(signal: i32) -> bool {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let ignored =
        status.lines().find_map(|l| l.strip_prefix("SigIgn:")).map(|mask| u64::from_str_radix(mask.trim(), 16));
    matches!(ignored, Some(Ok(mask)) if mask >> (signal - 1) & 1 == 1)
}

/// A file that grows over the limit that the process has is an error like any other, and not the end. Memory that runs out
/// though it was promised ends the process, after the line that says so, as errors do.
pub fn outlive_limits() {
    #[cfg(unix)]
    {
        let _ = flag::register(signal_hook::consts::SIGXFSZ, Arc::default());
        let always = Arc::new(AtomicBool::new(true));
        let _ = flag::register_conditional_shutdown(signal_hook::consts::SIGABRT, FAILED, always);
    }
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;

    #[test]
    fn work_that_does_not_ask_is_reported() {
        let asked = AtomicU64::new(7);
        assert!(is_silent(&asked, || ()));
        assert!(!is_silent(&asked, || {
            asked.fetch_add(1, Ordering::SeqCst);
        }));
    }
}
