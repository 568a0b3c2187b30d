//! Holograms on a display, on time, and a truthful account of what was shown when.
//!
//! Content rate, multiplex-set rate and display rate are three things. A multiplex set (all sub-frames of all colours)
//! takes the video frames that its packing says; it is shown whole, and repeated until the next content frame is due.
//!
//! Pure, with times as numbers: `timeline` (which content frame is due when), `scheduler` (what the next video
//! frame shows, and the `account` of why), `pacing` (when to wake for it). Around them:
//! `stream` (reading, checking and encoding ahead, on threads of their own, in buffers that are made once, passed on through
//! `ring`s);
//! `player`, which joins all of it with a [`Presenter`](crate::present::Presenter);
//! `marks` (the sync picture and the corner mark), `record`, `trace`.
//!
//! Every time carries its unit and its meaning in its name. This room imports [`optics`](crate::optics),
//! [`files`](crate::files), [`hologram`](crate::hologram), [`encode`](crate::encode), of [`engine`](crate::engine) the
//! Vulkan encoder, and [`present`](crate::present).

mod account;
mod marks;
mod pacing;
mod player;
mod record;
mod report;
mod ring;
mod scheduler;
mod stream;
mod timeline;
mod trace;

#[cfg(test)]
mod scheduler_tests;
#[cfg(test)]
mod simulation;
#[cfg(test)]
mod stream_tests;

pub use account::{Account, Cause};
pub use marks::{Marks, mark_corner, sync_phases};
pub use pacing::{Outcome, Pacer, Prediction};
pub use player::{Command, Flow, Moment, Player, Source};
pub use record::Recorder;
pub use report::{Report, Timing};
pub use scheduler::{Content, Readiness, Schedule, Scheduler, Slot, Start, What};
pub use stream::{Options, Stream, StreamEncoder};
pub use timeline::{Speed, Timeline};
pub use trace::{Lane, Trace};

use crate::encode::EncodeError;
use crate::engine::EngineError;
use crate::files::FileError;
use crate::hologram::HologramError;
use crate::present::PresentError;

/// What can go wrong while playing.
#[derive(Debug, thiserror::Error)]
pub enum PlaybackError {
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
    /// The display.
    #[error(transparent)]
    Present(#[from] PresentError),
    /// A thread that could not be started, or failed.
    #[error("the thread that {what} {reason}")]
    Thread {
        /// What it does.
        what: &'static str,
        /// What happened to it.
        reason: String,
    },
}
