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
//! threads of their own); `refine` (the thread that owns the engines: [`Steerer`] without threads) and `pupil_tracker` (the
//! one that takes a tracker's samples), whose sets pass through `sets`; on a simulated clock sets are made when they are asked for,
//! and `work_time` passes by what steps are said to take. [`MovingSequence`] reads ahead what follows, [`FarField`] the tiles around where the eye goes; `application` takes
//! frames from other processes; `showing` accounts for both. `moments` tells from frames and samples what moves while a set is lit. Each can end without taking the picture away.
//! `latency` accounts for every set that was shown, from the sample to the light; [`study()`] measures what steering gains
//! with a simulated eye in simulated time. A program with a display and a loop of its own takes
//! video frames from a [`TickedSession`] (`ticks`). `on_screen` stores which version of a hologram is on the screen, for the
//! [`BenchFollower`], whose camera takes pictures of it. `marks`: the sync picture and the corner mark; `record`, `trace`, `notes`.
//!
//! Every time carries its unit and its meaning in its name.

mod account;
#[cfg(target_os = "linux")]
mod application;
mod bench_follower;
mod companion;
mod content;
#[cfg(target_os = "linux")]
mod device_views;
mod error;
mod far_field;
mod field;
mod following;
mod handle;
mod journal;
mod latency;
mod likeness;
mod live;
mod marks;
mod moments;
mod moving;
mod notes;
mod on_screen;
mod output;
mod pacing;
mod pattern_output;
mod play;
mod player;
mod present_thread;
mod pupil_tracker;
mod record;
mod refine;
mod replay;
mod report;
mod running;
mod scenes;
mod scheduler;
mod set_timing;
mod sets;
mod showing;
mod statistics;
mod steerer;
mod stream;
mod study;
mod ticked;
mod ticks;
mod timeline;
mod trace;
mod watch;
mod work_time;

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
#[cfg(test)]
mod stream_tests;
#[cfg(test)]
mod tests;
#[cfg(test)]
mod thread_tests;
#[cfg(test)]
mod together_tests;

pub use account::{Account, Cause, Repeat};
#[cfg(target_os = "linux")]
pub use application::{LiveInput, LiveKind, darkness};
pub use bench_follower::{BenchFollower, FollowEvent};
pub use companion::{Asked, Companion, CompanionOpener, LitSources, Now, SourceSwitch};
pub use content::{About, Content, Ended, FrameObserver, SessionEvent, SessionOptions, Status};
pub use error::SessionError;
pub use far_field::FarField;
pub use field::Field;
pub use following::LiveStatus;
pub use handle::Session;
pub use latency::{Histogram, Latency, Stage, Timestamps};
pub use live::{EngineSource, Live, Tracking, whole_eyebox};
pub use moving::{MovingSequence, SceneLoader};
pub use output::{Output, SinkFile};
pub use pattern_output::PatternOutput;
pub use play::Play;
pub use player::{Command, PresentedFrame};
pub use pupil_tracker::TrackerCounts;
pub use report::{Report, Timing};
pub use scenes::{Due, Newest, SceneFrame, Scenes, Supply};
pub use set_timing::{SetTiming, Target};
pub use sets::FinishedSet;
pub use showing::Showing;
pub use statistics::{Ending, LiveStatistics, Statistics};
pub use steerer::look_up::start_tables;
pub use steerer::{EngineOpener, Followed, PhasesOfColors, Policy, SteeredColor, Steerer};
pub use study::{ContentRun, ContentSample, ContentSettings, JumpStart, StudiedContent, StudiedEye, study_content};
pub use study::{Judging, Observer, Study, StudySample, StudySettings, study};
pub use ticked::TickedSession;
pub use ticks::{TickedFrame, TickedOutput};
pub use timeline::Speed;
pub use work_time::Cost;
