//! The share that a model leaves of pictures that it was not fitted to.

use super::classified::Sorted;
use super::fit::{mean_square, variance_of};
use super::parameters::Parameters;
use super::seen::Prediction;
use super::views::Pictures;

/// Shares of the variance of pictures about their means.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Unseen {
    pub(super) left: f64,
    pub(super) noise: f64,
}

/// The share that a model leaves of the pictures that were taken twice.
pub(super) fn unseen(sorted: &Sorted, at: &Parameters, subpixels: usize) -> Unseen {
    let pictures = &sorted.pictures;
    let which: Vec<usize> = sorted.pairs.iter().map(|pair| pair[0]).collect();
    let seen = pictures.see(at, subpixels, &which, &[]);
    let mut sums = [0.0; 3];
    for (pair, seen) in sorted.pairs.iter().zip(&seen) {
        let [first, second] = pair.map(|v| &pictures.views[v]);
        let scale = first.exposure_ms / second.exposure_ms;
        let dark = pictures.dark;
        let apart = |(a, b): (&f64, &f64)| a - dark - (b - dark) * scale;
        let noise: Vec<f64> = first.counts.iter().zip(&second.counts).map(apart).collect();
        sums[1] += mean_square(&noise) / 2.0;
        add_left(pictures, pair[0], seen, &mut sums);
    }
    Unseen { left: sums[0] / sums[2], noise: sums[1] / sums[2] }
}

/// What judges a model: the pictures that were taken twice, or those that were `fitted` if none was.
pub(super) fn judged(sorted: &Sorted, at: &Parameters, fitted: &[usize], subpixels: usize) -> Unseen {
    match sorted.pairs.is_empty() {
        true => of_fitted(&sorted.pictures, at, fitted, subpixels),
        false => unseen(sorted, at, subpixels),
    }
}

/// The share that a fit leaves of the pictures that it was fitted to, with the noise of an ordinary camera.
fn of_fitted(pictures: &Pictures, at: &Parameters, which: &[usize], subpixels: usize) -> Unseen {
    let seen = pictures.see(at, subpixels, which, &[]);
    let mut sums = [0.0; 3];
    for (v, seen) in which.iter().zip(&seen) {
        let variance = &pictures.views[*v].variance;
        sums[1] += variance.iter().sum::<f64>() / variance.len() as f64;
        add_left(pictures, *v, seen, &mut sums);
    }
    Unseen { left: sums[0] / sums[2], noise: sums[1] / sums[2] }
}

/// Adds the squares that are left of a view, and its variance.
fn add_left(pictures: &Pictures, view: usize, seen: &Prediction, sums: &mut [f64; 3]) {
    sums[0] += mean_square(&pictures.residuals(view, seen));
    sums[2] += variance_of(&pictures.views[view].counts);
}
