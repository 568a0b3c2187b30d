//! Fits the powers of one color's laser per sub-frame at fixed phases (OPTICS 13).
//!
//! The intensity that an eye sees is linear in the powers, so the best ones solve a least-squares problem of a few
//! unknowns.

use crate::optics::with_mean_of_one;

/// The squared difference over pupils and pixels as a function of the powers, `p' A p - 2 b' p + c`.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct PowerFit {
    frames: usize,
    /// A, (sub-frame, sub-frame), then b and c, as sums of each pupil's means.
    gram: Vec<f64>,
    with_target: Vec<f64>,
    of_target: f64,
    pupils: f64,
}

/// Number of steps towards the best powers. Since the unknowns are few, they end within a thousandth of the mean.
const STEPS: usize = 400;

impl PowerFit {
    /// Starts with no pupil.
    pub(crate) fn new(frames: usize) -> Self {
        Self { frames, gram: vec![0.0; frames * frames], with_target: vec![0.0; frames], of_target: 0.0, pupils: 0.0 }
    }

    /// Adds a pupil with its target.
    ///
    /// The `fields` belong to all sub-frames at power 1 (sub-frame, pixel). The `gain` converts their squares to light
    /// and includes the exposure.
    pub(crate) fn add(&mut self, fields: &[[f32; 2]], gain: f64, target: &[f32]) {
        let count = target.len();
        let light = |v: &[f32; 2]| gain * (f64::from(v[0]) * f64::from(v[0]) + f64::from(v[1]) * f64::from(v[1]));
        let seen: Vec<Vec<f64>> =
            fields.chunks_exact(count).take(self.frames).map(|frame| frame.iter().map(light).collect()).collect();
        let mean = |a: &[f64], b: &mut dyn Iterator<Item = f64>| {
            a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>() / count as f64
        };
        for f in 0..self.frames {
            for g in 0..=f {
                let product = mean(&seen[f], &mut seen[g].iter().copied());
                self.gram[f * self.frames + g] += product;
                if g < f {
                    self.gram[g * self.frames + f] += product;
                }
            }
            self.with_target[f] += mean(&seen[f], &mut target.iter().map(|t| f64::from(*t)));
        }
        self.of_target += target.iter().map(|t| f64::from(*t).powi(2)).sum::<f64>() / count as f64;
        self.pupils += 1.0;
    }

    /// Returns the derivative of the mean squared difference over pupils and pixels with respect to the powers.
    pub(crate) fn gradient(&self, powers: &[f64]) -> Vec<f64> {
        let of = |row: &[f64]| row.iter().zip(powers).map(|(a, p)| a * p).sum::<f64>();
        let rows = self.gram.chunks_exact(self.frames).zip(&self.with_target);
        rows.map(|(row, b)| 2.0 * (of(row) - b) / self.pupils.max(1.0)).collect()
    }

    /// Returns the best powers from 0 to `most` with a mean of 1, starting at `from`. It uses projected gradients with
    /// Nesterov's momentum (FISTA, Beck and Teboulle 2009).
    pub(crate) fn best(&self, from: &[f64], most: f64) -> Vec<f64> {
        let largest = self.gram.chunks_exact(self.frames).map(|row| row.iter().map(|a| a.abs()).sum::<f64>());
        let steep = 2.0 * largest.fold(0.0, f64::max) / self.pupils.max(1.0);
        if !(steep > 0.0 && steep.is_finite()) {
            return from.to_vec();
        }
        let (mut powers, mut ahead, mut t) = (from.to_vec(), from.to_vec(), 1.0f64);
        for _ in 0..STEPS {
            let down = self.gradient(&ahead);
            let next = within(&ahead.iter().zip(&down).map(|(p, d)| p - d / steep).collect::<Vec<_>>(), most);
            let t_next = 0.5 * (1.0 + (1.0 + 4.0 * t * t).sqrt());
            let momentum = (t - 1.0) / t_next;
            ahead = next.iter().zip(&powers).map(|(n, p)| n + momentum * (n - p)).collect();
            (powers, t) = (next, t_next);
        }
        powers
    }
}

/// Returns the nearest powers from 0 to `most` with a mean of 1. These are all powers minus one number, clipped at both
/// ends.
pub(crate) fn within(powers: &[f64], most: f64) -> Vec<f64> {
    let most = most.max(1.0);
    let lowest = powers.iter().copied().fold(f64::INFINITY, f64::min) - most;
    let highest = powers.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let (mut low, mut high) = (lowest, highest);
    let cut = |by: f64| powers.iter().map(|p| (p - by).clamp(0.0, most)).collect::<Vec<_>>();
    // The mean falls from `most` to 0 with a larger number.
    for _ in 0..80 {
        let middle = 0.5 * (low + high);
        let mean = cut(middle).iter().sum::<f64>() / powers.len().max(1) as f64;
        if mean > 1.0 { low = middle } else { high = middle }
    }
    with_mean_of_one(cut(0.5 * (low + high)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    impl PowerFit {
        /// Returns the mean squared difference over pupils and pixels, whose derivative is
        /// [`gradient`](Self::gradient).
        pub(crate) fn loss(&self, powers: &[f64]) -> f64 {
            let of = |row: &[f64]| row.iter().zip(powers).map(|(a, p)| a * p).sum::<f64>();
            let rows = self.gram.chunks_exact(self.frames).zip(&self.with_target).zip(powers);
            let sum = rows.map(|((row, b), p)| p * (of(row) - 2.0 * b)).sum::<f64>();
            (sum + self.of_target) / self.pupils.max(1.0)
        }
    }

    fn noise(count: usize, seed: u64) -> Vec<f32> {
        let mix = |i: u64| (i + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15).rotate_left(29).wrapping_mul(seed | 0x2545_f491);
        (0..count as u64).map(|i| (mix(i + (seed << 32)) >> 40) as f32 / (1 << 24) as f32).collect()
    }

    fn fit(frames: usize, seed: u64, target: impl Fn(&[Vec<f64>]) -> Vec<f32>) -> PowerFit {
        let fields: Vec<[f32; 2]> =
            noise(2 * frames * 50, seed).chunks_exact(2).map(|v| [v[0] - 0.5, v[1] - 0.5]).collect();
        let light = |v: &[f32; 2]| 0.7 * (f64::from(v[0]).powi(2) + f64::from(v[1]).powi(2));
        let seen: Vec<Vec<f64>> = fields.chunks_exact(50).map(|f| f.iter().map(light).collect()).collect();
        let mut fit = PowerFit::new(frames);
        fit.add(&fields, 0.7, &target(&seen));
        fit
    }

    proptest! {
        /// The derivative agrees with finite differences. After a step powers are from 0 to `most` with a mean of 1,
        /// and no worse.
        #[test]
        fn gradients_are_derivatives_and_steps_stay_inside(frames in 1usize..9, seed in 0u64..500, most in 1.0f64..4.0) {
            let fit = fit(frames, seed, |_| noise(50, seed + 7));
            let powers: Vec<f64> = noise(frames, seed + 1).iter().map(|p| 0.2 + 1.6 * f64::from(*p)).collect();
            let powers = within(&powers, most);
            for (f, slope) in fit.gradient(&powers).into_iter().enumerate() {
                let moved = |by: f64| { let mut p = powers.clone(); p[f] += by; fit.loss(&p) };
                let numeric = (moved(1e-4) - moved(-1e-4)) / 2e-4;
                prop_assert!((numeric - slope).abs() < 1e-6 * slope.abs().max(1e-3), "{numeric} {slope}");
            }
            let best = fit.best(&powers, most);
            prop_assert!(best.iter().all(|p| (-1e-12..=most + 1e-6).contains(p)), "{best:?}");
            prop_assert!((best.iter().sum::<f64>() / frames as f64 - 1.0).abs() < 1e-9);
            prop_assert!(fit.loss(&best) <= fit.loss(&powers) + 1e-12);
        }
    }

    #[test]
    fn the_powers_behind_a_picture_are_found() {
        let true_powers = [0.0, 2.5, 0.5, 1.0];
        let target = |seen: &[Vec<f64>]| {
            (0..50).map(|i| (0..4).map(|f| true_powers[f] * seen[f][i]).sum::<f64>() as f32).collect()
        };
        let found = fit(4, 3, target).best(&[1.0; 4], 3.0);
        assert!(found.iter().zip(true_powers).all(|(f, t)| (f - t).abs() < 1e-2), "{found:?}");
    }
}
