//! Reads and encodes ahead on two threads, through queues of buffers that are allocated once.
//!
//! The reader fills phase buffers from the file and checks them. The encoder turns them into video frames. The present
//! thread takes the video frames without waiting and returns the buffers. In the steady state nothing is allocated.
//!
//! A reader that is late skips frames that are no longer of use, so that it catches up. If a thread fails or panics,
//! the next [`poll`](SetSource::poll) returns an error.

mod encoding;
mod reader;
mod shared;

pub(crate) use shared::StreamOptions;

use crate::encode::{Encoder, PhaseSet, VideoFrames};
use crate::engine::vulkan::VulkanEncoder;
use crate::hologram::Sequence;
use crate::mailbox::Mailbox;
use crate::session::frame_log::error::SessionError;
use crate::session::frame_log::threads;
use crate::session::frame_log::trace::Track;
use crate::session::playback::player::SetSource;
use crate::session::playback::scheduler::Target;
use crate::session::playback::scheduler::{Content, Readiness};
use encoding::Encoding;
use reader::Reader;
use shared::{Encoded, PHASES, POLL_INTERVAL, Shared, of_epoch, tagged};
use std::any::Any;
use std::collections::VecDeque;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;

/// A file that is being streamed to the display.
pub(crate) struct Stream {
    shared: Arc<Shared>,
    epoch: u64,
    arriving: Mailbox<Encoded>,
    free: Mailbox<VideoFrames>,
    ready: VecDeque<Encoded>,
    on_screen: Option<Encoded>,
    threads: Vec<JoinHandle<Option<Track>>>,
}

impl Stream {
    /// Starts to read and to encode. It encodes on a `device` while there is one, then on the CPU, which gives the same
    /// bytes. Refuses holograms whose shape is not the shape of the encoder.
    pub(crate) fn start(
        sequence: Sequence,
        encoder: Encoder,
        device: Option<VulkanEncoder>,
        options: StreamOptions,
    ) -> Result<Self, SessionError> {
        let ahead = options.ahead.clamp(2, 64);
        let (shape, sent) = (sequence.shape(), sequence.about().sent_colors());
        let hidden = sequence.about().slopes_of_hidden_drives();
        let mut probe = encoder.frames();
        {
            // A shape that does not fit is refused here, not on a thread.
            let each = shape[1] * shape[2] * shape[3];
            let zeros = vec![0.0; each];
            let colors: Vec<&[f32]> = vec![&zeros; sent.len()];
            encoder.check(&PhaseSet::trusted(&colors), &probe)?;
        }
        let shared = Arc::new(Shared {
            stop: AtomicBool::new(false),
            epoch: AtomicU64::new(0),
            seek_to: AtomicU64::new(options.first),
            read: AtomicU64::new(0),
            useful: AtomicU64::new(0),
            end: AtomicU64::new(u64::MAX),
            failure: Mutex::new(None),
            #[cfg(test)]
            panics: [AtomicU64::new(u64::MAX), AtomicU64::new(u64::MAX)],
        });
        let free_phases = Mailbox::new(PHASES);
        for _ in 0..PHASES {
            let _ = free_phases.put(vec![0.0; sequence.values()]);
        }
        // One more buffer waits to be exchanged for the one on the screen.
        let free = Mailbox::new(ahead + 2);
        for _ in 0..ahead + 1 {
            let _ = free.put(std::mem::replace(&mut probe, encoder.frames()));
        }
        let _ = free.put(probe);
        let (to_encode, arriving) = (Mailbox::new(PHASES - 1), Mailbox::new(ahead + 2));
        let (track, state) = (options.trace.track("read"), Arc::clone(&shared));
        let reader = Reader {
            sequence,
            options: options.clone(),
            shared: state,
            free: free_phases.clone(),
            out: to_encode.clone(),
            track,
        };
        let read = spawn(&shared, "reads holograms", move || reader.run())?;
        let (track, state) = (options.trace.track("encode"), Arc::clone(&shared));
        let encoding = Encoding {
            shape,
            sent,
            hidden,
            mark: options.mark,
            shared: state,
            encode: to_encode,
            free_phases,
            free_frames: free.clone(),
            out: arriving.clone(),
            notes: options.notes.clone(),
            track,
        };
        let threads = options.threads;
        let encode = spawn(&shared, "encodes", move || encoding.start(&encoder, device, threads))?;
        let ready = VecDeque::with_capacity(2 * ahead + 8);
        let threads = vec![read, encode];
        Ok(Self { shared, epoch: 0, arriving, free, ready, on_screen: None, threads })
    }

    /// Ends the threads and returns their tracks.
    pub(crate) fn stop(mut self) -> Vec<Track> {
        self.shared.stop.store(true, Ordering::Release);
        self.threads.drain(..).filter_map(|t| t.join().ok().flatten()).collect()
    }

    /// Makes the reader (0) or the encoder (1) panic from a position on.
    #[cfg(test)]
    pub(crate) fn pretend_panic_from(&self, thread: usize, position: u64) {
        self.shared.panics[thread].store(position, Ordering::Release);
    }

    fn take(&mut self, item: Encoded) {
        if item.epoch == self.epoch {
            self.ready.push_back(item);
        } else {
            self.give_back(item.frames);
        }
    }

    fn give_back(&self, frames: Option<VideoFrames>) {
        if let Some(frames) = frames {
            // The mailbox has room for all of them.
            let _ = self.free.put(frames);
        }
    }

    fn failure(&self) -> Result<(), SessionError> {
        if !self.shared.stopped() {
            return Ok(());
        }
        let failure = self.shared.failure.lock().unwrap_or_else(PoisonError::into_inner).take();
        Err(failure.unwrap_or(SessionError::Thread { what: "reads and encodes", reason: "has ended".into() }))
    }
}

impl Drop for Stream {
    fn drop(&mut self) {
        self.shared.stop.store(true, Ordering::Release);
        self.threads.drain(..).for_each(|t| drop(t.join()));
    }
}

impl Content for Stream {
    fn readiness(&self, position: u64) -> Readiness {
        match self.ready.iter().find(|e| e.position == position) {
            Some(Encoded { frames: Some(_), .. }) => Readiness::Ready,
            Some(_) => Readiness::Damaged,
            None if of_epoch(self.shared.read.load(Ordering::Acquire), self.epoch).is_some_and(|r| position < r) => {
                Readiness::Read
            }
            None => Readiness::Unread,
        }
    }

    fn end(&self) -> Option<u64> {
        let end = self.shared.end.load(Ordering::Acquire);
        if end == u64::MAX { None } else { of_epoch(end, self.epoch) }
    }
}

impl SetSource for Stream {
    fn poll(&mut self, useful_from: u64) -> Result<(), SessionError> {
        self.shared.useful.store(tagged(self.epoch, useful_from), Ordering::Release);
        while self.ready.len() < self.ready.capacity() {
            let Some(item) = self.arriving.take() else { break };
            self.take(item);
        }
        // The newest of the frames that are too old may still be shown if nothing newer arrives.
        while self.ready.get(1).is_some_and(|second| second.position < useful_from) {
            if let Some(old) = self.ready.pop_front() {
                self.give_back(old.frames);
            }
        }
        self.failure()
    }

    fn settle(&mut self, position: u64, _target: Target) -> Result<(), SessionError> {
        loop {
            self.poll(position)?;
            let known = matches!(self.readiness(position), Readiness::Ready | Readiness::Damaged);
            let newer = self.ready.back().is_some_and(|e| e.position > position);
            if known || newer || self.end().is_some_and(|end| position >= end) {
                return Ok(());
            }
            if let Some(item) = self.arriving.take_within(POLL_INTERVAL) {
                self.take(item);
            }
        }
    }

    fn show(&mut self, position: u64) {
        while let Some(item) = self.ready.pop_front() {
            if item.position == position {
                if item.frames.is_some() {
                    let before = self.on_screen.replace(item);
                    self.give_back(before.and_then(|b| b.frames));
                }
                return;
            }
            self.give_back(item.frames);
        }
    }

    fn on_screen(&self) -> Option<(&VideoFrames, u64)> {
        let set = self.on_screen.as_ref()?;
        Some((set.frames.as_ref()?, set.index))
    }

    fn version(&self) -> Option<u64> {
        self.on_screen.as_ref().map(|set| set.version)
    }

    fn seek(&mut self, index: u64) {
        while let Some(item) = self.ready.pop_front() {
            self.give_back(item.frames);
        }
        self.epoch = (self.epoch + 1) & 0xffff;
        self.shared.seek_to.store(index, Ordering::Release);
        self.shared.epoch.store(self.epoch, Ordering::Release);
    }
}

/// Starts a thread. A panic counts as a failure and ends the other threads too.
fn spawn(
    shared: &Arc<Shared>,
    what: &'static str,
    run: impl FnOnce() -> Track + Send + 'static,
) -> Result<JoinHandle<Option<Track>>, SessionError> {
    let shared = Arc::clone(shared);
    let watched = move || match catch_unwind(AssertUnwindSafe(run)) {
        Ok(track) => Some(track),
        Err(panic) => {
            let reason = format!("failed, which is a fault of eyebox: {}", said(&*panic));
            shared.fail(SessionError::Thread { what, reason });
            None
        }
    };
    threads::spawn(what, watched)
}

fn said(panic: &(dyn Any + Send)) -> String {
    let text = panic.downcast_ref::<&str>().copied().or_else(|| panic.downcast_ref::<String>().map(String::as_str));
    text.map_or_else(|| "it does not say why".into(), |t| t.lines().collect::<Vec<_>>().join(" "))
}
