//! Reads eye trackers as [`Sample`]s with a steady time.
//!
//! The sources are devices, recordings, the network and a simulated eye. Each is a [`Source`], which waits for its next
//! sample on the thread of its caller. A [`Stream`] gives a source a thread of its own and keeps the newest samples for
//! slower readers. Sources check their input (lengths, ranges, finite numbers) and add no data. [`gaze`](crate::gaze)
//! maps positions to the pupil.
//!
//! | source | what it reads |
//! |---|---|
//! | `hid` | the first HID device of usage page 0x12, or the one that a device file describes ([`hid`]) |
//! | `FILE.hid` | a recording in the text format of hid-recorder ([`recording`]) |
//! | `FILE.jsonl` | recorded samples, one JSON object a line ([`mod@line`]) |
//! | `pupil://HOST[:PORT]` | Pupil Core's network interface ([`pupil_labs`]) |
//! | `udp://[HOST]:PORT` | lines of JSON in datagrams ([`udp`]) |
//! | `mouse` | positions that a window pushes ([`pushed`]) |
//! | a program | samples of a tracker of its own ([`pushed`]) |
//! | `simulated[:SEED]` | a simulated eye before a simulated tracker ([`simulated`]) |

pub mod hid;
pub mod line;
#[cfg(feature = "trackers")]
pub mod pupil_labs;
pub mod pushed;
pub mod recording;
pub mod simulated;
pub mod udp;

mod clock;
mod error;
mod guard;
mod open;
mod resolve;
mod sample;
mod source;
mod stream;
mod time_unit;
pub mod two_eyes;

pub use clock::Unwrap;
pub use error::TrackerError;
pub use eyebox_base::steady::now_ns;
pub use open::{Options, Spec, open};
pub(crate) use sample::UnitText;
pub use sample::{Quantity, Reading, Sample, Unit};
pub use source::{About, Dropped, Event, Head, Source};
pub use stream::{Status, Stream};
pub use time_unit::TimeUnit;
