//! When to wake for the next video frame, and when it will light up: after Monado's and Granite's pacers.
//!
//! The next present is predicted by whole periods from the last one known; the present thread wakes so much before that
//! what it has to do and a margin fit in between. A miss widens the margin at once, a run of presents without one
//! narrows it slowly. Pure: times come in as numbers.

use crate::present::Rate;
use std::collections::VecDeque;

/// The next video frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Prediction {
    /// Which; those that were missed are counted too.
    pub vblank: u64,
    /// When to begin with it.
    pub wake_time_ns: i64,
    /// When it must be with the display.
    pub desired_present_time_ns: i64,
    /// When it lights up.
    pub predicted_display_time_ns: i64,
}

/// What feedback said about a video frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Outcome {
    /// The video frame, as it came out.
    pub vblank: u64,
    /// Periods that it came late.
    pub missed: u64,
    /// Actual less predicted time, without whole periods.
    pub jitter_ns: i64,
}

/// Presents without a miss after which the margin narrows.
const EVIDENCE: u32 = 120;

/// Periods that the first answer may come later than guessed without a miss.
const FIRST: i64 = 8;

/// Predicts; learns from what happened.
#[derive(Debug, Clone)]
pub struct Pacer {
    rate: Rate,
    /// A video frame whose time is known, filtered over the last ones.
    anchor: Option<(u64, i64)>,
    /// Whether the anchor came from the display.
    known: bool,
    last: Option<u64>,
    /// Handed over and not known to be shown: their number and their video frame.
    in_flight: VecDeque<(u64, u64)>,
    compute_ns: i64,
    /// The margin between waking and what has to be done.
    pub(crate) margin_ns: i64,
    good: u32,
}

impl Pacer {
    /// For a display of this rate.
    pub fn new(rate: Rate) -> Self {
        let margin_ns = rate.period_ns() / 8;
        let in_flight = VecDeque::with_capacity(64);
        Self { rate, anchor: None, known: false, last: None, in_flight, compute_ns: 0, margin_ns, good: 0 }
    }

    /// The next video frame: the one after the last, or the first that can still be reached.
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

    /// A video frame was handed over, `compute_ns` after waking for it. `id` rises.
    pub(crate) fn submitted(&mut self, id: u64, vblank: u64, compute_ns: i64) {
        self.last = Some(vblank);
        // A maximum that is forgotten in some tens of frames.
        self.compute_ns = (self.compute_ns - self.compute_ns / 32).max(compute_ns.clamp(0, self.rate.period_ns()));
        if self.in_flight.len() == self.in_flight.capacity() {
            self.in_flight.pop_front();
        }
        self.in_flight.push_back((id, vblank));
    }

    /// The video frame `id` lit up at this time. None for one that is not known, or older than one that is.
    pub fn presented(&mut self, id: u64, actual_display_time_ns: i64) -> Option<Outcome> {
        while self.in_flight.front().is_some_and(|f| f.0 < id) {
            self.in_flight.pop_front();
        }
        let (_, vblank) = self.in_flight.pop_front().filter(|f| f.0 == id)?;
        let period = self.rate.period_ns();
        let off = actual_display_time_ns - self.time_of(vblank);
        // Until the first answer the display's phase is a guess, and so is how many frames it keeps in line.
        if !std::mem::replace(&mut self.known, true) && off < FIRST * period {
            self.anchor = Some((vblank, actual_display_time_ns));
            return Some(Outcome { vblank, missed: 0, jitter_ns: 0 });
        }
        let missed = u64::try_from((off + period / 2).div_euclid(period)).unwrap_or(0);
        let vblank = vblank + missed;
        let jitter_ns = actual_display_time_ns - self.time_of(vblank);
        if missed > 0 {
            // What is queued behind it comes after it.
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
