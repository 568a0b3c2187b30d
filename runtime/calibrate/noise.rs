//! Models the camera's noise, from pictures that were taken twice.

/// Variance of a count. `shot` is the part per count above the dark level, and `read` is the rest.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Noise {
    pub(super) shot: f64,
    pub(super) read: f64,
    pub(super) dark: f64,
    /// The least variance, which is the one of rounding.
    pub(super) least: f64,
}

/// Number of classes of counts.
const CLASSES: usize = 24;

impl Noise {
    /// The assumed noise if no picture was taken twice, of a camera with ten thousand electrons at full scale.
    pub(super) fn usual(dark: f64, least: f64) -> Self {
        Self { shot: 1e-4, read: 1e-6, dark, least }
    }

    /// Fits the noise to pairs of counts of the same pixel, 1 at full scale.
    pub(super) fn of_pairs(pairs: &[[f64; 2]], dark: f64, least: f64) -> Self {
        let mut sorted: Vec<[f64; 2]> =
            pairs.iter().map(|[a, b]| [(a + b) / 2.0 - dark, (a - b) * (a - b) / 2.0]).collect();
        sorted.sort_by(|a, b| a[0].total_cmp(&b[0]));
        // A line through the classes, each weighted by the inverse square of its own variance.
        let classes = sorted.chunks(sorted.len().div_ceil(CLASSES).max(1)).map(|class| {
            let n = class.len() as f64;
            let sum = class.iter().fold([0.0; 2], |s, v| [s[0] + v[0], s[1] + v[1]]);
            [sum[0] / n, (sum[1] / n).max(least)]
        });
        let mut s = [0.0; 5];
        for [x, y] in classes {
            let w = 1.0 / (y * y);
            for (sum, term) in s.iter_mut().zip([w, w * x, w * x * x, w * y, w * x * y]) {
                *sum += term;
            }
        }
        let [n, x, xx, y, xy] = s;
        let slope = (n * xy - x * y) / (n * xx - x * x);
        let shot = if slope.is_finite() { slope.max(0.0) } else { 0.0 };
        let read = ((y - shot * x) / n).max(least);
        Self { shot, read, dark, least }
    }

    pub(super) fn variance(&self, count: f64) -> f64 {
        (self.shot * (count - self.dark).max(0.0) + self.read).max(self.least)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use eyebox_solve::solve::SplitMix;

    #[test]
    fn shot_noise_and_the_rest_are_told_apart() {
        let mut random = SplitMix(5);
        let mut normal = || (0..12).map(|_| random.unit()).sum::<f64>() - 6.0;
        let truth = Noise { shot: 2e-4, read: 4e-6, dark: 0.02, least: 0.0 };
        let pair = |i: usize| {
            let count = 0.02 + 0.8 * (i as f64 / 20_000.0).powi(3);
            [0; 2].map(|_: i32| count + truth.variance(count).sqrt() * normal())
        };
        let pairs: Vec<_> = (0..20_000).map(pair).collect();
        let noise = Noise::of_pairs(&pairs, 0.02, 1e-9);
        assert!(
            (noise.shot / truth.shot - 1.0).abs() < 0.1 && (noise.read / truth.read - 1.0).abs() < 0.2,
            "{noise:?}"
        );
    }
}
