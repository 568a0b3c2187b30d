//! What a model leaves of pictures that it was not fitted to.

use super::fit::{Exposure, Pictures};
use super::parameters::Parameters;
use super::sorted::Sorted;

/// Shares of the variance of pictures that were not fitted.
pub(super) struct Unseen {
    pub(super) left: f64,
    pub(super) noise: f64,
}

/// Gain and dark level for a model that was not fitted to these pictures.
pub(super) fn exposed(pictures: &Pictures, at: &Parameters, which: &[usize], subpixels: usize) -> Exposure {
    pictures.exposure(which, &pictures.see(at, subpixels, which, &[]))
}

/// Squares that a model leaves of pictures that were taken twice, as shares of their variance about each picture's mean.
pub(super) fn unseen(sorted: &Sorted, at: &Parameters, exposure: Exposure, subpixels: usize) -> Unseen {
    let pictures = &sorted.pictures;
    let which: Vec<usize> = sorted.pairs.iter().flatten().copied().collect();
    let seen = pictures.see(at, subpixels, &which, &[]);
    let mut sums = [0.0; 3];
    for (pair, seen) in sorted.pairs.iter().zip(seen.chunks_exact(2)) {
        let counts = pair.map(|v| &pictures.views[v].counts);
        let scale = pictures.views[pair[0]].exposure_ms / pictures.views[pair[1]].exposure_ms;
        let noise: f64 = counts[0]
            .iter()
            .zip(counts[1])
            .map(|(a, b)| (a - exposure.dark - (b - exposure.dark) * scale).powi(2) / 2.0)
            .sum();
        let mean = counts[0].iter().sum::<f64>() / counts[0].len() as f64;
        let variance: f64 = counts[0].iter().map(|c| (c - mean).powi(2)).sum();
        let left: f64 = pictures.residuals(pair[0], &seen[0], exposure).iter().map(|r| r * r).sum();
        sums = [sums[0] + left, sums[1] + noise, sums[2] + variance];
    }
    Unseen { left: sums[0] / sums[2], noise: sums[1] / sums[2] }
}

/// Squares that a fit leaves of the pictures that it was fitted to, and the camera's noise, as shares of their variance about each
/// picture's mean.
pub(super) fn fitted(
    pictures: &Pictures,
    at: &Parameters,
    exposure: Exposure,
    which: &[usize],
    subpixels: usize,
) -> Unseen {
    let seen = pictures.see(at, subpixels, which, &[]);
    let mut sums = [0.0; 3];
    for (v, seen) in which.iter().zip(&seen) {
        let view = &pictures.views[*v];
        let mean = view.counts.iter().sum::<f64>() / view.counts.len() as f64;
        let left: f64 = pictures.residuals(*v, seen, exposure).iter().map(|r| r * r).sum();
        let variance: f64 = view.counts.iter().map(|c| (c - mean).powi(2)).sum();
        sums = [sums[0] + left, sums[1] + view.variance.iter().sum::<f64>(), sums[2] + variance];
    }
    Unseen { left: sums[0] / sums[2], noise: sums[1] / sums[2] }
}
