//! The eye, the refinement and the display together: a hologram that follows the pupil while it is shown.
//!
//! Three threads, and what passes between them. One takes a tracker's samples ([`Watch`]); whoever asks it gets the
//! pupil that it expects at a time. One owns the engines ([`refine`](start)): for the next set that can still be reached
//! ([`Beat`]) it asks where the pupil will be when that set lights up, refines until the set has to be handed over, never
//! beyond, and hands it over whole. The one that presents ([`LiveSource`], for a [`Player`](crate::playback::Player))
//! takes the newest set and never waits: when there is none, the last one stays. Each of the others can end without
//! taking the picture away.
//!
//! [`Steerer`] is the refinement without threads: all colours, and when to begin again with the hologram of the whole
//! eyebox. [`Latency`] accounts for every set that was shown, from the sample to the light. [`study()`] measures what
//! steering gains, with a simulated eye, in time that counts only the work.
//!
//! This room imports [`solve`](crate::solve), [`evaluate`](crate::evaluate), [`encode`](crate::encode),
//! [`playback`](crate::playback), [`trackers`](crate::trackers), [`gaze`](crate::gaze).

mod beat;
mod handover;
mod latency;
mod refine;
mod steerer;
mod study;
mod watch;

#[cfg(test)]
mod tests;

pub use beat::{Beat, BeatCell, Target};
pub use handover::{Giver, LiveSource, Made, handover};
pub use latency::{Histogram, Latency, Stage, Stamps};
pub use refine::{Live, LiveOptions, start};
pub use steerer::{Part, Policy, Steerer};
pub use study::{Moment, Observer, Study, StudySettings, study};
pub use watch::{Expected, Watch};

use crate::encode::EncodeError;
use crate::engine::EngineError;
use crate::optics::PupilDistribution;
use crate::solve::SolveError;
use crate::trackers::TrackerError;
use std::time::Duration;

/// What can go wrong while steering.
#[derive(Debug, thiserror::Error)]
pub enum LiveError {
    /// The solver refused.
    #[error(transparent)]
    Solve(#[from] SolveError),
    /// An engine.
    #[error(transparent)]
    Engine(#[from] EngineError),
    /// The encoding.
    #[error(transparent)]
    Encode(#[from] EncodeError),
    /// A tracker.
    #[error(transparent)]
    Tracker(#[from] TrackerError),
    /// A setting that cannot be.
    #[error("{0}")]
    Setting(String),
}

/// No eye is known better than this, metres: its spread as a solver takes it.
const SHARPEST: f64 = 0.1e-3;

fn as_ns(duration: Duration) -> i64 {
    i64::try_from(duration.as_nanos()).unwrap_or(i64::MAX)
}

/// Where a solver aims for a pupil that was predicted.
pub fn aim_of(seen: &PupilDistribution) -> PupilDistribution {
    PupilDistribution { spread: seen.spread.max(SHARPEST), ..*seen }
}
