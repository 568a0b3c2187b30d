//! Handles ctrl-C and the other signals that request an end.

use eyebox::low_level::files::asked_to_end;
use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::flag;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, OnceLock};

/// Exit code of a process that ctrl-C ends, as in a shell.
const INTERRUPTED: i32 = 130;
/// Exit code of a process that failed.
#[cfg(unix)]
const FAILED: i32 = 2;

/// True while the running work catches ctrl-C.
static CAUGHT: AtomicBool = AtomicBool::new(false);

/// Number of times that the running work checked whether ctrl-C was pressed.
static ASKED: AtomicU64 = AtomicU64::new(0);
/// A press of ctrl-C prints a line if the running work does not check for it during this time.
#[cfg(unix)]
const SILENCE: std::time::Duration = std::time::Duration::from_millis(300);

/// From now on ctrl-C, SIGTERM and a terminal that goes away (SIGHUP) request that the running work stops with its
/// result so far. The second signal ends the process at once. Under nohup, SIGHUP stays ignored.
pub fn catch_interrupt() {
    static ONCE: OnceLock<()> = OnceLock::new();
    ONCE.get_or_init(|| {
        let signals = signals();
        let arrived: Vec<(i32, Arc<AtomicBool>)> = signals.into_iter().map(|signal| (signal, Arc::default())).collect();
        let caught = |signal, own: &Arc<AtomicBool>| {
            // Handlers run in this order. Two threads may run the handlers of two signals at the same time. Each flag
            // is set before the others are read, so that one of the two threads finds the other flag.
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

/// From now on the signals end the process at once again and remove temporary files, because the running work is not
/// worth waiting for.
pub fn let_interrupt() {
    CAUGHT.store(false, Ordering::SeqCst);
}

/// Work that does not catch the signals ends at once, as any program does, but leaves no temporary file.
#[cfg(unix)]
pub fn end_without_drafts() {
    use signal_hook::iterator::Signals;
    use signal_hook::low_level::emulate_default_handler;
    // A shell makes programs in the background ignore ctrl-C.
    let heard: Vec<i32> = signals().into_iter().filter(|signal| !is_ignored(*signal)).collect();
    let Ok(mut arriving) = Signals::new(&heard) else { return };
    let wait = move || {
        for signal in arriving.forever() {
            if CAUGHT.load(Ordering::SeqCst) {
                if is_silent(&ASKED, || std::thread::sleep(SILENCE)) {
                    eprintln!("eyebox: stopping after the present work. Press ctrl-C again to stop at once");
                }
                continue;
            }
            eyebox::low_level::files::end_without_drafts(|| drop(emulate_default_handler(signal)));
        }
    };
    // The thread does little, so it has a small stack.
    let thread = std::thread::Builder::new().name("signals".into()).stack_size(64 << 10);
    if thread.spawn(wait).is_err() {
        let uncaught = Arc::new(AtomicBool::new(true));
        for signal in heard {
            let _ = flag::register_conditional_default(signal, Arc::clone(&uncaught));
        }
    }
}

/// Returns whether the running work did not check during a pause.
#[cfg(unix)]
fn is_silent(asked: &AtomicU64, pause: impl FnOnce()) -> bool {
    let before = asked.load(Ordering::SeqCst);
    pause();
    asked.load(Ordering::SeqCst) == before
}

/// Returns whether ctrl-C was pressed.
pub fn interrupted() -> bool {
    ASKED.fetch_add(1, Ordering::SeqCst);
    asked_to_end().load(Ordering::SeqCst)
}

/// Returns the signals that request the end of a program, without SIGHUP under nohup.
#[cfg(unix)]
fn signals() -> Vec<i32> {
    use signal_hook::consts::SIGHUP;
    (!is_ignored(SIGHUP)).then_some(SIGHUP).into_iter().chain([SIGTERM, SIGINT]).collect()
}

#[cfg(not(unix))]
fn signals() -> Vec<i32> {
    vec![SIGINT, SIGTERM]
}

/// Returns whether this process was started with a signal ignored.
#[cfg(unix)]
fn is_ignored(signal: i32) -> bool {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let ignored =
        status.lines().find_map(|l| l.strip_prefix("SigIgn:")).map(|mask| u64::from_str_radix(mask.trim(), 16));
    matches!(ignored, Some(Ok(mask)) if mask >> (signal - 1) & 1 == 1)
}

/// Turns a file that grows over the limit of the process into an ordinary error. If memory runs out that the system had
/// granted, the process prints its line and ends with the exit code of errors.
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
