//! A source on a thread of its own.
//!
//! The thread reads as fast as the source gives and never waits for who reads here: a mailbox holds the newest
//! samples, and older ones make room. So memory stays flat when a tracker floods or a reader sleeps.

use super::guard::Guard;
use super::recording::Head;
use super::{About, Dropped, Event, Sample, Source, TrackerError};
use eyebox_base::mailbox::Mailbox;
use eyebox_base::reason;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
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

/// State of a source.
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

/// A source's description, head of a recording and name.
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
    pub fn next_with_report(&self, timeout: Duration) -> Option<Arrival> {
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
        self.shared.known().about.clone()
    }

    /// The head of a recording of the source, once it is known; `None` from sources without reports.
    pub fn recording_head(&self) -> Option<Head> {
        self.shared.known().head.clone()
    }

    /// The name of the tracker, once it is known ([`Source::tracker`]).
    pub fn tracker(&self) -> Option<String> {
        self.shared.known().tracker.clone()
    }

    /// Returns its state. If the source has ended, an empty mailbox stays empty.
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
    // A source may wait, and may ask for its own state: it is never called under the lock.
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
