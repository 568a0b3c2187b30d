//! Holds the options and the state that the threads of a stream share.

use crate::encode::VideoFrames;
use crate::session::frame_log::error::SessionError;
use crate::session::frame_log::notes::Notes;
use crate::session::frame_log::trace::Trace;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

#[derive(Debug, Clone)]
pub(crate) struct StreamOptions {
    /// The encoded sets that wait, without the one on the screen. There are at least 2.
    pub ahead: usize,
    /// True if the file starts again at its end.
    pub looped: bool,
    /// True if the reader waits for a sequence that is still being written.
    pub follow: bool,
    /// The first frame of the file to read.
    pub first: u64,
    /// The threads that encode on the CPU, or 0 for the number of cores.
    pub threads: usize,
    /// The side of the corner mark (pixels), or 0 for none.
    pub mark: usize,
    /// The sink for notes about skipped holograms.
    pub notes: Notes,
    /// The trace of the threads.
    pub trace: Trace,
}

/// The interval at which a waiting thread checks for its end.
pub(super) const POLL_INTERVAL: Duration = Duration::from_millis(20);
/// The number of holograms between the file and the encoder.
pub(super) const PHASES: usize = 3;

/// The shift of the epoch in a position. Positions start at 0 again with every seek, and values of an older epoch are
/// void.
pub(super) const EPOCH_SHIFT: u32 = 48;

pub(super) fn tagged(epoch: u64, position: u64) -> u64 {
    (epoch << EPOCH_SHIFT) | position.min((1 << EPOCH_SHIFT) - 1)
}

pub(super) fn of_epoch(value: u64, epoch: u64) -> Option<u64> {
    (value >> EPOCH_SHIFT == epoch & 0xffff).then_some(value & ((1 << EPOCH_SHIFT) - 1))
}

pub(super) struct Shared {
    pub(super) stop: AtomicBool,
    pub(super) epoch: AtomicU64,
    pub(super) seek_to: AtomicU64,
    /// The first position that is not read, the first useful position and the end, each with its epoch.
    pub(super) read: AtomicU64,
    pub(super) useful: AtomicU64,
    pub(super) end: AtomicU64,
    pub(super) failure: Mutex<Option<SessionError>>,
    /// The positions from which a test makes the reader and the encoder panic.
    #[cfg(test)]
    pub(super) panics: [AtomicU64; 2],
}

impl Shared {
    pub(super) fn stopped(&self) -> bool {
        self.stop.load(Ordering::Acquire)
    }

    pub(super) fn fail(&self, error: SessionError) {
        self.failure.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(error);
        self.stop.store(true, Ordering::Release);
    }

    #[cfg(test)]
    pub(super) fn panic_from(&self, thread: usize, position: u64) {
        assert!(position < self.panics[thread].load(Ordering::Acquire), "a test's fault at {position}");
    }
}

pub(super) struct Phases {
    pub(super) epoch: u64,
    pub(super) position: u64,
    pub(super) index: u64,
    pub(super) damaged: bool,
    pub(super) version: u64,
    pub(super) values: Vec<f32>,
}

pub(super) struct Encoded {
    pub(super) epoch: u64,
    pub(super) position: u64,
    pub(super) index: u64,
    pub(super) version: u64,
    pub(super) frames: Option<VideoFrames>,
}
