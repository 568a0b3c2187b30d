//! Finds the Pareto front, which is the set of trials that no other trial beats.

use eyebox::low_level::solve::Settings;
use serde::{Deserialize, Serialize};

/// A recipe with its measurements.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Trial {
    /// The settings of the solve.
    pub recipe: Settings,
    /// The median of `times`, in milliseconds.
    pub milliseconds: f64,
    /// All measured times of the solve, in milliseconds.
    pub times: Vec<f64>,
    /// The mean PSNR over the pupils of the reference, in dB.
    pub mean: f64,
    /// The worst PSNR over these pupils, in dB.
    pub worst: f64,
    /// The PSNR through each of these pupils, in dB.
    pub psnr: Vec<f64>,
    /// The expected peak memory in bytes ([`ColorJob::cost`](super::ColorJob::cost)).
    pub bytes: u64,
    /// The mean and the worst JOD over the judged pupils of the reference. `None` if no pupil was judged.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub jod: Option<[f64; 2]>,
}

impl Trial {
    /// Makes a trial of one measurement.
    pub fn new(recipe: Settings, milliseconds: f64, psnr: Vec<f64>, bytes: u64) -> Self {
        let mean = psnr.iter().sum::<f64>() / psnr.len().max(1) as f64;
        let worst = psnr.iter().copied().fold(f64::INFINITY, f64::min);
        Self { recipe, milliseconds, times: vec![milliseconds], mean, worst, psnr, bytes, jod: None }
    }

    /// Adds another time of the same recipe, in milliseconds.
    pub fn timed(&mut self, milliseconds: f64) {
        self.times.push(milliseconds);
        let mut sorted = self.times.clone();
        sorted.sort_by(f64::total_cmp);
        let n = sorted.len();
        self.milliseconds = 0.5 * (sorted[(n - 1) / 2] + sorted[n / 2]);
    }

    /// Returns true if the numbers can come from a measurement.
    pub fn is_sound(&self) -> bool {
        self.recipe.is_sound() && self.milliseconds > 0.0 && self.milliseconds.is_finite() && self.mean.is_finite()
    }
}

/// Returns the trials that no other trial beats, by rising cost and therefore by rising quality.
///
/// A trial beats another one if it costs at most as much and is at least as good, and one of the two strictly. Among
/// equal trials, the first is returned. NaN is never on the front.
pub fn front(trials: &[Trial], cost: impl Fn(&Trial) -> f64, good: impl Fn(&Trial) -> f64) -> Vec<&Trial> {
    let mut all: Vec<&Trial> = trials.iter().filter(|t| !cost(t).is_nan() && !good(t).is_nan()).collect();
    // The best of the trials with equal cost comes first.
    all.sort_by(|a, b| cost(a).total_cmp(&cost(b)).then(good(b).total_cmp(&good(a))));
    let mut best = f64::NEG_INFINITY;
    all.retain(|t| {
        let better = good(t) > best;
        best = best.max(good(t));
        better
    });
    all
}

/// Returns the difference in mean PSNR, in dB, to the best trial that costs no more. It is 0 on the front and beyond
/// it.
pub(crate) fn short_of(trials: &[Trial], milliseconds: f64, mean: f64) -> f64 {
    let cheaper = trials.iter().filter(|t| t.milliseconds <= milliseconds).map(|t| t.mean);
    (cheaper.fold(mean, f64::max) - mean).max(0.0)
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use proptest::prelude::*;

    /// A trial of this cost and quality. The recipe distinguishes the trials.
    pub fn trial(index: usize, milliseconds: f64, mean: f64) -> Trial {
        let recipe = Settings { steps: index + 1, ..Settings::default() };
        Trial::new(recipe, milliseconds, vec![mean], 1)
    }

    fn trials() -> impl Strategy<Value = Vec<Trial>> {
        // There are few values, so that many trials are equal.
        let value = prop_oneof![Just(f64::NAN), (1..12u8).prop_map(f64::from)];
        proptest::collection::vec((value.clone(), value), 0..40)
            .prop_map(|all| all.into_iter().enumerate().map(|(i, (ms, db))| trial(i, ms, db)).collect())
    }

    fn beats(a: &Trial, b: &Trial) -> bool {
        a.milliseconds <= b.milliseconds && a.mean >= b.mean && (a.milliseconds < b.milliseconds || a.mean > b.mean)
    }

    fn numbers(all: &[&Trial]) -> Vec<(u64, u64)> {
        all.iter().map(|t| (t.milliseconds.to_bits(), t.mean.to_bits())).collect()
    }

    proptest! {
        #[test]
        fn nothing_beats_the_front_and_the_front_beats_the_rest(all in trials(), turn in 0..40usize) {
            let found = front(&all, |t| t.milliseconds, |t| t.mean);
            for t in &found {
                prop_assert!(!all.iter().any(|other| beats(other, t)));
                prop_assert!(!t.milliseconds.is_nan() && !t.mean.is_nan());
                prop_assert_eq!(short_of(&all, t.milliseconds, t.mean), 0.0);
            }
            prop_assert!(found.windows(2).all(|p| p[0].milliseconds < p[1].milliseconds && p[0].mean < p[1].mean));
            // Trials that are not on the front are beaten by one that is, or are equal to it.
            for t in all.iter().filter(|t| !t.milliseconds.is_nan() && !t.mean.is_nan()) {
                let held = found.iter().any(|f| beats(f, t) || (f.milliseconds, f.mean) == (t.milliseconds, t.mean));
                prop_assert!(held);
            }
            // The order of the trials does not matter.
            let mut other = all.clone();
            other.rotate_left(turn.min(all.len()));
            prop_assert_eq!(numbers(&found), numbers(&front(&other, |t| t.milliseconds, |t| t.mean)));
            other.reverse();
            prop_assert_eq!(numbers(&found), numbers(&front(&other, |t| t.milliseconds, |t| t.mean)));
        }
    }

    #[test]
    fn what_falls_short_falls_short_of_what_costs_no_more() {
        let all = [trial(0, 10.0, 20.0), trial(1, 20.0, 25.0), trial(2, 40.0, 26.0)];
        assert!((short_of(&all, 20.0, 24.0) - 1.0).abs() < 1e-12);
        assert!((short_of(&all, 19.0, 19.5) - 0.5).abs() < 1e-12);
        assert_eq!((short_of(&all, 5.0, 3.0), short_of(&all, 40.0, 27.0)), (0.0, 0.0));
    }

    #[test]
    fn the_time_of_several_is_their_median() {
        let mut t = trial(0, 30.0, 20.0);
        t.timed(10.0);
        assert_eq!(t.milliseconds, 20.0);
        t.timed(11.0);
        assert_eq!((t.milliseconds, t.times.len()), (11.0, 3));
    }
}
