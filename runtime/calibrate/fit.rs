//! Fits the numbers by least squares, with predictions and slopes of all pictures and Levenberg-Marquardt steps.
//!
//! Each picture has a gain and an offset of its own, and both are solved for inside (Golub and Pereyra 1973). They
//! absorb the drift of the laser and veiling light, and cost two numbers of a picture's thousands. A common gain turns
//! 3 % of drift into 3 % of error in everything.

use super::error::CalibrateError;
use super::parameters::{Parameter, Parameters};
use super::seen::Prediction;
use super::views::{Pictures, View};
use eyebox_base::files::asked_to_end;
use eyebox_base::reason;
use eyebox_optics::linear::{inverse, solve};
use rayon::prelude::*;
use std::sync::atomic::Ordering;

/// Gain per millisecond, and offset, of one picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Exposure {
    pub(super) gain: f64,
    pub(super) dark: f64,
}

#[derive(Debug, Clone)]
pub(super) struct Fit {
    pub(super) at: Parameters,
    pub(super) free: Vec<Parameter>,
    /// Mean of the squared residuals, in units of the noise.
    pub(super) squares: f64,
    pub(super) covariance: Vec<Vec<f64>>,
}

impl Fit {
    /// Standard error of a free parameter, if it was fitted.
    pub(super) fn error(&self, parameter: Parameter) -> Option<f64> {
        let at = self.free.iter().position(|p| *p == parameter)?;
        Some(self.covariance[at][at].sqrt())
    }

    /// Adds the iris's numbers to the free ones. `errors` are the standard errors of x, y (mm) and scale.
    pub(super) fn with_iris(mut self, errors: [f64; 3]) -> Self {
        let n = self.free.len() + 3;
        self.covariance.iter_mut().for_each(|row| row.resize(n, 0.0));
        for (i, error) in errors.into_iter().enumerate() {
            let mut row = vec![0.0; n];
            row[n - 3 + i] = error * error;
            self.covariance.push(row);
            self.free.push(Parameter::Iris(i));
        }
        self
    }

    /// Pairs of free parameters that the pictures cannot separate, with their correlations.
    pub(super) fn confused(&self) -> Vec<(Parameter, Parameter, f64)> {
        let mut pairs = Vec::new();
        for i in 0..self.free.len() {
            for j in 0..i {
                let c = self.covariance[i][j] / (self.covariance[i][i] * self.covariance[j][j]).sqrt();
                if c.abs() > 0.95 {
                    pairs.push((self.free[j], self.free[i], c));
                }
            }
        }
        pairs
    }
}

#[derive(Debug, Clone, Copy)]
pub(super) struct Effort {
    /// Sub-pixels along an axis for predictions, and for slopes.
    pub(super) subpixels: usize,
    pub(super) slopes: usize,
    pub(super) rounds: usize,
    /// A round that gains less than this share is the last one.
    pub(super) enough: f64,
}

/// Effort for random patterns. One sub-pixel is enough for them until lag is fitted.
pub(super) const COARSE: Effort = Effort { subpixels: 1, slopes: 1, rounds: 5, enough: 0.02 };

/// Slopes are computed again if the share of the predicted gain that a step reaches is outside this range.
const KEPT: std::ops::Range<f64> = 0.5..1.3;
/// Number of times that a failed step is damped before a fit ends.
const TRIES: usize = 6;
/// A residual of more than this many times the usual one counts linearly beyond it (Huber).
const OUTLIER: f64 = 3.0;
/// No step is longer than this many times the expected spread of a number.
const LONGEST_STEP: f64 = 1.5;
/// Weight of the camera's dark level as a prior of the offset, share of a picture's weight. It decides if a picture is
/// almost even, because such a picture cannot separate its gain from its offset.
const DARK_WEIGHT: f64 = 1e-4;

impl Pictures {
    /// Variance of these views about their means, in units of the variance of the camera's noise.
    pub(super) fn signal(&self, which: &[usize]) -> f64 {
        let of_view = |v: &usize| {
            let View { counts, variance, .. } = &self.views[*v];
            [variance_of(counts) * counts.len() as f64, variance.iter().sum()]
        };
        let [all, noise] = which.iter().map(of_view).fold([0.0; 2], |s, v| [s[0] + v[0], s[1] + v[1]]);
        all / noise
    }

    /// Gain and offset of a view that fit best.
    pub(super) fn exposure(&self, view: usize, seen: &Prediction) -> Exposure {
        let view = &self.views[view];
        let mut sums = [0.0; 5];
        for ((i, c), v) in seen.intensity.iter().zip(&view.counts).zip(&view.variance) {
            let (light, w) = (i * view.exposure_ms, 1.0 / v);
            for (sum, term) in sums.iter_mut().zip([w, w * light, w * light * light, w * c, w * light * c]) {
                *sum += term;
            }
        }
        let [mut n, x, xx, mut c, xc] = sums;
        c += DARK_WEIGHT * n * self.dark;
        n *= 1.0 + DARK_WEIGHT;
        let gain = (n * xc - x * c) / (n * xx - x * x);
        Exposure { gain, dark: (c - gain * x) / n }
    }

    /// Residuals of a view, counts, at the view's best exposure.
    pub(super) fn residuals(&self, view: usize, seen: &Prediction) -> Vec<f64> {
        let exposure = self.exposure(view, seen);
        let (view, gain) = (&self.views[view], exposure.gain * self.views[view].exposure_ms);
        seen.intensity.iter().zip(&view.counts).map(|(i, c)| gain * i + exposure.dark - c).collect()
    }

    /// The share of a view's variance that the prediction leaves.
    pub(super) fn share_left(&self, view: usize, seen: &Prediction) -> f64 {
        mean_square(&self.residuals(view, seen)) / self.views[view].signal
    }

    /// The share of each view's variance that is left, and the mean of the squared residuals in units of the noise.
    pub(super) fn left(&self, which: &[usize], seen: &[Prediction]) -> Vec<[f64; 2]> {
        let of = |(v, seen): (&usize, &Prediction)| {
            let (view, residuals) = (&self.views[*v], self.residuals(*v, seen));
            let n = residuals.len() as f64;
            let squares: f64 = residuals.iter().zip(&view.variance).map(|(r, v)| r * r / v).sum();
            [mean_square(&residuals) / view.signal, squares / n]
        };
        which.par_iter().zip(seen).map(of).collect()
    }

    /// The share of the views' variance that a model leaves beyond the camera's noise. Each view has the same weight.
    fn misfit(&self, which: &[usize], residuals: &[Vec<f64>]) -> f64 {
        let of = |(v, residuals): (&usize, &Vec<f64>)| {
            let view = &self.views[*v];
            let noise = view.variance.iter().sum::<f64>() / view.variance.len() as f64;
            ((mean_square(residuals) - noise) / view.signal).max(0.0)
        };
        which.iter().zip(residuals).map(of).sum::<f64>() / which.len().max(1) as f64
    }

    /// Squares of the residuals in units of the noise and of a misfit of this share, with large ones damped. It returns
    /// their sum.
    fn robust(&self, which: &[usize], residuals: &[Vec<f64>], misfit: f64) -> f64 {
        let of = |(v, residuals): (&usize, &Vec<f64>)| {
            let view = &self.views[*v];
            let more = misfit * view.signal;
            residuals.iter().zip(&view.variance).map(|(r, v)| huber(r * r / (v + more))).sum::<f64>()
        };
        which.iter().zip(residuals).map(of).sum()
    }

    fn all_residuals(&self, which: &[usize], seen: &[Prediction]) -> Vec<Vec<f64>> {
        which.par_iter().zip(seen).map(|(v, seen)| self.residuals(*v, seen)).collect()
    }

    /// Sum of the squared residuals of these views, in units of the camera's noise.
    pub(super) fn squares(&self, which: &[usize], seen: &[Prediction]) -> f64 {
        let of = |(v, residuals): (&usize, Vec<f64>)| {
            residuals.iter().zip(&self.views[*v].variance).map(|(r, v)| r * r / v).sum::<f64>()
        };
        which.iter().zip(self.all_residuals(which, seen)).map(of).sum()
    }

    /// Fits the free parameters to these views, from `start`. The prior `known` holds the parameters that the pictures
    /// hardly determine. Slopes are kept as long as the steps gain what the slopes predict.
    pub(super) fn fit(
        &self,
        known: &Parameters,
        start: &Parameters,
        free: &[Parameter],
        which: &[usize],
        effort: Effort,
        observe: &mut dyn FnMut(f64),
    ) -> Result<Fit, CalibrateError> {
        if which.is_empty() {
            return Err(reason!("nothing-to-fit", "no pictures to fit. Take pictures of patterns").into());
        }
        let count: usize = which.iter().map(|v| self.views[*v].counts.len()).sum();
        let (mut at, mut damping) = (start.clone(), 1e-3);
        let mut seen = self.see(&at, effort.subpixels, which, &[]);
        let (mut slopes, mut fresh) = (self.see(&at, effort.slopes, which, free), true);
        for round in 0..effort.rounds.max(1) {
            if asked_to_end().load(Ordering::SeqCst) {
                return Err(CalibrateError::Stopped);
            }
            observe(round as f64 / effort.rounds as f64);
            let residuals = self.all_residuals(which, &seen);
            let misfit = self.misfit(which, &residuals);
            let before = self.robust(which, &residuals, misfit);
            let (normal, right) = self.normal(which, [&seen, &slopes], &residuals, misfit);
            let (normal, right) = with_priors(normal, right, known, &at, free);
            let tries = if fresh { TRIES } else { 2 };
            let mut step_taken = None;
            for _ in 0..tries {
                let mut damped = normal.clone();
                (0..damped.len()).for_each(|i| damped[i][i] *= 1.0 + damping);
                let Some(mut step) = solve(&damped, &right) else {
                    damping *= 10.0;
                    continue;
                };
                for (step, p) in step.iter_mut().zip(free) {
                    *step = step.clamp(-LONGEST_STEP * p.usual(), LONGEST_STEP * p.usual());
                }
                let trial = at.stepped(free, &step);
                let seen = self.see(&trial, effort.subpixels, which, &[]);
                let after = self.robust(which, &self.all_residuals(which, &seen), misfit);
                let prior_change = prior(known, &trial, free) - prior(known, &at, free);
                if after + prior_change < before {
                    damping = (damping * 0.1).max(1e-12);
                    let gained = before - after - prior_change;
                    step_taken =
                        Some((trial, seen, (before - after) / before, gained / promised(&normal, &right, &step)));
                    break;
                }
                damping *= 20.0;
            }
            let (gain, kept) = step_taken.as_ref().map_or((0.0, 0.0), |(.., gain, kept)| (*gain, *kept));
            tracing::debug!("round {round}: {misfit:.5} of the variance, gained {gain:.2e}, {kept:.2} of predicted");
            let stuck = step_taken.is_none();
            if let Some((trial, now, ..)) = step_taken {
                (at, seen) = (trial, now);
            }
            if gain < effort.enough && (fresh || KEPT.contains(&kept)) || round + 1 == effort.rounds {
                break;
            }
            fresh = stuck || !KEPT.contains(&kept);
            if fresh {
                slopes = self.see(&at, effort.slopes, which, free);
            }
        }
        let squares = self.squares(which, &seen) / count as f64;
        let covariance = self.covariance(which, [&seen, &slopes], &at, free).ok_or_else(|| {
            CalibrateError::Pictures(reason!(
                "not-told-apart",
                "the pictures do not separate the model's numbers: take more pictures"
            ))
        })?;
        Ok(Fit { at, free: free.to_vec(), squares, covariance })
    }

    /// Covariance of the free parameters, from the predictions at `at` and the slopes there.
    fn covariance(
        &self,
        which: &[usize],
        [seen, slopes]: [&[Prediction]; 2],
        at: &Parameters,
        free: &[Parameter],
    ) -> Option<Vec<Vec<f64>>> {
        let residuals = self.all_residuals(which, seen);
        let misfit = self.misfit(which, &residuals);
        let count: usize = residuals.iter().map(Vec::len).sum();
        let scale = (self.robust(which, &residuals, misfit) / count as f64).max(1.0);
        let (normal, _) = self.normal(which, [seen, slopes], &residuals, misfit);
        let (normal, _) = with_priors(normal, vec![0.0; free.len()], at, at, free);
        Some(scaled(inverse(&normal)?, scale))
    }

    /// The same fit with errors that include the `omitted` numbers. These stayed at the values of the display's file
    /// because they do not show. They may be wrong by as much as the pictures allow, and so may the numbers that were
    /// fitted with them.
    pub(super) fn with_omitted(&self, fit: Fit, omitted: &[Parameter], which: &[usize], effort: Effort) -> Fit {
        let apart = |p: &&Parameter| !matches!(p, Parameter::Iris(_));
        let fitted: Vec<Parameter> = fit.free.iter().filter(apart).copied().collect();
        let all: Vec<Parameter> = fitted.iter().chain(omitted.iter().filter(apart)).copied().collect();
        if all.len() == fitted.len() {
            return fit;
        }
        let seen = self.see(&fit.at, effort.subpixels, which, &[]);
        let slopes = self.see(&fit.at, effort.slopes, which, &all);
        let Some(covariance) = self.covariance(which, [&seen, &slopes], &fit.at, &all) else {
            return fit;
        };
        let mut fit = fit;
        for (i, a) in fitted.iter().enumerate() {
            for (j, b) in fitted.iter().enumerate() {
                let at = [a, b].map(|p| fit.free.iter().position(|q| q == p));
                if let [Some(row), Some(column)] = at {
                    fit.covariance[row][column] = covariance[i][j];
                }
            }
        }
        fit
    }

    /// The normal equations, with each view's gain and offset eliminated.
    fn normal(
        &self,
        which: &[usize],
        [seen, slopes]: [&[Prediction]; 2],
        residuals: &[Vec<f64>],
        misfit: f64,
    ) -> (Vec<Vec<f64>>, Vec<f64>) {
        let n = slopes.first().map_or(0, |s| s.slopes.len()) + 2;
        let part = |(((v, seen), slopes), residuals): (((&usize, &Prediction), &Prediction), &Vec<f64>)| {
            let view = &self.views[*v];
            let exposure = self.exposure(*v, seen);
            let gain = exposure.gain * view.exposure_ms;
            let more = misfit * view.signal;
            let weights: Vec<f64> = residuals
                .iter()
                .zip(&view.variance)
                .map(|(r, v)| (OUTLIER / (r * r / (v + more)).sqrt()).min(1.0) / (v + more))
                .collect();
            let mut columns: Vec<Vec<f64>> =
                slopes.slopes.iter().map(|s| s.iter().map(|v| v * gain).collect()).collect();
            columns.push(seen.intensity.iter().map(|i| i * view.exposure_ms).collect());
            columns.push(vec![1.0; residuals.len()]);
            let weighted: Vec<Vec<f64>> =
                columns.iter().map(|c| c.iter().zip(&weights).map(|(v, w)| v * w).collect()).collect();
            let mut normal = vec![vec![0.0; n]; n];
            for i in 0..n {
                for j in 0..=i {
                    normal[i][j] = dot(&weighted[i], &columns[j]);
                    normal[j][i] = normal[i][j];
                }
            }
            let mut right: Vec<f64> = weighted.iter().map(|w| -dot(w, residuals)).collect();
            let weight = DARK_WEIGHT * weights.iter().sum::<f64>();
            normal[n - 1][n - 1] += weight;
            right[n - 1] -= weight * (exposure.dark - self.dark);
            eliminate_last_two(&mut normal, &mut right);
            (normal, right)
        };
        // The sum runs in the order of the views, so that it does not depend on the threads.
        let parts: Vec<_> = which.par_iter().zip(seen).zip(slopes).zip(residuals).map(part).collect();
        let (mut normal, mut right) = (vec![vec![0.0; n - 2]; n - 2], vec![0.0; n - 2]);
        for (a, b) in parts {
            right.iter_mut().zip(b).for_each(|(sum, v)| *sum += v);
            normal.iter_mut().flatten().zip(a.iter().flatten()).for_each(|(sum, v)| *sum += v);
        }
        (normal, right)
    }
}

/// Eliminates the last two unknowns of normal equations and leaves the equations of the others.
fn eliminate_last_two(normal: &mut Vec<Vec<f64>>, right: &mut Vec<f64>) {
    for last in [right.len() - 1, right.len() - 2] {
        let pivot_row = normal[last].clone();
        let pivot = pivot_row[last];
        if pivot > 0.0 {
            for i in 0..last {
                let factor = normal[i][last] / pivot;
                right[i] -= factor * right[last];
                normal[i].iter_mut().zip(&pivot_row[..last]).for_each(|(v, p)| *v -= factor * p);
            }
        }
        normal.truncate(last);
        normal.iter_mut().for_each(|row| row.truncate(last));
        right.truncate(last);
    }
}

pub(super) fn variance_of(values: &[f64]) -> f64 {
    let mean = values.iter().sum::<f64>() / values.len() as f64;
    values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / values.len() as f64
}

pub(super) fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

pub(super) fn mean_square(values: &[f64]) -> f64 {
    values.iter().map(|v| v * v).sum::<f64>() / values.len() as f64
}

/// The gain of a step if the slopes hold all the way.
fn promised(normal: &[Vec<f64>], right: &[f64], step: &[f64]) -> f64 {
    let row = |(row, r): (&Vec<f64>, &f64)| 2.0 * r - row.iter().zip(step).map(|(n, s)| n * s).sum::<f64>();
    normal.iter().zip(right).map(row).zip(step).map(|(v, s)| v * s).sum()
}

fn huber(square: f64) -> f64 {
    let r = square.sqrt();
    if r <= OUTLIER { square } else { OUTLIER * (2.0 * r - OUTLIER) }
}

fn scaled(mut matrix: Vec<Vec<f64>>, factor: f64) -> Vec<Vec<f64>> {
    matrix.iter_mut().flatten().for_each(|v| *v *= factor);
    matrix
}

/// The cost of numbers that are far from their expected values. It holds the numbers that the pictures do not show.
fn prior(start: &Parameters, at: &Parameters, free: &[Parameter]) -> f64 {
    free.iter().map(|p| ((at.get(*p) - start.get(*p)) / p.usual()).powi(2)).sum()
}

fn with_priors(
    mut normal: Vec<Vec<f64>>,
    mut right: Vec<f64>,
    start: &Parameters,
    at: &Parameters,
    free: &[Parameter],
) -> (Vec<Vec<f64>>, Vec<f64>) {
    for (i, p) in free.iter().enumerate() {
        let weight = 1.0 / p.usual().powi(2);
        normal[i][i] += weight;
        right[i] -= weight * (at.get(*p) - start.get(*p));
    }
    (normal, right)
}
