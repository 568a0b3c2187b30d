//! How well video frames came when they were predicted, and the summary of a playback.

use crate::session::frame_log::account::{Account, Cause};
use crate::session::playback::pacing::Outcome;
use crate::session::playback::scheduler::Scheduler;
use serde_json::{Value, json};

/// Of the video frames of which it is known when they lit up.
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

    /// How many.
    pub fn count(&self) -> u64 {
        self.count
    }

    /// Actual less predicted times: root of the mean square, ms.
    pub fn jitter_ms(&self) -> f64 {
        if self.count == 0 { 0.0 } else { (self.squares / self.count as f64).sqrt() / 1e6 }
    }

    /// The largest of them, ms.
    pub fn largest_jitter_ms(&self) -> f64 {
        self.largest_ns as f64 / 1e6
    }

    /// Video frames a second as they came; none before there were two.
    pub(crate) fn measured_hz(&self) -> Option<f64> {
        let ((v0, t0), (v1, t1)) = (self.first?, self.last?);
        (t1 > t0).then(|| (v1 - v0) as f64 * 1e9 / (t1 - t0) as f64)
    }
}

/// What came of a playback.
#[derive(Debug, Clone, Default)]
pub struct Report {
    /// The account.
    pub account: Account,
    /// Content frames that were due at the end and not shown.
    pub pending: u64,
    /// Seconds on the player's clock.
    pub seconds: f64,
    /// Sub-frames that a set holds, of all colours.
    pub planes: u64,
    /// The timing.
    pub timing: Timing,
}

impl Report {
    /// Of a scheduler, after some time.
    pub fn new(scheduler: &Scheduler, timing: &Timing, seconds: f64, planes: u64) -> Self {
        let (account, pending) = (*scheduler.account(), scheduler.pending() as u64);
        Self { account, pending, seconds, planes, timing: *timing }
    }

    /// New content frames a second.
    pub fn content_fps(&self) -> f64 {
        self.account.shown as f64 / self.seconds.max(1e-9)
    }

    /// Multiplex sets a second.
    pub fn sets_per_second(&self) -> f64 {
        self.account.sets as f64 / self.seconds.max(1e-9)
    }

    /// For programs.
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
