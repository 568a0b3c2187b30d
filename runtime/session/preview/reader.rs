//! Reads the holograms of a sequence on a thread of their own.

use super::PreviewError;
use super::worker::Worker;
use crate::hologram::{Hologram, HologramError, Sequence};

/// The number of a hologram in its sequence, and the result of its reading.
pub type ReadHologram = (u64, Result<Hologram, HologramError>);

/// Reads the hologram that was requested last. It skips earlier requests that have not begun.
pub struct Reader(Worker<u64, ReadHologram>);

impl Reader {
    /// Starts the thread of the reader.
    ///
    /// # Errors
    /// Returns [`PreviewError::Thread`] if the thread cannot be started.
    pub fn start(mut sequence: Sequence) -> Result<Self, PreviewError> {
        let worker = Worker::start("preview reader", "reads holograms", move |wanted, read| {
            while let Some(index) = wanted.wait() {
                read.push((index, sequence.load(index)));
            }
        });
        Ok(Self(worker?))
    }

    /// Requests the hologram of this number.
    pub fn want(&self, index: u64) {
        self.0.asked.push(Some(index));
    }

    /// Returns the newest hologram that was read, with its number.
    ///
    /// # Errors
    /// Returns [`PreviewError::Thread`] if the thread has ended.
    pub fn newest(&self) -> Result<Option<ReadHologram>, PreviewError> {
        self.0.newest()
    }
}
