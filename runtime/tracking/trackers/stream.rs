//! Runs a source on a thread of its own.
//!
//! The thread reads as fast as the source gives and never waits for its reader. A mailbox holds the newest samples and
//! drops older ones. Memory therefore stays constant if a tracker floods or a reader sleeps.

use super::guard::Guard;
use super::recording::Head;
use super::{About, Dropped, Event, Sample, Source, TrackerError};
use eyebox_base::mailbox::Mailbox;
use eyebox_base::reason;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

/// Number of samples that are kept for a slow reader. It is a quarter of a second at 1 kHz.
const KEPT: usize = 256;
const NOTES_KEPT: usize = 32;
/// Time that the thread waits in the source between checks for a stop.
const POLL_INTERVAL: Duration = Duration::from_millis(50);

/// The state of a stream.
#[derive(Debug, Clone, PartialEq, Eq, Default, serde::Serialize)]
pub struct Status {
    /// Number of samples that arrived.
    pub samples: u64,
    /// Number of these that were dropped because the reader was slower than 256 samples.
    pub dropped: u64,
    /// Data that the source itself dropped.
    pub source: Dropped,
    /// True if the source has ended or failed permanently.
    pub ended: bool,
    /// The text of the failure.
    pub failure: Option<String>,
}

/// The known state of a source.
#[derive(Default)]
struct Known {
    status: Status,
    about: Option<About>,
    head: Option<Head>,
    tracker: Option<String>,
}

impl Known {
    fn take(&mut self, (about, head, tracker): Look) {
        (self.about, self.head, self.tracker) = (Some(about), head, tracker);
    }
}

/// The description of a source, the head of a recording, and its name.
type Look = (About, Option<Head>, Option<String>);

fn look(source: &dyn Source) -> Look {
    (source.about(), source.recording_head(), source.tracker())
}

#[derive(Default)]
struct Shared {
    stop: AtomicBool,
    known: Mutex<Known>,
}

impl Shared {
    fn known(&self) -> MutexGuard<'_, Known> {
        self.known.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// A sample with the report that it came in.
pub type Arrival = (Sample, Option<Box<[u8]>>);

/// A running source. It stops when it is dropped.
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
    /// [`TrackerError::Setting`] if the system gives no thread.
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

    /// Waits at most `timeout` for the next sample. It is `None` if there was none, or the source has ended.
    pub fn next(&self, timeout: Duration) -> Option<Sample> {
        self.next_with_report(timeout).map(|(sample, _)| sample)
    }

    /// Waits as in [`next`](Self::next). Returns the sample with the report that it came in.
    pub fn next_with_report(&self, timeout: Duration) -> Option<Arrival> {
        self.samples.take_within(timeout)
    }

    /// All samples that have arrived, the oldest first, without waiting.
    pub fn arrived(&self) -> impl Iterator<Item = Sample> + '_ {
        // No more samples than the mailbox keeps, so that a flood does not hold the reader here.
        std::iter::from_fn(|| self.samples.take()).take(KEPT).map(|(sample, _)| sample)
    }

    /// The next note of the source, if there is one.
    pub fn note(&self) -> Option<String> {
        self.notes.take()
    }

    /// The description of the source, if it is available.
    pub fn about(&self) -> Option<About> {
        self.shared.known().about.clone()
    }

    /// The head of a recording of the source, once it is available. It is `None` from sources without reports.
    pub fn recording_head(&self) -> Option<Head> {
        self.shared.known().head.clone()
    }

    /// The name of the tracker, once it is available ([`Source::tracker`]).
    pub fn tracker(&self) -> Option<String> {
        self.shared.known().tracker.clone()
    }

    /// Returns the state of the stream. If the source has ended, an empty mailbox stays empty.
    pub fn status(&self) -> Status {
        self.shared.known().status.clone()
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
    // A program's own source may measure in another unit as well.
    let mut source = Guard::new(source);
    // A source may wait and may read its own state, so it is never called under the lock.
    let seen = look(&source);
    shared.known().take(seen);
    while !shared.stop.load(Ordering::Relaxed) {
        let next = source.next(POLL_INTERVAL);
        let dropped = source.dropped();
        let seen = matches!(next, Ok(Event::Note(_))).then(|| look(&source));
        let mut known = shared.known();
        known.status.source = dropped;
        if let Some(seen) = seen {
            known.take(seen);
        }
        match next {
            Ok(Event::Sample(sample, report)) => {
                known.status.samples += 1;
                known.status.dropped += u64::from(samples.push((sample, report)).is_some());
            }
            Ok(Event::Nothing) => {}
            Ok(Event::Note(text)) => drop(notes.put(text)),
            Ok(Event::End) => break,
            Err(e) => {
                known.status.failure = Some(e.to_string());
                break;
            }
        }
    }
    shared.known().status.ended = true;
}
