//! Passes notes from the threads of a session to the user.

use crate::mailbox::Mailbox;
use std::time::Duration;

/// An event of a session.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub enum SessionEvent {
    /// A note for the user, such as a skipped hologram, a lost device or a lost tracker.
    Note(String),
    /// The session has ended. [`Session::stop`](crate::session::Session::stop) returns the result.
    Ended,
}

/// The number of notes that can wait for a reader. Further notes are dropped.
const NOTES: usize = 64;

/// The sink for notes, shared by all threads of a session.
#[derive(Debug, Clone)]
pub(crate) struct Notes(Mailbox<SessionEvent>);

impl Default for Notes {
    fn default() -> Self {
        Self(Mailbox::new(NOTES))
    }
}

impl Notes {
    pub(crate) fn send(&self, note: impl Into<String>) {
        let _ = self.0.put(SessionEvent::Note(note.into()));
    }

    pub(crate) fn recv_timeout(&self, patience: Duration) -> Option<SessionEvent> {
        self.0.take_within(patience)
    }

    #[cfg(test)]
    pub(crate) fn take(&self) -> Option<String> {
        match self.0.take()? {
            SessionEvent::Note(note) => Some(note),
            SessionEvent::Ended => None,
        }
    }

    /// Sends the end when it is dropped, however its thread ends, so that a waiting reader continues.
    pub(crate) fn until_the_end(&self) -> EndNote {
        EndNote(self.clone())
    }

    /// Sends `note` if the thread that holds this ends in a panic.
    pub(crate) fn on_panic(&self, note: &'static str) -> PanicNote {
        PanicNote { notes: self.clone(), note }
    }
}

pub(crate) struct EndNote(Notes);

impl Drop for EndNote {
    fn drop(&mut self) {
        self.0.0.push(SessionEvent::Ended);
    }
}

/// Sends its note when its thread panics.
pub(crate) struct PanicNote {
    notes: Notes,
    note: &'static str,
}

impl Drop for PanicNote {
    fn drop(&mut self) {
        if std::thread::panicking() {
            self.notes.send(self.note);
        }
    }
}
