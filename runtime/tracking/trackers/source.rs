//! What a tracker is to the rest: a source of samples.

use super::{Sample, TrackerError, now_ns};
use serde::Serialize;
use std::time::Duration;

/// A device of a recording.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Head {
    /// Its name.
    pub name: String,
    /// Where it was plugged in.
    pub path: String,
    /// Bus, vendor, product.
    pub id: [u16; 3],
    /// Its report descriptor.
    pub descriptor: Vec<u8>,
}

/// What a source is and can do.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct About {
    /// Its name.
    pub name: String,
    /// How it is reached: `hid`, `recording`, `network`, `mouse`, `program`, `simulated`.
    pub kind: &'static str,
    /// Samples a second, where it says so.
    pub rate_hz: Option<f64>,
    /// What is known besides, for people.
    pub notes: Vec<String>,
}

/// What a source dropped so far, by reason.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
#[non_exhaustive]
pub struct Dropped {
    /// Messages and lines that cannot be read.
    pub messages: u64,
    /// Pupil diameters outside of 0.5 to 12 mm: their samples are kept without them.
    pub diameters: u64,
    /// How often the tracker's clock was set.
    pub clock_sets: u64,
}

impl Dropped {
    /// The sum of both.
    pub(super) fn and(self, other: Self) -> Self {
        Self {
            messages: self.messages + other.messages,
            diameters: self.diameters + other.diameters,
            clock_sets: self.clock_sets + other.clock_sets,
        }
    }
}

/// What a source answers when it is asked for the next sample.
// Nearly all of them are samples: in a box each would cost an allocation.
#[allow(clippy::large_enum_variant)]
#[derive(Debug, Clone, PartialEq)]
pub enum Event {
    /// A sample; with it the report that it came in, where the source has such a thing.
    Sample(Sample, Option<Box<[u8]>>),
    /// Nothing within the time given.
    Nothing,
    /// Something happened that a person wants to read: a device came, went, or fell silent. Ask again.
    Note(String),
    /// The source is at its end: a recording.
    End,
}

/// Counts messages that cannot be read, and makes a note of one per second at most.
#[derive(Debug, Default)]
pub(super) struct Complaints {
    pub count: u64,
    said_ns: Option<u64>,
}

impl Complaints {
    /// Counts a message. Returns a note about it, unless the last note is less than a second old.
    pub(super) fn add(&mut self, now: u64, name: &str, what: impl std::fmt::Display) -> Option<Event> {
        self.count += 1;
        if self.said_ns.is_some_and(|at| now.saturating_sub(at) < 1_000_000_000) {
            return None;
        }
        self.said_ns = Some(now);
        Some(Event::Note(format!("{name}: {what} ({} dropped so far)", self.count)))
    }
}

/// Makes a note of a text, unless it is the last one, `said`.
pub(super) fn news(said: &mut String, text: String) -> Option<Event> {
    (*said != text).then(|| {
        said.clone_from(&text);
        Event::Note(text)
    })
}

/// Returns the end of `timeout` on the steady clock, nanoseconds.
pub(super) fn end_of(timeout: Duration) -> u64 {
    now_ns().saturating_add(u64::try_from(timeout.as_nanos()).unwrap_or(u64::MAX))
}

/// Sleeps until `due_ns`, or until `until_ns` if that is earlier. Returns whether `due_ns` has come.
pub(super) fn wait_for(due_ns: u64, until_ns: u64) -> bool {
    std::thread::sleep(Duration::from_nanos(due_ns.min(until_ns).saturating_sub(now_ns())));
    due_ns <= until_ns
}

/// A tracker.
pub trait Source: Send {
    /// What it is and can do, as far as it is known by now.
    fn about(&self) -> About;

    /// Waits for the next sample, `timeout` at most.
    ///
    /// What passes by itself (a device pulled out, a peer that is silent, a message that makes no sense) is no error:
    /// the source goes on trying, and says so in a note.
    ///
    /// # Errors
    /// What no waiting mends.
    fn next(&mut self, timeout: Duration) -> Result<Event, TrackerError>;

    /// What it dropped so far.
    fn dropped(&self) -> Dropped {
        Dropped::default()
    }

    /// The head of a recording of this source in the format of hid-recorder, once it is known; `None` from sources
    /// without reports.
    fn recording_head(&self) -> Option<Head> {
        None
    }

    /// The name of the tracker that the samples come from: the device's, or an address. `None` from sources that do not state it,
    /// such as recorded lines and programs, and before a device was found.
    fn tracker(&self) -> Option<String> {
        let (head, about) = (self.recording_head(), self.about());
        let states = matches!(about.kind, "network" | "simulated");
        head.map(|head| head.name).or_else(|| states.then_some(about.name))
    }
}
