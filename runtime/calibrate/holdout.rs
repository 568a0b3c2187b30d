//! Computes the share that a model leaves of pictures that it was not fitted to.

use super::classified::Sorted;
use super::fit::{mean_square, variance_of};
use super::parameters::Parameters;

/// Shares of the variance of pictures about their means.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Holdout {
    pub(super) left: f64,
    pub(super) noise: f64,
}

/// The share that a model leaves of the pictures that were taken twice, which no fit uses.
pub(super) fn holdout(sorted: &Sorted, at: &Parameters, subpixels: usize) -> Holdout {
    let which: Vec<usize> = sorted.pairs.iter().map(|pair| pair[0]).collect();
    shares(sorted, at, subpixels, &which, |i| {
        let [first, second] = sorted.pairs[i].map(|v| &sorted.pictures.views[v]);
        let (scale, dark) = (first.exposure_ms / second.exposure_ms, sorted.pictures.dark);
        let apart = |(a, b): (&f64, &f64)| a - dark - (b - dark) * scale;
        let noise: Vec<f64> = first.counts.iter().zip(&second.counts).map(apart).collect();
        mean_square(&noise) / 2.0
    })
}

/// The shares that judge a model. They are of the pictures that were taken twice. If there are none, they are of the
/// `fitted` pictures, with the noise of an ordinary camera.
pub(super) fn judged(sorted: &Sorted, at: &Parameters, fitted: &[usize], subpixels: usize) -> Holdout {
    if !sorted.pairs.is_empty() {
        return holdout(sorted, at, subpixels);
    }
    shares(sorted, at, subpixels, fitted, |i| {
        let variance = &sorted.pictures.views[fitted[i]].variance;
        variance.iter().sum::<f64>() / variance.len() as f64
    })
}

/// The shares of these views. `noise` returns the variance of the camera's noise in the view at an index of `which`.
fn shares(
    Sorted { pictures, .. }: &Sorted,
    at: &Parameters,
    subpixels: usize,
    which: &[usize],
    noise: impl Fn(usize) -> f64,
) -> Holdout {
    let mut sums = [0.0; 3];
    for (i, (v, seen)) in which.iter().zip(&pictures.see(at, subpixels, which, &[])).enumerate() {
        sums[0] += mean_square(&pictures.residuals(*v, seen));
        sums[1] += noise(i);
        sums[2] += variance_of(&pictures.views[*v].counts);
    }
    Holdout { left: sums[0] / sums[2], noise: sums[1] / sums[2] }
}
