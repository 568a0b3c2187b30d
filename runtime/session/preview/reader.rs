//! The holograms of a sequence, read on a thread of their own.

use super::PreviewError;
use crate::hologram::{Hologram, HologramError, Sequence};
use crate::mailbox::Mailbox;
use std::thread::JoinHandle;

/// A hologram's number in its sequence, and what came of reading it.
pub type ReadHologram = (u64, Result<Hologram, HologramError>);

/// Reads the hologram that is wanted last; those that were wanted before it and not begun are left out.
pub struct Reader {
    wanted: Mailbox<Option<u64>>,
    read: Mailbox<ReadHologram>,
    thread: Option<JoinHandle<()>>,
}

impl Reader {
    /// Starts the thread.
    ///
    /// # Errors
    /// [`PreviewError::Thread`].
    pub fn start(mut sequence: Sequence) -> Result<Self, PreviewError> {
        let (wanted, read) = (Mailbox::new(1), Mailbox::new(1));
        let (wants, gives) = (wanted.clone(), read.clone());
        let run = move || {
            while let Some(index) = wants.wait() {
                gives.push((index, sequence.load(index)));
            }
        };
        let thread = std::thread::Builder::new().name("preview reader".into()).spawn(run);
        let thread = thread
            .map_err(|e| PreviewError::Thread { what: "reads holograms", reason: format!("did not start: {e}") })?;
        Ok(Self { wanted, read, thread: Some(thread) })
    }

    /// This one is wanted.
    pub fn want(&self, index: u64) {
        self.wanted.push(Some(index));
    }

    /// The newest that was read, with its number.
    ///
    /// # Errors
    /// [`PreviewError::Thread`] if nothing will come any more.
    pub fn newest(&self) -> Result<Option<ReadHologram>, PreviewError> {
        // Asked before: what it left last is not missed.
        let ended = self.thread.as_ref().is_none_or(JoinHandle::is_finished);
        match self.read.take() {
            None if ended => {
                Err(PreviewError::Thread { what: "reads holograms", reason: "ended without a word".into() })
            }
            read => Ok(read),
        }
    }
}

impl Drop for Reader {
    fn drop(&mut self) {
        self.wanted.push(None);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}
