//! Holograms on a display, on time, and a truthful account of what was shown when.
//!
//! Content rate, multiplex-set rate and display rate are three things. A multiplex set (all sub-frames of all colours)
//! takes the video frames that its packing says; it is shown whole, and repeated until the next content frame is due.
//!
//! Pure, with times as numbers: `rate`, `timeline` (which content frame is due when), `scheduler` (what the next video
//! frame shows, and the `account` of why), `pacing` (when to wake for it). Around them: `clock`, real or simulated;
//! `stream` (reading, checking and encoding ahead, on threads of their own, in buffers that are made once, passed on through
//! `ring`s);
//! `presenter`, the display's side: `offscreen` (with its `sink`s), `window` (with its `connection`) and `direct` behind one
//! trait; `panel`, ordinary windows beside it; `player`, which joins all of it;
//! `marks` (the sync picture and the corner mark), `record`, `trace`.
//!
//! Every time carries its unit and its meaning in its name. This room imports [`optics`](crate::optics),
//! [`files`](crate::files), [`hologram`](crate::hologram), [`encode`](crate::encode), and of
//! [`engine`](crate::engine) the Vulkan encoder and its screen.

mod account;
mod clock;
mod connection;
mod direct;
mod marks;
mod offscreen;
mod pacing;
mod panel;
mod player;
mod presenter;
mod rate;
mod record;
mod report;
mod ring;
mod scheduler;
mod sink;
mod stream;
mod timeline;
mod trace;
mod window;

#[cfg(test)]
mod scheduler_tests;
#[cfg(test)]
mod simulation;
#[cfg(test)]
mod stream_tests;

pub use account::{Account, Cause};
pub use clock::{Clock, RealClock, SimulatedClock};
pub use direct::{Connected, Direct, DirectWindow};
pub use marks::{Marks, mark_corner, sync_phases};
pub use offscreen::Offscreen;
pub use pacing::{Outcome, Pacer, Prediction};
pub use panel::{Panel, PanelEvent, PanelKey};
pub use player::{Command, Flow, Moment, Player, Source};
pub use presenter::{Event, Feedback, Presenter};
pub use rate::{Rate, SECOND_NS};
pub use record::Recorder;
pub use report::{Report, Timing};
pub use scheduler::{Content, Readiness, Schedule, Scheduler, Slot, Start, What};
pub use sink::Sink;
pub use stream::{Options, Stream, StreamEncoder};
pub use timeline::{Speed, Timeline};
pub use trace::{Lane, Trace};
pub use window::{Desktop, Monitor, Window};

use crate::encode::EncodeError;
use crate::engine::EngineError;
use crate::files::FileError;
use crate::hologram::HologramError;

/// What can go wrong while playing.
#[derive(Debug, thiserror::Error)]
pub enum PlaybackError {
    /// A rate that cannot be.
    #[error("the rate {value} cannot be: give hertz, 0.001 to 100000, such as 60, 59.94 or 60000/1001")]
    Rate {
        /// What was given.
        value: String,
    },
    /// The holograms.
    #[error(transparent)]
    Hologram(#[from] HologramError),
    /// The encoding.
    #[error(transparent)]
    Encode(#[from] EncodeError),
    /// The Vulkan encoder.
    #[error(transparent)]
    Engine(#[from] EngineError),
    /// A file.
    #[error(transparent)]
    File(#[from] FileError),
    /// The display's side: refused, or lost.
    #[error("{presenter}: {reason}")]
    Presenter {
        /// Which one.
        presenter: String,
        /// What is wrong, and what would be right.
        reason: String,
    },
    /// A thread that could not be started, or failed.
    #[error("the thread that {what} {reason}")]
    Thread {
        /// What it does.
        what: &'static str,
        /// What happened to it.
        reason: String,
    },
}
