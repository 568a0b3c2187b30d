//! Predicts when to wake for the next video frame and when it lights up, after the pacers of Monado and Granite.
//!
//! The next present is predicted by whole periods from the last known one. The present thread wakes early enough that
//! its work and a margin fit before it. A miss widens the margin at once, and a run of presents without a miss narrows
//! it slowly. The module is pure and takes times as numbers.

use crate::present::Rate;
use std::collections::VecDeque;

/// The predicted times of the next video frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Prediction {
    /// The number of the video frame. Missed ones count too.
    pub vblank: u64,
    /// The time at which the present thread wakes.
    pub wake_time_ns: i64,
    /// The time by which the display must have the video frame.
    pub desired_present_time_ns: i64,
    /// The time at which it lights up.
    pub predicted_display_time_ns: i64,
}

/// The feedback about a video frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Outcome {
    /// The number of the video frame as it was shown.
    pub vblank: u64,
    /// The number of periods that it was late.
    pub missed: u64,
    /// The actual minus the predicted time, without whole periods.
    pub jitter_ns: i64,
}

/// The number of presents without a miss after which the margin narrows.
const EVIDENCE: u32 = 120;

/// The number of periods that the first feedback may be later than predicted without counting as a miss.
const FIRST: i64 = 8;

/// Predicts video frames and learns from feedback.
#[derive(Debug, Clone)]
pub struct Pacer {
    rate: Rate,
    /// A video frame and its time, filtered over the last ones.
    anchor: Option<(u64, i64)>,
    /// True if the anchor came from the display.
    known: bool,
    last: Option<u64>,
    /// The video frames that were handed over without feedback, by their ids and their numbers.
    in_flight: VecDeque<(u64, u64)>,
    compute_ns: i64,
    /// The margin between waking and the deadline (ns).
    pub(crate) margin_ns: i64,
    good: u32,
}

impl Pacer {
    /// Creates a pacer for a display of this rate.
    pub fn new(rate: Rate) -> Self {
        let margin_ns = rate.period_ns() / 8;
        let in_flight = VecDeque::with_capacity(64);
        Self { rate, anchor: None, known: false, last: None, in_flight, compute_ns: 0, margin_ns, good: 0 }
    }

    /// Predicts the next video frame, which is the one after the last, or the first that can still be reached.
    pub fn predict(&mut self, now_ns: i64) -> Prediction {
        let ahead = self.compute_ns + self.margin_ns;
        let (first, time) = *self.anchor.get_or_insert((0, now_ns.saturating_add(ahead)));
        let next = self.last.map_or(first, |last| last + 1);
        let reachable = now_ns.saturating_add(self.compute_ns);
        let mut vblank = next;
        if self.time_of(next) < reachable {
            let periods = (reachable - time) / self.rate.period_ns();
            vblank = next.max(first.saturating_add_signed(periods - 1));
            while self.time_of(vblank) < reachable {
                vblank += 1;
            }
        }
        let predicted_display_time_ns = self.time_of(vblank);
        Prediction {
            vblank,
            wake_time_ns: predicted_display_time_ns - ahead,
            desired_present_time_ns: predicted_display_time_ns - self.margin_ns,
            predicted_display_time_ns,
        }
    }

    /// Records that a video frame was handed over, `compute_ns` after waking for it. `id` increases.
    pub(crate) fn submitted(&mut self, id: u64, vblank: u64, compute_ns: i64) {
        self.last = Some(vblank);
        // This maximum decays over some tens of frames.
        self.compute_ns = (self.compute_ns - self.compute_ns / 32).max(compute_ns.clamp(0, self.rate.period_ns()));
        if self.in_flight.len() == self.in_flight.capacity() {
            self.in_flight.pop_front();
        }
        self.in_flight.push_back((id, vblank));
    }

    /// Records that the video frame `id` lit up at this time. Returns `None` for an unknown frame, or one older than a
    /// known one.
    pub fn presented(&mut self, id: u64, actual_display_time_ns: i64) -> Option<Outcome> {
        while self.in_flight.front().is_some_and(|f| f.0 < id) {
            self.in_flight.pop_front();
        }
        let (_, vblank) = self.in_flight.pop_front().filter(|f| f.0 == id)?;
        let period = self.rate.period_ns();
        let off = actual_display_time_ns - self.time_of(vblank);
        // Until the first feedback, the phase of the display and the number of queued frames are unknown.
        if !std::mem::replace(&mut self.known, true) && off < FIRST * period {
            self.anchor = Some((vblank, actual_display_time_ns));
            return Some(Outcome { vblank, missed: 0, jitter_ns: 0 });
        }
        let missed = u64::try_from((off + period / 2).div_euclid(period)).unwrap_or(0);
        let vblank = vblank + missed;
        let jitter_ns = actual_display_time_ns - self.time_of(vblank);
        if missed > 0 {
            // The frames that are queued after it are shown after it.
            let mut before = vblank;
            for (_, queued) in &mut self.in_flight {
                *queued = (*queued).max(before + 1);
                before = *queued;
            }
            self.last = self.last.map(|last| last.max(before));
            self.margin_ns = (2 * self.margin_ns).min(period / 2);
            self.good = 0;
        } else {
            self.good += 1;
            if self.good >= EVIDENCE {
                self.good = 0;
                self.margin_ns = (self.margin_ns - self.margin_ns / 8).max(period / 32);
            }
        }
        self.anchor = Some((vblank, self.time_of(vblank) + jitter_ns / 8));
        Some(Outcome { vblank, missed, jitter_ns })
    }

    fn time_of(&self, vblank: u64) -> i64 {
        let (first, time) = self.anchor.unwrap_or((0, 0));
        let count = i64::try_from(i128::from(vblank) - i128::from(first)).unwrap_or(i64::MAX);
        time.saturating_add(self.rate.time_of_ns(count))
    }
}
