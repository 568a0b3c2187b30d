//! What came of a session, in numbers.

use crate::present::Interference;
use crate::session::feeds::showing::ContentReport;
use crate::session::frame_log::account::RepeatReason;
use crate::session::frame_log::latency::Latency;
use crate::session::playback::report::Report;
use crate::session::refinement::live_refiner::Policy;
use crate::session::refinement::pupil_tracker::TrackerCounts;
use serde_json::{Value, json};

/// Why a session ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[non_exhaustive]
pub enum Ending {
    /// The content was over.
    End,
    /// A user closed the display, or a window beside it.
    Closed,
    /// Its duration was over.
    Duration,
    /// It was stopped.
    Stopped,
    /// Something failed.
    #[default]
    Failed,
}

impl Ending {
    /// For people and statistics.
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

/// What was shown, and how late.
#[derive(Debug, Clone, Default)]
#[non_exhaustive]
pub struct Statistics {
    /// What was shown when.
    pub report: Report,
    /// Why it ended.
    pub ended_by: Ending,
    /// The display, for people.
    pub presenter: String,
    /// How it was known when video frames lit up.
    pub timed_by: &'static str,
    /// Video frames a second.
    pub display_hz: f64,
    /// Content frames a second.
    pub content_hz: f64,
    /// Video frames of a multiplex set.
    pub set_frames: u64,
    /// Between waking and what had to be done, ms.
    pub margin_ms: f64,
    /// Pictures that a recording did not keep: the disk was slower than the display.
    pub pictures_left_out: u64,
    /// What changed or blanked the display's picture, in the order in which it began, as far as the system reports it.
    pub interference: Vec<Interference>,
    /// What the validation layer found.
    pub validation: Vec<String>,
    /// Of a live hologram.
    pub live: Option<LiveStatistics>,
}

/// What following the eye did.
#[derive(Debug, Clone, Default)]
#[non_exhaustive]
pub struct LiveStatistics {
    /// The tracker, for people.
    pub tracker: String,
    /// What became of its samples.
    pub samples: TrackerCounts,
    /// How the hologram followed.
    pub policy: Policy,
    /// Sets that were new when they were decided on.
    pub sets_new: u64,
    /// Sets that were shown again,
    pub sets_repeated: u64,
    /// by their cause, in the order of [`RepeatReason::ALL`].
    pub repeats: [u64; 6],
    /// Whether sets roll: every video frame is one that may be new.
    pub rolls: bool,
    /// Sub-frames lit, of all colours: in a set's first light of them, and again.
    pub sub_frames: [u64; 2],
    /// Steps over all colours.
    pub steps: u64,
    /// How often it began again with the hologram for the whole eyebox.
    pub restarts: u64,
    /// Sets that were refined for what moves in them.
    pub sets_moving: u64,
    /// How often the phases were moved with the content.
    pub phases_moved: u64,
    /// The smallest and the largest depth that sets on the screen were made for, metres; none where all were for the whole
    /// eyebox.
    pub focus: Option<[f64; 2]>,
    /// From the sample to the light.
    pub latency: Latency,
    /// The account of what was to be seen, where that changes.
    pub showing: Option<ContentReport>,
}

impl Statistics {
    /// For programs: the keys are those of `docs/playback.md` and `docs/live.md`.
    pub fn to_json(&self) -> Value {
        let mut all = self.report.to_json();
        if let Some(live) = &self.live {
            let name = |repeat: &RepeatReason| repeat.name().replace(' ', "_");
            let repeats: Value = RepeatReason::ALL.iter().zip(live.repeats).map(|(r, n)| (name(r), json!(n))).collect();
            let [first, again] = live.sub_frames;
            all = json!({
                "playback": all, "tracker": live.tracker, "samples": live.samples.to_json(), "sets_new": live.sets_new,
                "sets_repeated": live.sets_repeated, "repeated_because": repeats, "sets_roll": live.rolls,
                "sub_frames": { "first_light": first, "again": again }, "steps": live.steps, "restarts": live.restarts,
                "sets_moving": live.sets_moving, "phases_moved": live.phases_moved,
                "focus_mm": live.focus.map(|depths| depths.map(|z| z * 1e3)),
                "latency": live.latency.to_json(), "policy": live.policy,
            });
            if let Some(showing) = &live.showing {
                all["content"] = showing.to_json();
            }
        }
        all["ended_by"] = json!(self.ended_by.name());
        all["presenter"] = json!(self.presenter);
        all["timed_by"] = json!(self.timed_by);
        all["display_rate_hz"] = json!(self.display_hz);
        all["content_rate_hz"] = json!(self.content_hz);
        all["video_frames_per_set"] = json!(self.set_frames);
        all["margin_ms"] = json!(self.margin_ms);
        all["interference"] = json!(self.interference);
        all
    }
}
