//! What the threads of a session have to tell a user.

use crate::mailbox::Mailbox;
use std::time::Duration;

/// Notes that wait for a reader at most; further ones are dropped.
const NOTES: usize = 64;

/// Where notes go, one for all threads of a session.
#[derive(Debug, Clone)]
pub(crate) struct Notes(Mailbox<String>);

impl Default for Notes {
    fn default() -> Self {
        Self(Mailbox::new(NOTES))
    }
}

impl Notes {
    pub(crate) fn tell(&self, note: impl Into<String>) {
        let _ = self.0.put(note.into());
    }

    pub(crate) fn take_within(&self, patience: Duration) -> Option<String> {
        self.0.take_within(patience)
    }

    /// Tells `note` if the thread that holds this ends in a panic.
    pub(crate) fn on_panic(&self, note: &'static str) -> PanicNote {
        PanicNote { notes: self.clone(), note }
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
            self.notes.tell(self.note);
        }
    }
}
