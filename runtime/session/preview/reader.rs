//! The holograms of a sequence, read on a thread of their own.

use super::PreviewError;
use super::worker::Worker;
use crate::hologram::{Hologram, HologramError, Sequence};

/// A hologram's number in its sequence, and what came of reading it.
pub type ReadHologram = (u64, Result<Hologram, HologramError>);

/// Reads the hologram that is wanted last; those that were wanted before it and not begun are left out.
pub struct Reader(Worker<u64, ReadHologram>);

impl Reader {
    /// Starts the thread.
    ///
    /// # Errors
    /// [`PreviewError::Thread`].
    pub fn start(mut sequence: Sequence) -> Result<Self, PreviewError> {
        let worker = Worker::start("preview reader", "reads holograms", move |wanted, read| {
            while let Some(index) = wanted.wait() {
                read.push((index, sequence.load(index)));
            }
        });
        Ok(Self(worker?))
    }

    /// This one is wanted.
    pub fn want(&self, index: u64) {
        self.0.asked.push(Some(index));
    }

    /// The newest that was read, with its number.
    ///
    /// # Errors
    /// [`PreviewError::Thread`] if nothing will come any more.
    pub fn newest(&self) -> Result<Option<ReadHologram>, PreviewError> {
        self.0.newest()
    }
}
