//! Plays content on a display on time, refines it for the tracked pupil, and records what was shown.
//!
//! A [`Session`] shows one of two things on an [`Output`]: a [`Play`], what was solved before; or [`Live`] content, which is
//! refined for where the eye is while it is shown: one hologram, or [`Scenes`] that follow each other. It runs on threads of its own, and whoever holds it asks for its status,
//! takes its events and stops it.
//!
//! Content rate, multiplex-set rate and display rate are three things. A multiplex set (all sub-frames of all colours) takes
//! the video frames that its packing says; it is shown whole, and repeated until the next one is due.
//!
//! Pure, with times as numbers: `timeline` (which content frame is due when), `scheduler` (what the next video frame shows,
//! and the `account` of why), `pacing` (when to wake for it), `set_timing` (which set can still be reached). Around them:
//! `player`, the present thread's tick, and `present_thread`, its loop; `stream` (reading, checking and encoding ahead on
//! threads of their own); `refine` (the thread that owns the engines: [`LiveRefiner`] without threads) and `pupil_tracker` (the
//! one that takes a tracker's samples), whose sets pass through `sets`; on a simulated clock sets are made when they are asked for,
//! and `work_time` passes by what steps are said to take. [`MovingSequence`] reads ahead what follows, [`FarField`] the tiles around where the eye goes; `application` takes
//! frames from other processes; `showing` accounts for both. `moments` tells from frames and samples what moves while a set is lit. Each can end without taking the picture away.
//! `latency` accounts for every set that was shown, from the sample to the light; A program with a display and a loop of its own takes
//! video frames from a [`TickedSession`] (`ticks`). `on_screen` stores which version of a hologram is on the screen, for the
//! [`BenchFollower`], whose camera takes pictures of it. `marks`: the sync picture and the corner mark; `record`, `trace`, `notes`.
//!
//! Every time carries its unit and its meaning in its name.

mod content;
mod feeds;
mod frame_log;
mod handle;
mod options;
mod playback;
mod present_thread;
mod refinement;
mod ticked;

#[cfg(all(test, target_os = "linux"))]
mod device_views_tests;
#[cfg(test)]
mod look_up_tests;
#[cfg(test)]
mod moments_tests;
#[cfg(test)]
mod rolling_tests;
#[cfg(test)]
mod scenes_tests;
#[cfg(test)]
mod scheduler_tests;
#[cfg(test)]
mod scripted;
#[cfg(test)]
mod simulation;
#[cfg(test)]
mod soak_tests;
#[cfg(test)]
mod source_handover_tests;
#[cfg(any(test, feature = "test-hooks"))]
pub mod stage;
#[cfg(test)]
mod stream_tests;
#[cfg(test)]
mod tests;
#[cfg(test)]
mod thread_tests;
#[cfg(test)]
mod together_tests;

#[cfg(target_os = "linux")]
pub use content::application::{LiveInput, darkness};
pub use content::far_field::FarField;
pub use content::moving::{MovingSequence, SceneLoader};
pub use content::scenes::{Due, FrameFreshness, Newest, SceneFrame, Scenes};
#[cfg(target_os = "linux")]
pub use eyebox_live_input::Kind as LiveKind;
pub use feeds::following::LiveStatus;
pub use feeds::live::{EngineSource, Live, Tracking, whole_eyebox};
pub use feeds::play::Play;
pub use feeds::sets::FinishedSet;
pub use feeds::showing::ContentReport;
pub use feeds::sidecar::{LitSources, Now, SidecarOpener, SidecarWindow, SourceSwitch, UserRequest};
pub use feeds::statistics::{Ending, LiveStatistics, Statistics};
pub use frame_log::account::{Account, Cause, RepeatReason};
pub use frame_log::error::SessionError;
pub use frame_log::latency::{Histogram, Latency, Stage, Timestamps};
pub use frame_log::notes::SessionEvent;
pub use handle::Session;
pub use options::{About, Content, Ended, FrameObserver, SessionOptions, Status};
pub use playback::bench_follower::{BenchFollower, FollowEvent};
pub use playback::output::{Output, SinkFile};
pub use playback::pattern_output::PatternOutput;
pub use playback::player::{Command, PresentedFrame};
pub use playback::report::{Report, Timing};
pub use playback::scheduler::Target;
pub use playback::ticks::{TickedFrame, TickedOutput};
pub use playback::timeline::Speed;
pub use refinement::field::{Field, LiveColor};
pub use refinement::live_refiner::look_up::start_tables;
pub use refinement::live_refiner::{EngineOpener, Followed, LiveRefiner, PhasesOfColors, Policy};
pub use refinement::pupil_tracker::TrackerCounts;
pub use refinement::set_timing::SetTiming;
pub use refinement::work_time::Cost;
pub use ticked::TickedSession;
// What a study of simulated eyes has in common with a session.
pub use content::shifted::shifted_problem;
pub use refinement::live_refiner::together::lighting_of;
pub use refinement::moments::MotionCompensation;
pub use refinement::pupil_source::{PupilSource, Samples};
pub use refinement::pupil_tracker::PupilEstimate;
pub use refinement::work_time::WorkTime;
