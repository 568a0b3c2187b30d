//! Measures the accuracy of predicted video frames, and summarizes a playback.

use crate::session::frame_log::account::{Account, Cause};
use crate::session::playback::pacing::Outcome;
use crate::session::playback::scheduler::Scheduler;
use serde_json::{Value, json};

/// The accuracy of the predictions, over the video frames with known times of light.
#[derive(Debug, Clone, Copy, Default)]
pub struct Timing {
    count: u64,
    first: Option<(u64, i64)>,
    last: Option<(u64, i64)>,
    squares: f64,
    largest_ns: i64,
}

impl Timing {
    pub(crate) fn add(&mut self, outcome: Outcome, actual_display_time_ns: i64) {
        self.count += 1;
        self.first.get_or_insert((outcome.vblank, actual_display_time_ns));
        self.last = Some((outcome.vblank, actual_display_time_ns));
        self.squares += (outcome.jitter_ns as f64).powi(2);
        self.largest_ns = self.largest_ns.max(outcome.jitter_ns.saturating_abs());
    }

    /// Returns the number of video frames with known times.
    pub fn count(&self) -> u64 {
        self.count
    }

    /// Returns the root mean square of actual minus predicted times (ms).
    pub fn jitter_ms(&self) -> f64 {
        if self.count == 0 { 0.0 } else { (self.squares / self.count as f64).sqrt() / 1e6 }
    }

    /// Returns the largest of these differences (ms).
    pub fn largest_jitter_ms(&self) -> f64 {
        self.largest_ns as f64 / 1e6
    }

    /// Returns the measured video frames per second, or `None` before the second one.
    pub(crate) fn measured_hz(&self) -> Option<f64> {
        let ((v0, t0), (v1, t1)) = (self.first?, self.last?);
        (t1 > t0).then(|| (v1 - v0) as f64 * 1e9 / (t1 - t0) as f64)
    }
}

/// The report of a playback.
#[derive(Debug, Clone, Default)]
pub struct Report {
    /// The counts of sets and content frames.
    pub account: Account,
    /// The content frames that were due at the end and not shown.
    pub pending: u64,
    /// The duration of the playback (s on the clock of the player).
    pub seconds: f64,
    /// The sub-frames of a set, over all colors.
    pub planes: u64,
    /// The accuracy of the predicted times.
    pub timing: Timing,
}

impl Report {
    /// Creates the report of a scheduler after `seconds`.
    pub fn new(scheduler: &Scheduler, timing: &Timing, seconds: f64, planes: u64) -> Self {
        let (account, pending) = (*scheduler.account(), scheduler.pending() as u64);
        Self { account, pending, seconds, planes, timing: *timing }
    }

    /// Returns the new content frames per second.
    pub fn content_fps(&self) -> f64 {
        self.account.shown as f64 / self.seconds.max(1e-9)
    }

    /// Returns the multiplex sets per second.
    pub fn sets_per_second(&self) -> f64 {
        self.account.sets as f64 / self.seconds.max(1e-9)
    }

    /// Returns the report for programs.
    pub fn to_json(&self) -> Value {
        let by_cause = |counts: &[u64; 5]| -> Value {
            let one = |c: &Cause| (c.name().replace(' ', "-").to_lowercase(), Value::from(counts[*c as usize]));
            Cause::ALL.iter().map(one).collect()
        };
        let a = &self.account;
        json!({
            "seconds": self.seconds,
            "video_frames": a.video_frames,
            "missed_presents": a.missed_presents,
            "held_video_frames": a.held_video_frames,
            "sets": a.sets,
            "idle_sets": a.idle_sets,
            "repeated_sets": a.repeats,
            "late_sets": by_cause(&a.late_sets),
            "stretched_sets": a.stretched_sets,
            "content_due": a.due,
            "content_shown": a.shown,
            "content_dropped": by_cause(&a.dropped),
            "content_pending": self.pending,
            "content_fps": self.content_fps(),
            "sets_per_second": self.sets_per_second(),
            "sub_frames_per_second": self.sets_per_second() * self.planes as f64,
            "jitter_ms": self.timing.jitter_ms(),
            "largest_jitter_ms": self.timing.largest_jitter_ms(),
            "measured_display_hz": self.timing.measured_hz(),
        })
    }
}
