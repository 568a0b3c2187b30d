//! Chooses the trials to recommend, and the trial that fits a deadline.

use super::{Quality, Trial, front};
use serde::{Deserialize, Serialize};

/// The largest difference of balanced from accurate, in dB.
pub(crate) const BALANCED_DB: f64 = 0.5;
/// The largest time of balanced, as a share of accurate's time.
pub(crate) const BALANCED_SHARE: f64 = 1.0 / 5.0;
/// The largest time of fast, as a share of accurate's time.
pub(crate) const FAST_SHARE: f64 = 1.0 / 20.0;
/// The largest difference of mean PSNRs that count as equal, in dB. Then the worst pupil decides.
const ALIKE_DB: f64 = 0.01;

/// A trial that is recommended.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Recommended {
    /// The quality for which it is recommended.
    pub quality: Quality,
    /// The trial with its measurements.
    pub trial: Trial,
    /// True if the trial meets the conditions of its name. If no trial meets them, this is the nearest one.
    pub met: bool,
}

/// Recommends fast, balanced and accurate among trials. Returns `None` without trials.
///
/// Accurate has the best mean of the front. Among equal means, the worst pupil decides. Balanced is the cheapest trial
/// within half a decibel of accurate that takes at most a fifth of its time. Fast is the best trial that takes at most
/// a twentieth.
pub fn recommend(trials: &[Trial]) -> Option<[Recommended; 3]> {
    let front = front(trials, |t| t.milliseconds, |t| t.mean);
    let best = front.last()?.mean;
    let alike = |t: &&&Trial| t.mean >= best - ALIKE_DB;
    let accurate = *front.iter().filter(alike).max_by(|a, b| a.worst.total_cmp(&b.worst))?;
    let within = |share: f64| move |t: &&&Trial| t.milliseconds <= share * accurate.milliseconds;
    let near = |t: &&&Trial| t.mean >= accurate.mean - BALANCED_DB;
    // The front rises in quality with rising time, so the first one is the cheapest and the last one the best.
    let balanced = front.iter().filter(within(BALANCED_SHARE)).find(near);
    let fast = front.iter().rfind(within(FAST_SHARE));
    let or_nearest = |quality, found: Option<&&Trial>, nearest: &Trial| Recommended {
        quality,
        met: found.is_some(),
        trial: found.map_or(nearest, |t| t).clone(),
    };
    let quickest = front[0];
    Some([
        or_nearest(Quality::Fast, fast, quickest),
        or_nearest(Quality::Balanced, balanced, front.iter().rfind(within(BALANCED_SHARE)).unwrap_or(&quickest)),
        Recommended { quality: Quality::Accurate, trial: accurate.clone(), met: true },
    ])
}

/// Returns the best trial that takes at most this number of milliseconds, if each takes `scale` times its measured
/// time.
pub fn within(trials: &[Trial], milliseconds: f64, scale: f64) -> Option<&Trial> {
    let fits = |t: &&Trial| t.milliseconds * scale <= milliseconds;
    front(trials, |t| t.milliseconds, |t| t.mean).into_iter().rfind(fits)
}

#[cfg(test)]
mod tests {
    use super::super::front::tests::trial;
    use super::*;

    #[test]
    fn the_three_are_what_their_names_promise() {
        let all = [
            trial(0, 10_000.0, 30.60),
            trial(1, 9_000.0, 30.30),
            trial(2, 2_000.0, 30.20),
            trial(3, 1_500.0, 30.11),
            trial(4, 1_400.0, 30.09),
            trial(5, 500.0, 28.00),
            trial(6, 400.0, 28.50),
            trial(7, 100.0, 25.00),
        ];
        let [fast, balanced, accurate] = recommend(&all).unwrap();
        assert_eq!([fast.trial.mean, balanced.trial.mean, accurate.trial.mean], [28.5, 30.11, 30.6]);
        assert!(fast.met && balanced.met && accurate.met);
        assert_eq!([fast.quality, balanced.quality, accurate.quality], Quality::ALL);
        // The order of the trials does not matter.
        let mut other = all.to_vec();
        other.reverse();
        assert_eq!(recommend(&other).unwrap(), recommend(&all).unwrap());
    }

    #[test]
    fn alike_means_leave_it_to_the_worst() {
        let with = |i, ms, mean, worst| Trial { worst, ..trial(i, ms, mean) };
        let all = [with(0, 50.0, 30.000, 21.0), with(1, 100.0, 30.004, 20.0), with(2, 10.0, 29.9, 29.0)];
        assert_eq!(recommend(&all).unwrap()[2].trial.worst, 21.0);
    }

    #[test]
    fn what_is_not_there_is_not_promised() {
        assert_eq!(recommend(&[]), None);
        let [fast, balanced, accurate] = recommend(&[trial(0, 10.0, 20.0), trial(1, 20.0, 30.0)]).unwrap();
        assert!(!fast.met && !balanced.met && accurate.met);
        assert_eq!((fast.trial.mean, balanced.trial.mean, accurate.trial.mean), (20.0, 20.0, 30.0));
        // The second trial is in time, but too far from accurate.
        let [_, balanced, _] = recommend(&[trial(0, 1.0, 20.0), trial(1, 2.0, 29.0), trial(2, 20.0, 30.0)]).unwrap();
        assert!(!balanced.met && balanced.trial.mean == 29.0);
    }

    #[test]
    fn a_deadline_takes_the_best_that_fits() {
        let all = [trial(0, 10.0, 20.0), trial(1, 20.0, 25.0), trial(2, 18.0, 19.0), trial(3, 40.0, 26.0)];
        assert_eq!(within(&all, 39.0, 1.0).unwrap().mean, 25.0);
        assert_eq!(within(&all, 39.0, 2.0).unwrap().mean, 20.0);
        assert_eq!(within(&all, 40.0, 1.0).unwrap().mean, 26.0);
        assert_eq!(within(&all, 9.9, 1.0), None);
    }
}
