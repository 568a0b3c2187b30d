//! How long a step is expected to take, and whether one may begin before a deadline. Times are numbers, in seconds: nothing
//! here looks at a clock.

/// Steps that are remembered.
const REMEMBERED: usize = 8;
/// Of these the second shortest is how long a step takes that nothing held up; one that took more than so many times as
/// long was held up by something else, and says nothing of the next.
const HELD_UP: f64 = 2.0;
/// What is expected after each deadline in a row before which no step could begin, of what was expected before.
const HOPE: f64 = 0.9;

/// The times of the last steps of one kind.
#[derive(Debug, Clone, Copy, Default)]
pub struct Pace {
    last: [f64; REMEMBERED],
    /// Steps so far.
    steps: usize,
    /// Deadlines in a row before which none could begin.
    refused: i32,
}

impl Pace {
    /// A step took so long.
    pub fn took(&mut self, seconds: f64) {
        self.last[self.steps % REMEMBERED] = seconds;
        self.steps += 1;
        self.refused = 0;
    }

    /// What the next step is expected to take: the longest of the last ones, without those that were held up, and less and
    /// less while none could begin. Nothing before the first.
    pub fn expected(&self) -> f64 {
        let mut known = self.last;
        let known = &mut known[..self.steps.min(REMEMBERED)];
        known.sort_by(f64::total_cmp);
        let Some(usual) = known.get(1).or(known.first()) else { return 0.0 };
        let longest = known.iter().rfind(|s| **s <= HELD_UP * usual).unwrap_or(usual);
        longest * HOPE.powi(self.refused)
    }

    /// Whether a step may begin where so long is left until a deadline, before which `taken` have been. That none could begin
    /// is remembered: after some such deadlines one is tried.
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

    /// Deadlines `period` seconds apart; a step takes one second and up to 5 % more, and ten times as long at random. Steps
    /// that were taken where steps begin by `may_begin`, told the time that is left and the steps before this deadline.
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
                    // Whoever knows what a step takes that nothing holds up.
                    let fit = steps(period, share, seed, 10_000, |left, _| left >= 1.05, |_| ());
                    assert!(done * 10 >= fit * 9, "{period}, {share}, {seed}: {done} of {fit}");
                }
            }
        }
    }

    /// The first step of all takes longest: shaders are compiled, memory is taken.
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
