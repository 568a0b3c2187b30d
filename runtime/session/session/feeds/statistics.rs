//! Holds the statistics of a session.

use crate::optics::Stereo;
use crate::present::{Apart, Interference, Link};
use crate::session::feeds::showing::ContentReport;
use crate::session::frame_log::account::RepeatReason;
use crate::session::frame_log::latency::Latency;
use crate::session::playback::controller::ControllerReport;
use crate::session::playback::pulses::PulseReport;
use crate::session::playback::report::Report;
use crate::session::playback::triggers::TriggerReport;
use crate::session::refinement::live_refiner::Policy;
use crate::session::refinement::pupil_tracker::TrackerCounts;
use serde_json::{Value, json};

/// The reason why a session ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[non_exhaustive]
pub enum Ending {
    /// The content reached its end.
    End,
    /// A user closed the display or the sidecar window.
    Closed,
    /// The duration of the session passed.
    Duration,
    /// The session was stopped.
    Stopped,
    /// An error ended the session.
    #[default]
    Failed,
}

impl Ending {
    /// Returns the name for people and statistics.
    pub fn name(self) -> &'static str {
        match self {
            Self::End => "the end",
            Self::Closed => "closed",
            Self::Duration => "the duration",
            Self::Stopped => "a stop",
            Self::Failed => "an error",
        }
    }
}

/// The statistics of the content that a session showed, with its delays.
#[derive(Debug, Clone, Default)]
#[non_exhaustive]
pub struct Statistics {
    /// The report of the playback.
    pub report: Report,
    /// The reason why the session ended.
    pub ended_by: Ending,
    /// The description of the display for people.
    pub presenter: String,
    /// The source of the times at which video frames lit up.
    pub timed_by: &'static str,
    /// The time at which content was lit for the first time (ns on the monotonic clock of the system). It is `None`
    /// without content, and on a simulated clock.
    pub first_light_ns: Option<u64>,
    /// The video frames per second.
    pub display_hz: f64,
    /// The content frames per second.
    pub content_hz: f64,
    /// The video frames of a multiplex set.
    pub set_frames: u64,
    /// The margin between waking and the deadline (ms).
    pub margin_ms: f64,
    /// The pictures that a recording skipped because the disk was slower than the display.
    pub pictures_left_out: u64,
    /// The events that changed or blanked the picture of the display, in the order of their beginning, as far as the
    /// system reports them.
    pub interference: Vec<Interference>,
    /// The link between the swapchain and the panel at the beginning, if a display showed the session.
    pub link: Option<Link>,
    /// The statistics of the display's controller, if it has one.
    pub controller: Option<ControllerReport>,
    /// The pulses that were given with the light of sets, if the display has `[trigger_out]`.
    pub trigger_out: Option<TriggerReport>,
    /// The pulses that advanced the content, if the display has `[trigger_in]`.
    pub trigger_in: Option<PulseReport>,
    /// The messages of the validation layer.
    pub validation: Vec<String>,
    /// The statistics of a live hologram, if the session showed one.
    pub live: Option<LiveStatistics>,
    /// The statistics of two eyes, if the session showed both.
    pub two_eyes: Option<TwoEyesReport>,
}

/// The statistics of the refinement for the tracked pupil.
#[derive(Debug, Clone, Default)]
#[non_exhaustive]
pub struct LiveStatistics {
    /// The description of the tracker for people.
    pub tracker: String,
    /// The counts of its samples.
    pub samples: TrackerCounts,
    /// The policy of the refinement.
    pub policy: Policy,
    /// The sets that were new when they were decided on.
    pub sets_new: u64,
    /// The sets that were shown again.
    pub sets_repeated: u64,
    /// The repeated sets by reason, in the order of [`RepeatReason::ALL`].
    pub repeats: [u64; 7],
    /// True if updates roll, so that every video frame may be new.
    pub rolls: bool,
    /// The sub-frames that were lit, of all colors, first for the first time and then again.
    pub sub_frames: [u64; 2],
    /// The steps over all colors.
    pub steps: u64,
    /// The restarts from the hologram for the whole eyebox.
    pub restarts: u64,
    /// The sets that were refined for motion.
    pub sets_moving: u64,
    /// The number of times that the phases were shifted with the content.
    pub phases_moved: u64,
    /// The smallest and the largest depth that sets on the screen were made for (m). It is `None` if all were for the
    /// whole eyebox.
    pub focus: Option<[f64; 2]>,
    /// The latency from the sample to the light.
    pub latency: Latency,
    /// The statistics of the content, if it changes.
    pub showing: Option<ContentReport>,
}

impl Statistics {
    /// Returns the statistics for programs, with the keys of `docs/playback.md` and `docs/live.md`.
    pub fn to_json(&self) -> Value {
        let mut all = self.report.to_json();
        if let Some(live) = &self.live {
            let mut joined = json!({ "playback": all });
            if let (Value::Object(joined), Value::Object(live)) = (&mut joined, live.to_json()) {
                joined.extend(live);
            }
            all = joined;
        }
        all["ended_by"] = json!(self.ended_by.name());
        all["presenter"] = json!(self.presenter);
        all["timed_by"] = json!(self.timed_by);
        all["display_rate_hz"] = json!(self.display_hz);
        all["content_rate_hz"] = json!(self.content_hz);
        all["video_frames_per_set"] = json!(self.set_frames);
        all["margin_ms"] = json!(self.margin_ms);
        all["interference"] = json!(self.interference);
        if let Some(link) = &self.link {
            all["link"] = json!(link);
        }
        if let Some(controller) = &self.controller {
            all["controller"] = controller.to_json();
        }
        if let Some(report) = &self.trigger_out {
            all["trigger_out"] = report.to_json();
        }
        if let Some(report) = &self.trigger_in {
            all["trigger_in"] = report.to_json();
        }
        if let Some(report) = &self.two_eyes {
            all["two_eyes"] = report.to_json();
        }
        all
    }
}

impl LiveStatistics {
    /// Returns the statistics for programs.
    pub(crate) fn to_json(&self) -> Value {
        let name = |repeat: &RepeatReason| repeat.name().replace(' ', "_");
        let repeats: Value = RepeatReason::ALL.iter().zip(self.repeats).map(|(r, n)| (name(r), json!(n))).collect();
        let [first, again] = self.sub_frames;
        let mut all = json!({
            "tracker": self.tracker, "samples": self.samples.to_json(), "sets_new": self.sets_new,
            "sets_repeated": self.sets_repeated, "repeated_because": repeats, "sets_roll": self.rolls,
            "sub_frames": { "first_light": first, "again": again }, "steps": self.steps, "restarts": self.restarts,
            "sets_moving": self.sets_moving, "phases_moved": self.phases_moved,
            "focus_mm": self.focus.map(|depths| depths.map(|z| z * 1e3)),
            "latency": self.latency.to_json(), "policy": self.policy,
        });
        if let Some(showing) = &self.showing {
            all["content"] = showing.to_json();
        }
        all
    }
}

/// The statistics of two eyes and of the right eye. The other statistics belong to the left eye.
#[derive(Debug, Clone, Default)]
#[non_exhaustive]
pub struct TwoEyesReport {
    /// The rule for the sets of the two eyes.
    pub stereo: Stereo,
    /// The video frames of content on both eyes.
    pub video_frames: u64,
    /// The video frames in which the eyes showed sets of different times or of different content.
    pub differing: u64,
    /// The distance in time between the lights of two panels, if there are two.
    pub apart: Option<Apart>,
    /// The link to the right panel at the beginning, if a display showed the session.
    pub right_link: Option<Link>,
    /// The statistics of the right panel's controller, if it has one.
    pub right_controller: Option<ControllerReport>,
    /// The statistics of the right eye, if content was refined.
    pub right_live: Option<LiveStatistics>,
}

impl TwoEyesReport {
    /// Returns the statistics for programs, with the keys of `docs/two-eyes.md`.
    pub(crate) fn to_json(&self) -> Value {
        let mut all = json!({
            "stereo": self.stereo, "video_frames": self.video_frames, "differing": self.differing,
        });
        if let Some(apart) = self.apart {
            all["light_apart"] = json!({
                "video_frames": apart.video_frames, "in_other_periods": apart.in_other_periods,
                "mean_ms": apart.mean_ms(), "largest_ms": apart.largest_ms(),
            });
        }
        if let Some(link) = &self.right_link {
            all["right_link"] = json!(link);
        }
        if let Some(controller) = &self.right_controller {
            all["right_controller"] = controller.to_json();
        }
        if let Some(live) = &self.right_live {
            all["right_eye"] = live.to_json();
        }
        all
    }
}
