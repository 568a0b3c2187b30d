//! Computes when sets begin and which one can still be reached. It is pure and passes between threads in an
//! `AtomicCell`.

use crate::session::playback::scheduler::Target;
use std::time::Duration;

/// Returns a duration in ns, limited to the largest `i64`.
pub(crate) fn as_ns(duration: Duration) -> i64 {
    i64::try_from(duration.as_nanos()).unwrap_or(i64::MAX)
}

/// The timing of the sets on the display (ns on the clock of the player).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SetTiming {
    /// The time at which the last set that was decided on begins to be lit.
    pub start_ns: i64,
    /// The time from the beginning of a set to the next beginning.
    pub period_ns: i64,
    /// The time from the decision on a set to its light.
    pub lead_ns: i64,
    /// With rolling updates, the video frame of the set whose turn it was then, and the number of video frames.
    /// Otherwise it is 0 of 1.
    pub turn: [u64; 2],
}

impl SetTiming {
    /// Returns the lead before any decision was observed, which is the margin of a player and a millisecond.
    pub fn usual_lead_ns(period_ns: i64) -> i64 {
        period_ns / 8 + 1_000_000
    }

    /// Creates a timing from the period alone.
    pub fn new(period_ns: i64) -> Self {
        Self { start_ns: 0, period_ns, lead_ns: Self::usual_lead_ns(period_ns), turn: [0, 1] }
    }

    /// Sets rolling updates with `turns` video frames per set. `period_ns` is the time from one video frame to the
    /// next.
    #[must_use]
    pub fn rolling(self, turns: u64) -> Self {
        Self { turn: [0, turns.max(1)], ..self }
    }

    /// Sets the video frame whose turn it was.
    #[must_use]
    pub fn at_turn(self, turn: u64) -> Self {
        let [_, turns] = self.turn;
        Self { turn: [turn % turns.max(1), turns], ..self }
    }

    /// Updates the timing after a set that begins at `start_ns` was decided on at `decided_ns`.
    #[must_use]
    pub fn after(self, start_ns: i64, decided_ns: i64) -> Self {
        let lead = start_ns.saturating_sub(decided_ns).clamp(0, 4 * self.period_ns.max(1));
        // A longer lead counts at once and a shorter one slowly, because a set that is too late waits for a whole
        // period.
        Self { start_ns, lead_ns: lead.max(self.lead_ns - self.lead_ns / 16), ..self }
    }

    /// Returns the first set after the last one for which work of `need_ns` from now on can still be handed over.
    pub fn reachable(&self, now_ns: i64, need_ns: i64) -> Target {
        let period = self.period_ns.max(1);
        let first = self.start_ns.saturating_add(period);
        let ready = now_ns.saturating_add(need_ns.max(0)).saturating_add(self.lead_ns);
        let late = ready.saturating_sub(first).max(0);
        let periods = late.saturating_add(period - 1) / period;
        let start_ns = first.saturating_add(periods.saturating_mul(period));
        let [turn, turns] = self.turn;
        let turn = turn.saturating_add(1).saturating_add(periods.unsigned_abs()) % turns.max(1);
        Target { start_ns, hand_over_ns: start_ns.saturating_sub(self.lead_ns), turn }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::solve::Pace;
    use proptest::prelude::*;

    #[test]
    fn the_next_set_or_the_first_that_is_reached() {
        let timing = SetTiming { start_ns: 1000, lead_ns: 30, ..SetTiming::new(100) };
        let at = |now, need| timing.reachable(now, need).start_ns;
        assert_eq!(at(0, 0), 1100, "never one that was decided on");
        assert_eq!((at(1060, 10), at(1061, 10)), (1100, 1200), "handed over at 1070 or never");
        assert_eq!(at(1061, 1000), 2100);
        assert_eq!(timing.reachable(1061, 1000).hand_over_ns, 2070);
        assert_eq!(timing.reachable(1061, 1000).turn, 0);
        // The turn is the eleventh after the sixth of eight.
        assert_eq!(timing.rolling(8).at_turn(5).reachable(1061, 1000).turn, 0);
        assert_eq!(timing.rolling(8).at_turn(5).reachable(0, 0).turn, 6);
    }

    #[test]
    fn an_early_decision_counts_at_once_and_is_forgotten_slowly() {
        let timing = SetTiming::new(16_000_000).after(50_000_000, 45_000_000);
        assert_eq!(timing, SetTiming { start_ns: 50_000_000, lead_ns: 5_000_000, ..SetTiming::new(16_000_000) });
        let timing = timing.after(66_000_000, 65_000_000);
        assert_eq!(timing.lead_ns, 5_000_000 - 312_500);
        let timing = (0..100).fold(timing, |timing, i| timing.after(82_000_000 + i, 81_000_000 + i));
        assert_eq!(timing.lead_ns, 1_000_000);
    }

    /// Stalls one step in the middle of a session whose steps take 2 ms. Decisions are made as in a refinement, from
    /// the expected time of steps and the reachable sets. Returns the gaps between sets that are longer than usual
    /// (ms).
    fn gaps_ms(stall_ms: f64) -> Vec<f64> {
        const MS: f64 = 1e6;
        const PERIOD_NS: i64 = 16_666_667;
        let (mut pace, mut timing) = (Pace::default(), SetTiming::new(PERIOD_NS));
        let (mut now_ns, mut last_ns, mut steps, mut gaps) = (0, 0, 0, Vec::new());
        while now_ns < 3_000_000_000 {
            let target = timing.reachable(now_ns, (1e9 * pace.expected()) as i64);
            let mut taken = 0;
            while pace.may_begin((target.hand_over_ns - now_ns) as f64 * 1e-9, taken) {
                steps += 1;
                let took_ms = if steps == 300 { stall_ms } else { 2.0 + 0.1 * f64::from(steps % 7) };
                now_ns += (took_ms * MS) as i64;
                pace.took(took_ms * 1e-3);
                taken += 1;
            }
            now_ns = now_ns.max(target.hand_over_ns);
            // It is lit with the first set that begins after it was handed over.
            let late = (now_ns - target.hand_over_ns + PERIOD_NS - 1) / PERIOD_NS;
            let start_ns = target.start_ns + late * PERIOD_NS;
            if taken > 0 && last_ns > 0 && start_ns - last_ns > PERIOD_NS {
                gaps.push((start_ns - last_ns) as f64 / MS);
            }
            if taken > 0 {
                last_ns = start_ns;
            }
            timing = SetTiming { start_ns, ..timing };
        }
        gaps
    }

    /// A stall does not count twice. The next step is not expected to take as long, and only one set is late.
    #[test]
    fn a_stall_makes_one_set_late() {
        assert_eq!(gaps_ms(2.0), Vec::<f64>::new());
        for stall_ms in [150.0, 300.0, 900.0] {
            let gaps = gaps_ms(stall_ms);
            assert!(gaps.len() == 1 && gaps[0] < stall_ms + 2.0 * 16.7, "{stall_ms} ms: {gaps:?}");
        }
    }

    proptest! {
        #[test]
        fn a_target_is_ahead_reachable_and_the_first(
            start in any::<i64>(), period in any::<i64>(), lead in 0i64..1 << 40, now in any::<i64>(), need in any::<i64>()
        ) {
            let timing = SetTiming { start_ns: start, lead_ns: lead, ..SetTiming::new(period) };
            let target = timing.reachable(now, need);
            if (0..1 << 50).contains(&start) && (1..1 << 40).contains(&period) && (0..1 << 50).contains(&now) {
                let need = need.clamp(0, 1 << 50);
                let target = timing.reachable(now, need);
                prop_assert!(target.start_ns > start && target.hand_over_ns >= now + need);
                let before = target.start_ns - period;
                prop_assert!(before <= start || before - lead < now + need);
                prop_assert_eq!((target.start_ns - start) % period, 0);
            }
            prop_assert!(target.hand_over_ns <= target.start_ns);
        }
    }
}
