//! Predicts the duration of a step and decides if one may begin before a deadline.
//!
//! Times are numbers in seconds. Nothing here reads a clock.

/// Number of stored step durations.
const REMEMBERED: usize = 8;
/// The second shortest stored step is the duration of an undisturbed step. A step that took more than this factor times
/// that duration was delayed by something else and does not predict the next one.
const HELD_UP: f64 = 2.0;
/// Factor on the prediction after each consecutive deadline before which no step could begin.
const HOPE: f64 = 0.9;

/// The durations of the last steps of one kind.
#[derive(Debug, Clone, Copy, Default)]
pub struct Pace {
    last: [f64; REMEMBERED],
    /// Total number of steps.
    steps: usize,
    /// Consecutive deadlines before which no step could begin.
    refused: i32,
}

impl Pace {
    /// Records the duration of a step in seconds.
    pub fn took(&mut self, seconds: f64) {
        self.last[self.steps % REMEMBERED] = seconds;
        self.steps += 1;
        self.refused = 0;
    }

    /// Returns the expected duration of the next step in seconds, or 0 before the first step.
    ///
    /// It is the longest of the last durations, except for delayed steps. It decreases while no step can begin.
    pub fn expected(&self) -> f64 {
        let mut known = self.last;
        let known = &mut known[..self.steps.min(REMEMBERED)];
        known.sort_by(f64::total_cmp);
        let Some(usual) = known.get(1).or(known.first()) else { return 0.0 };
        let longest = known.iter().rfind(|s| **s <= HELD_UP * usual).unwrap_or(usual);
        longest * HOPE.powi(self.refused)
    }

    /// Returns true if a step may begin `left` seconds before a deadline, before which `taken` steps were taken.
    ///
    /// Refusals are counted, so that a step is tried after several deadlines without one.
    pub fn may_begin(&mut self, left: f64, taken: usize) -> bool {
        let fits = left > 0.0 && self.expected() <= left;
        if !fits && taken == 0 && left > 0.0 {
            self.refused = self.refused.saturating_add(1);
        }
        fits
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::solve::SplitMix;

    /// Simulates deadlines `period` seconds apart. A step takes one second and up to 5 % more, and ten times as long at
    /// random. `may_begin` receives the remaining time and the steps before this deadline. The result is the number of
    /// steps taken.
    fn steps(
        period: f64,
        share: f64,
        seed: u64,
        deadlines: u32,
        mut may_begin: impl FnMut(f64, usize) -> bool,
        mut took: impl FnMut(f64),
    ) -> usize {
        let mut random = SplitMix(seed);
        let (mut now, mut all) = (0.0f64, 0);
        for deadline in 1..=deadlines {
            let deadline = f64::from(deadline) * period;
            let mut taken = 0;
            while may_begin(deadline - now, taken) {
                let held_up = random.unit() < share;
                let seconds = (1.0 + 0.05 * random.unit()) * if held_up { 10.0 } else { 1.0 };
                now += seconds;
                took(seconds);
                taken += 1;
            }
            now = now.max(deadline);
            all += taken;
        }
        all
    }

    #[test]
    fn hiccups_cost_no_more_than_their_time() {
        for period in [1.1, 1.6, 2.2, 5.5, 12.3] {
            for share in [0.0, 0.01, 0.05, 0.1, 0.2] {
                for seed in 0..3 {
                    let pace = std::cell::RefCell::new(Pace::default());
                    let took = |seconds| pace.borrow_mut().took(seconds);
                    let begins = |left, taken| pace.borrow_mut().may_begin(left, taken);
                    let done = steps(period, share, seed, 10_000, begins, took);
                    // This is the count with a known duration of an undisturbed step.
                    let fit = steps(period, share, seed, 10_000, |left, _| left >= 1.05, |_| ());
                    assert!(done * 10 >= fit * 9, "{period}, {share}, {seed}: {done} of {fit}");
                }
            }
        }
    }

    /// The first step takes longest because shaders are compiled and memory is allocated.
    #[test]
    fn one_slow_step_does_not_end_it() {
        let mut pace = Pace::default();
        pace.took(10.0);
        let refused = (0..100).take_while(|_| !pace.may_begin(1.2, 0)).count();
        assert!((1..30).contains(&refused), "{refused}");
        (0..2).for_each(|_| pace.took(1.0));
        assert!(pace.may_begin(1.2, 0) && !pace.may_begin(0.9, 1));
    }

    #[test]
    fn steps_that_have_become_slower_are_believed() {
        let mut pace = Pace::default();
        (0..20).for_each(|_| pace.took(1.0));
        (0..7).for_each(|_| pace.took(3.0));
        assert_eq!(pace.expected(), 3.0);
        (0..2).for_each(|_| pace.took(1.0));
        assert_eq!(pace.expected(), 1.0);
    }

    #[test]
    fn no_time_is_no_time() {
        let mut pace = Pace::default();
        assert!(pace.may_begin(1e-3, 0) && !pace.may_begin(0.0, 0));
        pace.took(1.0);
        (0..1000).for_each(|_| assert!(!pace.may_begin(-1.0, 0)));
        assert_eq!(pace.expected(), 1.0);
    }
}
