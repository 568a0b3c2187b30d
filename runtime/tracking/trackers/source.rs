//! Defines a tracker as a source of samples.

use super::{Sample, TrackerError, now_ns};
use serde::Serialize;
use std::time::Duration;

/// A device of a recording.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Head {
    /// Name of the device.
    pub name: String,
    /// Path at which it was plugged in.
    pub path: String,
    /// Numbers of bus, vendor and product.
    pub id: [u16; 3],
    /// Report descriptor of the device.
    pub descriptor: Vec<u8>,
}

/// The description of a source.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct About {
    /// Name of the source.
    pub name: String,
    /// Kind of the source, which is `hid`, `recording`, `network`, `mouse`, `program` or `simulated`.
    pub kind: &'static str,
    /// Samples per second, if the source reports the rate.
    pub rate_hz: Option<f64>,
    /// Further notes for the user.
    pub notes: Vec<String>,
}

/// Numbers of dropped data of a source, by reason.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
#[non_exhaustive]
pub struct Dropped {
    /// Messages and lines that cannot be read.
    pub messages: u64,
    /// Pupil diameters outside of 0.5 to 12 mm. Their samples are kept without them.
    pub diameters: u64,
    /// Number of times that the tracker's clock was set.
    pub clock_sets: u64,
}

impl Dropped {
    /// The sum of both numbers, by reason.
    pub(super) fn and(self, other: Self) -> Self {
        Self {
            messages: self.messages + other.messages,
            diameters: self.diameters + other.diameters,
            clock_sets: self.clock_sets + other.clock_sets,
        }
    }
}

/// The answer of a source to a request for the next sample.
// Nearly all events are samples, and a box would cost an allocation for each.
#[allow(clippy::large_enum_variant)]
#[derive(Debug, Clone, PartialEq)]
pub enum Event {
    /// A sample, with the report that it came in if the source has reports.
    Sample(Sample, Option<Box<[u8]>>),
    /// No sample arrived within the time limit.
    Nothing,
    /// A note for the user, such as a device that came, went, or fell silent. Ask again.
    Note(String),
    /// The source has ended, as a recording does.
    End,
}

/// Counts messages that cannot be read, and makes at most one note per second.
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
        Some(Event::Note(format!("{name}: {what} ({} dropped)", self.count)))
    }
}

/// Makes a note of a text, unless it equals the last one, `said`.
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

/// Sleeps until `due_ns`, or until `until_ns` if that is earlier. Returns true if `due_ns` has come.
pub(super) fn wait_for(due_ns: u64, until_ns: u64) -> bool {
    std::thread::sleep(Duration::from_nanos(due_ns.min(until_ns).saturating_sub(now_ns())));
    due_ns <= until_ns
}

/// A tracker that gives samples.
pub trait Source: Send {
    /// The current description of the source.
    fn about(&self) -> About;

    /// Waits at most `timeout` for the next sample.
    ///
    /// Temporary problems (an unplugged device, a silent peer, an invalid message) are not errors. The source continues
    /// and reports them in a note.
    ///
    /// # Errors
    /// A problem that waiting does not solve.
    fn next(&mut self, timeout: Duration) -> Result<Event, TrackerError>;

    /// Numbers of dropped data.
    fn dropped(&self) -> Dropped {
        Dropped::default()
    }

    /// The head of a recording of this source in the format of hid-recorder, once it is available. It is `None` for
    /// sources without reports.
    fn recording_head(&self) -> Option<Head> {
        None
    }

    /// The name of the tracker that the samples come from, which is a device's name or an address. It is `None` for
    /// sources that do not state it, such as recorded lines and programs, and before a device was found.
    fn tracker(&self) -> Option<String> {
        let (head, about) = (self.recording_head(), self.about());
        let states = matches!(about.kind, "network" | "simulated");
        head.map(|head| head.name).or_else(|| states.then_some(about.name))
    }
}
