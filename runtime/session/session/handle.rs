//! Holds the handle to a session for its start, status, events, stop and statistics.

use crate::files::asked_to_end;
use crate::mailbox::Mailbox;
use crate::session::feeds::statistics::Statistics;
use crate::session::frame_log::error::SessionError;
use crate::session::frame_log::notes::{Notes, SessionEvent};
use crate::session::frame_log::threads::{join, spawn};
use crate::session::options::{About, COMMANDS, Content, Ended, SessionOptions, Shared, Status};
use crate::session::playback::output::Output;
use crate::session::playback::player::Command;
use crate::session::present_thread::PresentThread;
use crossbeam_utils::atomic::AtomicCell;
use eyebox_base::reason;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, sync_channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// The longest time that a display may take to open. A driver compiles its kernels in this time, and a software device
/// takes tens of seconds on a loaded machine. Without a limit, a driver that hangs would block the program forever.
const STARTED: Duration = Duration::from_secs(300);
/// The interval at which a wait checks for a request to end the program.
const LOOK: Duration = Duration::from_millis(100);

/// Content on a display, on threads of its own. It stops when it is dropped.
///
/// The present thread owns the display and waits only for the display. When content fails or ends, the display shows
/// the idle picture, which is defined.
pub struct Session {
    shared: Arc<Shared>,
    about: About,
    thread: Option<JoinHandle<Ended>>,
}

impl Session {
    /// Opens the display and starts to show. Returns when the display works.
    ///
    /// # Errors
    /// Returns any [`SessionError`] that occurs before something is shown.
    pub fn start(content: impl Into<Content>, output: Output, options: SessionOptions) -> Result<Self, SessionError> {
        let content = content.into();
        content.check()?;
        // A display file has the same limits. A session notices its end only at the next video frame.
        if let Some(rate) = options.display_rate.filter(|rate| !(1.0..=100_000.0).contains(&rate.hz())) {
            let hz = rate.hz();
            return Err(
                reason!("display-rate", "`display_rate` {hz}: it must be 1 to 100000 video frames per second").into()
            );
        }
        let steered = content.is_steered();
        let shared = Arc::new(Shared {
            stop: AtomicBool::new(false),
            steered: Arc::new(AtomicBool::new(steered)),
            status: AtomicCell::new(Status::default()),
            commands: Mailbox::new(COMMANDS),
            notes: Notes::default(),
        });
        let (tell, started) = sync_channel(1);
        let theirs = Arc::clone(&shared);
        let thread = spawn("presents", move || {
            let _end = theirs.notes.until_the_end();
            match PresentThread::start(content, &output, options, theirs) {
                Ok(mut present) => {
                    let _ = tell.send(Ok(present.about()));
                    present.run()
                }
                Err(error) => {
                    let _ = tell.send(Err(error));
                    Ended { statistics: Statistics::default(), result: Ok(()) }
                }
            }
        })?;
        let gone = |reason| {
            shared.stop.store(true, Ordering::Release);
            SessionError::Thread { what: "presents", reason }
        };
        let about = wait_for_start(&started, STARTED, asked_to_end()).map_err(gone)??;
        Ok(Self { shared, about, thread: Some(thread) })
    }

    /// Returns the description of the output.
    pub fn about(&self) -> &About {
        &self.about
    }

    /// Returns the status as of the last video frame.
    pub fn status(&self) -> Status {
        self.shared.status.load()
    }

    /// Returns the next event, waiting up to `within` for it.
    pub fn event(&self, within: Duration) -> Option<SessionEvent> {
        self.shared.notes.recv_timeout(within)
    }

    /// Pauses, steps, seeks or changes the speed of playback, from the next video frame on.
    pub fn command(&self, command: Command) {
        let _ = self.shared.commands.push(command);
    }

    /// Turns refinement for the tracked pupil on or off. If it is off, the hologram for the whole eyebox is shown.
    pub fn steer(&self, steered: bool) {
        self.shared.steered.store(steered, Ordering::Release);
    }

    /// Returns true while the session shows something.
    pub fn is_running(&self) -> bool {
        self.thread.as_ref().is_some_and(|t| !t.is_finished())
    }

    /// Stops the session if it has not ended, and returns its result.
    pub fn stop(mut self) -> Ended {
        self.shared.stop.store(true, Ordering::Release);
        let thread = self.thread.take().expect("a session has its thread until it is stopped");
        join("presents", thread).unwrap_or_else(|e| Ended { statistics: Statistics::default(), result: Err(e) })
    }
}

impl Drop for Session {
    fn drop(&mut self) {
        self.shared.stop.store(true, Ordering::Release);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// Waits until the present thread has opened the display, `patience` passes or the program receives a request to end.
/// Returns the reason if it did not open.
fn wait_for_start<T>(started: &Receiver<T>, patience: Duration, ends: &AtomicBool) -> Result<T, String> {
    let begun = Instant::now();
    loop {
        match started.recv_timeout(LOOK.min(patience)) {
            Ok(about) => return Ok(about),
            Err(RecvTimeoutError::Disconnected) => return Err("failed, which is a fault of eyebox".into()),
            Err(RecvTimeoutError::Timeout) if ends.load(Ordering::Acquire) => {
                return Err("received a request to end before it had opened the display".into());
            }
            Err(RecvTimeoutError::Timeout) if begun.elapsed() >= patience => {
                return Err(format!("did not open the display within {} s", patience.as_secs()));
            }
            Err(RecvTimeoutError::Timeout) => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_display_that_never_opens_is_not_waited_for() {
        let (tell, started) = sync_channel::<u8>(1);
        let ends = AtomicBool::new(false);
        assert!(wait_for_start(&started, Duration::from_millis(1), &ends).unwrap_err().contains("0 s"));
        ends.store(true, Ordering::Release);
        assert!(!wait_for_start(&started, STARTED, &ends).unwrap_err().contains(char::is_numeric));
        tell.send(7).unwrap();
        assert_eq!(wait_for_start(&started, STARTED, &ends), Ok(7));
        drop(tell);
        assert!(wait_for_start(&started, STARTED, &ends).is_err());
    }
}
