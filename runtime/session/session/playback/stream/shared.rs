//! What the threads of a stream share.

use crate::encode::VideoFrames;
use crate::session::frame_log::error::SessionError;
use crate::session::frame_log::notes::Notes;
use crate::session::frame_log::trace::Trace;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

#[derive(Debug, Clone)]
pub(crate) struct StreamOptions {
    /// Sets that wait encoded, beside the one on the screen; at least 2.
    pub ahead: usize,
    /// Whether the file begins again when it is over.
    pub looped: bool,
    /// Whether to wait for a sequence that is still being written.
    pub follow: bool,
    /// The frame of the file to begin with.
    pub first: u64,
    /// Threads that encode on the CPU; 0 for as many as there are cores.
    pub threads: usize,
    /// Side of the corner mark, pixels; 0 for none.
    pub mark: usize,
    /// Where it says what was left out.
    pub notes: Notes,
    /// Traces what the threads do.
    pub trace: Trace,
}

/// How often a thread that waits looks whether it is to stop.
pub(super) const POLL_INTERVAL: Duration = Duration::from_millis(20);
/// Holograms under way between file and encoder.
pub(super) const PHASES: usize = 3;

/// A position of an epoch: positions begin anew with every seek, and what belongs to an older epoch means nothing.
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
    /// Positions read, useful, and the end; each with its epoch.
    pub(super) read: AtomicU64,
    pub(super) useful: AtomicU64,
    pub(super) end: AtomicU64,
    pub(super) failure: Mutex<Option<SessionError>>,
    /// Positions from which on a test has the reader and the encoder panic.
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
