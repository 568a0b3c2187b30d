//! Plays content on a display on time, refines it for the tracked pupil, and records what was shown.
//!
//! A [`Session`] shows one kind of content on an [`Output`]. A [`Play`] shows solved holograms. [`Live`] content is
//! refined for the tracked pupil while it is shown, and is one hologram or successive [`Scenes`]. A session runs on
//! threads of its own. Its owner reads the status, takes the events and stops it.
//!
//! Content rate, multiplex-set rate and display rate are three different rates. A multiplex set, which holds all
//! sub-frames of all colors, takes the number of video frames that its packing requires. It is shown whole, and is
//! repeated until the next one is due.
//!
//! These modules are pure and take times as numbers.
//!
//! | module | task |
//! |---|---|
//! | `timeline` | computes the content frame that is due at a time |
//! | `scheduler` | decides what the next video frame shows, and `account` counts the reasons |
//! | `pacing` | computes the time to wake for a video frame |
//! | `set_timing` | computes the set that can still be reached |
//!
//! These modules surround them.
//!
//! | module | task |
//! |---|---|
//! | `player` | is one tick of the present thread, and `present_thread` is its loop |
//! | `stream` | reads, checks and encodes content ahead on threads of its own |
//! | `refine` | is the thread that owns the engines, and [`LiveRefiner`] does its work without threads |
//! | `pupil_tracker` | is the thread that takes the samples of a tracker |
//! | `sets` | passes refined sets to the present thread, or makes them on request on a simulated clock |
//! | `work_time` | is the time that steps take, measured or simulated |
//! | [`MovingSequence`] | reads the next scenes ahead |
//! | [`FarField`] | reads the tiles around the predicted pupil ahead |
//! | `application` | takes frames from other processes |
//! | [`SplatWalk`] | draws splats for a camera that moves, and for the tracked pupil |
//! | [`SplatsDryRun`] | estimates the time of a content frame of splats on known devices |
//! | `showing` | counts the scenes of all of them |
//! | `moments` | estimates, from frames and samples, the motion during the light of a set |
//! | `latency` | measures every set that was shown, from the sample to the light |
//! | `ticks` | hands video frames to a program with a display and a loop of its own, through a [`TickedSession`] |
//! | `on_screen` | stores which version of a hologram is on the screen, for the camera of the [`BenchFollower`] |
//! | `two_eyed`, `both_eyes` | show the content of two eyes on one schedule |
//! | `controller` | starts the controller of the display, checks it, and puts it to sleep |
//! | `triggers`, `pulses` | give a pulse with the light of each set, and take pulses that advance content |
//! | `marks` | makes the sync picture and the corner mark |
//! | `record`, `trace`, `notes` | write pictures, traces and notes |
//!
//! Each of these threads can end without removing the picture. Every time carries its unit and its meaning in its name.

mod content;
mod feeds;
mod frame_log;
mod handle;
mod options;
mod playback;
mod present_thread;
mod refinement;
mod ticked;

#[cfg(test)]
mod device_splats_tests;
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
#[cfg(all(test, target_os = "linux", feature = "triggers"))]
mod trigger_tests;
#[cfg(test)]
mod two_eyes_tests;

#[cfg(target_os = "linux")]
pub use content::application::LiveInput;
pub use content::far_field::FarField;
pub use content::moving::{MovingSequence, SceneLoader};
pub use content::near_eye::darkness;
pub use content::scenes::{Due, FrameFreshness, Newest, SceneFrame, Scenes};
pub use content::splats_dry_run::SplatsDryRun;
pub use content::walk::{SplatWalk, WalkHandle};
#[cfg(target_os = "linux")]
pub use eyebox_live_input::Kind as LiveKind;
pub use feeds::following::LiveStatus;
pub use feeds::live::{EngineSource, Live, whole_eyebox};
pub use feeds::play::Play;
pub use feeds::sets::FinishedSet;
pub use feeds::showing::ContentReport;
pub use feeds::sidecar::{LitSources, Now, SidecarOpener, SidecarWindow, SourceSwitch, UserRequest};
pub use feeds::statistics::{Ending, LiveStatistics, Statistics, TwoEyesReport};
pub use feeds::tracking::Tracking;
pub use feeds::two_eyed::TwoEyed;
pub use frame_log::account::{Account, Cause, RepeatReason};
pub use frame_log::error::SessionError;
pub use frame_log::latency::{Histogram, Latency, Stage, Timestamps};
pub use frame_log::notes::SessionEvent;
pub use handle::Session;
pub use options::{About, Content, Ended, FrameObserver, SessionOptions, Status};
pub use playback::bench_follower::{BenchFollower, FollowEvent};
pub use playback::connection::ControllerConnection;
pub use playback::controller::{ControllerEvent, ControllerReport, leds_of_planes};
pub use playback::output::{Output, SinkFile};
pub use playback::pattern_output::PatternOutput;
pub use playback::picture_output::{PictureOutput, video_frame_size};
pub use playback::player::{Command, PresentedFrame};
pub use playback::pulses::PulseReport;
pub use playback::report::{Report, Timing};
pub use playback::scheduler::Target;
pub use playback::ticks::{TickedFrame, TickedOutput};
pub use playback::timeline::Speed;
pub use playback::triggers::{LightObserver, SetLight, TriggerReport};
pub use refinement::field::{Field, LiveColor};
pub use refinement::live_refiner::look_up::start_tables;
pub use refinement::live_refiner::{EngineOpener, Followed, LiveRefiner, PhasesOfColors, Policy};
pub use refinement::pupil_tracker::TrackerCounts;
pub use refinement::set_timing::SetTiming;
pub use refinement::work_time::Cost;
pub use ticked::TickedSession;
// These items are shared with a study of simulated eyes.
pub use content::shifted::shifted_problem;
pub use refinement::live_refiner::together::lighting_of;
pub use refinement::moments::MotionCompensation;
pub use refinement::pupil_source::{PupilSource, Samples};
pub use refinement::pupil_tracker::PupilEstimate;
pub use refinement::work_time::WorkTime;
