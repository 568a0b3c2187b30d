//! What the threads of a session have to tell a user.

use crate::mailbox::Mailbox;
use std::time::Duration;

/// Something that happened.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub enum SessionEvent {
    /// A line that a user wants to read: a hologram left out, a device lost, a tracker gone.
    Note(String),
    /// It has ended; [`Session::stop`](crate::session::Session::stop) says how.
    Ended,
}

/// Notes that wait for a reader at most; further ones are dropped.
const NOTES: usize = 64;

/// Where notes go, one for all threads of a session.
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

    /// Tells the end when it is dropped, however its thread ends: who waits for a note waits no longer.
    pub(crate) fn until_the_end(&self) -> EndNote {
        EndNote(self.clone())
    }

    /// Tells `note` if the thread that holds this ends in a panic.
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

/// Told when its thread panics.
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
