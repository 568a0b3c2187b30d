//! Content, an eye and time brought together: holograms on a display, on time, and a truthful account of what was shown.
//!
//! A [`Session`] shows one of two things on an [`Output`]: a [`Play`], a sequence from disk; or a [`Live`] hologram, which is
//! refined for where the eye is while it is shown. It runs on threads of its own, and whoever holds it asks for its status,
//! takes its events and stops it.
//!
//! Content rate, multiplex-set rate and display rate are three things. A multiplex set (all sub-frames of all colours) takes
//! the video frames that its packing says; it is shown whole, and repeated until the next one is due.
//!
//! Pure, with times as numbers: `timeline` (which content frame is due when), `scheduler` (what the next video frame shows,
//! and the `account` of why), `pacing` (when to wake for it), `set_timing` (which set can still be reached). Around them:
//! `player`, the present thread's tick, and `present_thread`, its loop; `stream` (reading, checking and encoding ahead on
//! threads of their own); `refine` (the thread that owns the engines: [`Steerer`] without threads) and `pupil_tracker` (the
//! one that takes a tracker's samples), whose sets pass through `sets`. Each can end without taking the picture away.
//! `latency` accounts for every set that was shown, from the sample to the light; [`study()`] measures what steering gains
//! with a simulated eye in simulated time. `marks`: the sync picture and the corner mark; `record`, `trace`, `notes`.
//!
//! Every time carries its unit and its meaning in its name. This room imports [`solve`](crate::solve),
//! [`evaluate`](crate::evaluate), [`hologram`](crate::hologram), [`encode`](crate::encode), [`engine`](crate::engine),
//! [`trackers`](crate::trackers), [`gaze`](crate::gaze) and the display's side, [`present`](crate::present).

mod account;
mod companion;
mod handle;
mod latency;
mod live;
mod marks;
mod notes;
mod output;
mod pacing;
mod play;
mod player;
mod present_thread;
mod pupil_tracker;
mod record;
mod refine;
mod report;
mod scheduler;
mod set_timing;
mod sets;
mod statistics;
mod steerer;
mod stream;
mod study;
mod timeline;
mod trace;

#[cfg(test)]
mod scheduler_tests;
#[cfg(test)]
mod simulation;
#[cfg(test)]
mod stream_tests;
#[cfg(test)]
mod tests;
#[cfg(test)]
mod thread_tests;

pub use account::{Account, Cause};
pub use companion::{Asked, Companion, CompanionOpener, Now};
pub use handle::{About, Content, Ended, Ending, FrameObserver, Session, SessionEvent, SessionOptions, Status};
pub use latency::{Histogram, Latency, Stage, Timestamps};
pub use live::{EngineSource, Live, LiveStatus, Tracking};
pub use output::{Output, SinkFile};
pub use play::Play;
pub use player::{Command, PresentedFrame};
pub use report::{Report, Timing};
pub use set_timing::{SetTiming, Target};
pub use sets::FinishedSet;
pub use statistics::{LiveStatistics, Statistics};
pub use steerer::{Policy, SteeredColor, Steerer};
pub use study::{Cost, Observer, Study, StudySample, StudySettings, study};
pub use timeline::Speed;

use notes::Notes;
use pacing::Pacer;
use pupil_tracker::PupilTracker;
use scheduler::{Schedule, Scheduler};
use sets::LiveSource;
use trace::{Trace, Track};

use crate::encode::EncodeError;
use crate::engine::{Engine, EngineError};
use crate::files::FileError;
use crate::gaze::GazeError;
use crate::hologram::HologramError;
use crate::present::PresentError;
use crate::solve::SolveError;
use crate::trackers::TrackerError;
use std::time::Duration;

/// Opens an engine, as often as it is called.
pub type EngineOpener = Box<dyn FnMut() -> Result<Box<dyn Engine>, EngineError> + Send>;

/// What can go wrong in a session.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SessionError {
    /// The display: refused, or lost.
    #[error(transparent)]
    Present(#[from] PresentError),
    /// The holograms.
    #[error(transparent)]
    Hologram(#[from] HologramError),
    /// The encoding.
    #[error(transparent)]
    Encode(#[from] EncodeError),
    /// An engine, or the encoder's device.
    #[error(transparent)]
    Engine(#[from] EngineError),
    /// A file.
    #[error(transparent)]
    File(#[from] FileError),
    /// The solver refused.
    #[error(transparent)]
    Solve(#[from] SolveError),
    /// A tracker.
    #[error(transparent)]
    Tracker(#[from] TrackerError),
    /// A calibration, or a setting of the way from sample to pupil.
    #[error(transparent)]
    Gaze(#[from] GazeError),
    /// A thread that could not be started, or failed.
    #[error("the thread that {what} {reason}")]
    Thread {
        /// What it does.
        what: &'static str,
        /// What happened to it.
        reason: String,
    },
    /// A window beside the display.
    #[error("the window beside the display: {0}")]
    Companion(String),
    /// A setting that cannot be.
    #[error("{0}")]
    Setting(String),
}

impl SessionError {
    /// Whether the display was refused or lost, and nothing else is wrong.
    pub fn is_of_display(&self) -> bool {
        matches!(self, Self::Present(PresentError::Display { .. }))
    }
}

fn as_ns(duration: Duration) -> i64 {
    i64::try_from(duration.as_nanos()).unwrap_or(i64::MAX)
}
