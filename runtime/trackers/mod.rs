//! Eye trackers: what a device, a recording, a network or a simulation says, as [`Sample`]s with a steady time.
//!
//! Every source is a [`Source`]: it waits for its next sample, on whatever thread asks. A [`Stream`] gives a source a
//! thread of its own and keeps the newest samples for whoever is slower. Sources check what they receive (lengths,
//! ranges, finite numbers) and invent nothing: what a position means for the pupil is the next room's business
//! ([`gaze`](crate::gaze)). This room imports nothing of the engine, and of the runtime only
//! [`files`](crate::files).
//!
//! | source | what it reads |
//! |---|---|
//! | `hid` | the first HID device of usage page 0x12, or the one that a device file describes ([`hid`]) |
//! | `FILE.hid` | a recording in the text format of hid-recorder ([`recording`]) |
//! | `FILE.jsonl` | recorded samples, one JSON object a line ([`mod@line`]) |
//! | `pupil://HOST[:PORT]` | Pupil Core's network interface ([`pupil_labs`]) |
//! | `udp://[HOST]:PORT` | lines of JSON in datagrams ([`udp`]) |
//! | `mouse` | positions that a window pushes ([`mouse`]) |
//! | `simulated[:SEED]` | a simulated eye before a simulated tracker ([`simulated`]) |

pub mod hid;
pub mod line;
pub mod mouse;
#[cfg(feature = "trackers")]
pub mod pupil_labs;
pub mod recording;
pub mod simulated;
pub mod udp;

mod clock;
mod error;
mod open;
mod sample;
mod stream;

pub use clock::{ClockOffset, Unwrap, now_ns};
pub use error::TrackerError;
pub use open::{Options, Spec, open};
pub use sample::{Quantity, Reading, Sample, Unit};
pub use stream::{Status, Stream};

use serde::Serialize;
use std::time::Duration;

/// What a source is and can do.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct About {
    /// Its name.
    pub name: String,
    /// How it is reached: `hid`, `recording`, `network`, `mouse`, `simulated`.
    pub kind: &'static str,
    /// Samples a second, where it says so.
    pub rate_hz: Option<f64>,
    /// What is known besides, for people.
    pub notes: Vec<String>,
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

    /// The head of a recording of this source in the format of hid-recorder, once it is known; `None` from sources
    /// without reports.
    fn recording_head(&self) -> Option<recording::Head> {
        None
    }
}
