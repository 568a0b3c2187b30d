//! Starts and ends the threads of a session, and passes items between them without endless waits.

use crate::files::{FileError, GrowingFile};
use crate::mailbox::Mailbox;
use crate::session::frame_log::error::SessionError;
use std::thread::JoinHandle;
use std::time::Duration;

/// Starts the thread with the task `what`, a verb phrase such as "reads tiles".
pub(crate) fn spawn<T: Send + 'static>(
    what: &'static str,
    run: impl FnOnce() -> T + Send + 'static,
) -> Result<JoinHandle<T>, SessionError> {
    let failed = |e| SessionError::Thread { what, reason: format!("could not be started ({e})") };
    std::thread::Builder::new().name(format!("eyebox {what}")).spawn(run).map_err(failed)
}

/// Waits for the end of the thread with the task `what`.
pub(crate) fn join<T>(what: &'static str, thread: JoinHandle<T>) -> Result<T, SessionError> {
    let failed = |_| SessionError::Thread { what, reason: "failed, which is a fault of eyebox".into() };
    thread.join().map_err(failed)
}

/// Puts an item as soon as there is room for it, and checks after every `interval` if it should give up.
pub(crate) fn put_unless<T>(to: &Mailbox<T>, mut item: T, interval: Duration, gives_up: impl Fn() -> bool) {
    while let Err(back) = to.put_within(item, interval) {
        if gives_up() {
            return;
        }
        item = back;
    }
}

/// The interval of maintenance for a growing file while no entries arrive.
const TEND_INTERVAL: Duration = Duration::from_millis(200);

/// An item for the writer of a file.
pub(crate) enum Moment<E> {
    Begin,
    Entry(E),
    End,
}

/// Writes entries to a growing file on a thread of its own.
#[derive(Debug)]
pub(crate) struct EntryWriter<E> {
    what: &'static str,
    /// The mailbox of entries. `None` ends the thread.
    pub entries: Mailbox<Option<E>>,
    thread: JoinHandle<Result<(), FileError>>,
}

impl<E: Send + 'static> EntryWriter<E> {
    /// Starts the thread with the task `what`. At most `waiting` entries wait for it. After a failure it takes entries
    /// without writing them.
    pub(crate) fn start(
        what: &'static str,
        waiting: usize,
        mut out: GrowingFile,
        mut write: impl FnMut(&mut GrowingFile, Moment<E>) -> Result<(), FileError> + Send + 'static,
    ) -> Result<Self, SessionError> {
        let entries = Mailbox::new(waiting);
        let from: Mailbox<Option<E>> = entries.clone();
        let run = move || {
            let mut written = write(&mut out, Moment::Begin);
            loop {
                let next = from.take_within(TEND_INTERVAL);
                if let Some(None) = next {
                    return written.and_then(|()| write(&mut out, Moment::End)).and_then(|()| out.finish());
                }
                written = written.and_then(|()| match next.flatten() {
                    Some(entry) => write(&mut out, Moment::Entry(entry)),
                    None => out.tend(),
                });
            }
        };
        Ok(Self { what, entries, thread: spawn(what, run)? })
    }

    /// Writes the waiting entries and the end.
    ///
    /// # Errors
    /// Returns [`SessionError::File`] or [`SessionError::Thread`].
    pub(crate) fn finish(self) -> Result<(), SessionError> {
        put_unless(&self.entries, None, TEND_INTERVAL, || self.thread.is_finished());
        Ok(join(self.what, self.thread)??)
    }
}
