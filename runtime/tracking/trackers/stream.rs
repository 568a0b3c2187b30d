//! A source on a thread of its own.
//!
//! The thread reads as fast as the source gives and never waits for who reads here: a mailbox holds the newest
//! samples, and older ones make room. So memory stays flat when a tracker floods or a reader sleeps.

use super::guard::Guard;
use super::recording::Head;
use super::{About, Dropped, Event, Sample, Source, TrackerError};
use eyebox_base::mailbox::Mailbox;
use eyebox_base::reason;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

/// Samples kept for a slow reader: a quarter of a second at 1 kHz.
const KEPT: usize = 256;
const NOTES_KEPT: usize = 32;
/// How long the thread waits in the source before it looks whether it should stop.
const POLL_INTERVAL: Duration = Duration::from_millis(50);

/// How a stream is doing.
#[derive(Debug, Clone, PartialEq, Eq, Default, serde::Serialize)]
pub struct Status {
    /// Samples that arrived.
    pub samples: u64,
    /// Of these, dropped because the reader was slower than 256 samples.
    pub dropped: u64,
    /// What the source itself dropped.
    pub source: Dropped,
    /// Whether the source is at its end or failed for good.
    pub ended: bool,
    /// The failure.
    pub failure: Option<String>,
}

#[derive(Default)]
struct Shared {
    stop: AtomicBool,
    samples: AtomicU64,
    dropped: AtomicU64,
    ended: AtomicBool,
    failure: Mutex<Option<String>>,
    about: Mutex<(Option<About>, Option<Head>)>,
    tracker: Mutex<Option<String>>,
    by_source: Mutex<Dropped>,
}

/// A sample with the report that it came in.
type Arrival = (Sample, Option<Box<[u8]>>);

/// A running source; dropped, it stops.
pub struct Stream {
    samples: Mailbox<Arrival>,
    notes: Mailbox<String>,
    shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
}

impl Stream {
    /// Starts `source` on a thread.
    ///
    /// # Errors
    /// [`TrackerError::Setting`] where the system gives no thread.
    pub fn start(source: Box<dyn Source>) -> Result<Self, TrackerError> {
        let (samples, notes) = (Mailbox::new(KEPT), Mailbox::new(NOTES_KEPT));
        let shared = Arc::new(Shared::default());
        let (arrive, tell, theirs) = (samples.clone(), notes.clone(), Arc::clone(&shared));
        let thread = std::thread::Builder::new()
            .name("tracker".into())
            .spawn(move || run(source, &arrive, &tell, &theirs))
            .map_err(|e| TrackerError::Setting(reason!("thread", "no thread for the tracker: {e}")))?;
        Ok(Self { samples, notes, shared, thread: Some(thread) })
    }

    /// Waits for the next sample, `timeout` at most; `None` where there was none, or the source has ended.
    pub fn next(&self, timeout: Duration) -> Option<Sample> {
        self.next_with_report(timeout).map(|(sample, _)| sample)
    }

    /// As [`next`](Self::next), with the report that the sample came in.
    pub fn next_with_report(&self, timeout: Duration) -> Option<(Sample, Option<Box<[u8]>>)> {
        self.samples.take_within(timeout)
    }

    /// All samples that have arrived, the oldest first, without waiting.
    pub fn arrived(&self) -> impl Iterator<Item = Sample> + '_ {
        // No more than are kept, so that a flood does not keep the reader here.
        std::iter::from_fn(|| self.samples.take()).take(KEPT).map(|(sample, _)| sample)
    }

    /// A line that the source said, if there is one.
    pub fn note(&self) -> Option<String> {
        self.notes.take()
    }

    /// What the source says of itself.
    pub fn about(&self) -> Option<About> {
        self.shared.about.lock().unwrap_or_else(PoisonError::into_inner).0.clone()
    }

    /// The head of a recording of the source, once it is known; `None` from sources without reports.
    pub fn recording_head(&self) -> Option<Head> {
        self.shared.about.lock().unwrap_or_else(PoisonError::into_inner).1.clone()
    }

    /// The name of the tracker, once it is known ([`Source::tracker`]).
    pub fn tracker(&self) -> Option<String> {
        self.shared.tracker.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// How it is doing.
    pub fn status(&self) -> Status {
        let s = &self.shared;
        Status {
            samples: s.samples.load(Ordering::Relaxed),
            dropped: s.dropped.load(Ordering::Relaxed),
            source: *s.by_source.lock().unwrap_or_else(PoisonError::into_inner),
            // After this, whoever sees an empty mailbox has seen everything.
            ended: s.ended.load(Ordering::Acquire),
            failure: s.failure.lock().unwrap_or_else(PoisonError::into_inner).clone(),
        }
    }
}

impl Drop for Stream {
    fn drop(&mut self) {
        self.shared.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

fn run(source: Box<dyn Source>, samples: &Mailbox<Arrival>, notes: &Mailbox<String>, shared: &Shared) {
    let tell = |source: &dyn Source| {
        *shared.about.lock().unwrap_or_else(PoisonError::into_inner) = (Some(source.about()), source.recording_head());
        *shared.tracker.lock().unwrap_or_else(PoisonError::into_inner) = source.tracker();
    };
    // A program's own source may measure in another unit as well.
    let mut source = Guard::new(source);
    tell(&source);
    while !shared.stop.load(Ordering::Relaxed) {
        let next = source.next(POLL_INTERVAL);
        *shared.by_source.lock().unwrap_or_else(PoisonError::into_inner) = source.dropped();
        match next {
            Ok(Event::Sample(sample, report)) => {
                shared.samples.fetch_add(1, Ordering::Relaxed);
                if samples.push((sample, report)).is_some() {
                    shared.dropped.fetch_add(1, Ordering::Relaxed);
                }
            }
            Ok(Event::Nothing) => {}
            Ok(Event::Note(text)) => {
                tell(&source);
                let _ = notes.put(text);
            }
            Ok(Event::End) => break,
            Err(e) => {
                *shared.failure.lock().unwrap_or_else(PoisonError::into_inner) = Some(e.to_string());
                break;
            }
        }
    }
    shared.ended.store(true, Ordering::Release);
}
