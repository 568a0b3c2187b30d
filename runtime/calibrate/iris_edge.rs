//! Locates the iris to a small share of a bin, by the bins at its edge.
//!
//! Light appears and disappears by whole bins at its edge, and no slope shows this. Each bin near the edge is judged by
//! the pictures. The iris moves to the place where it passes the bins that are lit.

use super::device::Device;
use super::parameters::{Parameter, Parameters};
use super::seen::{Look, POINTS, Prediction};
use super::views::Pictures;
use eyebox_kernels::Complex64;
use eyebox_optics::{Optics, Pupil};
use eyebox_solve::solve::SplitMix;
use rayon::prelude::*;
use std::f64::consts::TAU;

/// Bins within this distance of the edge, in bins, may be on its wrong side.
const MARGIN: f64 = 0.3;
/// Number of places of the iris that are tried in a round, and number of rounds.
const TRIALS: usize = 1500;
const ROUNDS: usize = 14;
/// Least standard error, share of a bin. The model of the edge is not more accurate.
const LEAST: f64 = 5e-4;

/// A bin near the edge of an iris.
struct RimBin {
    /// Place in the pupil plane, meters.
    y: f64,
    x: f64,
    /// True if the iris passes the bin now.
    inside: bool,
    /// Change of the squares if the bin is on the other side of the edge.
    changed: f64,
}

/// The iris's numbers that the edge determines.
pub(super) struct Rim {
    pub(super) at: Parameters,
    /// Standard errors of x, y (mm), scale.
    pub(super) errors: [f64; 3],
}

impl Look {
    /// The bins near the edge, judged by the residuals of a prediction. `residuals` and `weights` are by pixel. `gain`
    /// is the factor from intensity to counts.
    fn judged(
        &self,
        at: &Parameters,
        fields: &[&[Complex64]],
        (residuals, weights, gain): (&[f64], &[f64], f64),
    ) -> Vec<RimBin> {
        let iris = at.model.true_pupil(&self.pupil);
        let (bin_y, bin_x) = self.optics.bin_size();
        let margin = MARGIN * bin_y.max(bin_x);
        let wide = Pupil { diameter: iris.diameter + 2.5 * margin, ..iris };
        let points = self.points(&at.map, at.camera_pixel);
        let (places, undo) = (self.places(&points), self.undo());
        let kernel = self.kernel(at);
        let times = |field: &&[Complex64]| field.iter().zip(&kernel).map(|(a, b)| a * b).collect::<Vec<_>>();
        let light: Vec<Vec<Complex64>> = fields.iter().map(|f| self.at(&times(f), &places, &undo)).collect();
        let share = 1.0 / (POINTS * fields.len()) as f64;
        let scale = 1.0 / (self.optics.height * self.optics.width) as f64;
        let (size, half) = (self.window.size as i64, self.window.size as i64 / 2);
        let mut bins = Vec::new();
        for (i, (ky, kx)) in self.window.bins().enumerate() {
            let (y, x) = (ky as f64 * bin_y, kx as f64 * bin_x);
            let off = (y - iris.y).hypot(x - iris.x) - iris.diameter / 2.0;
            if off.abs() > margin || !self.optics.has_bin(ky, kx) {
                continue;
            }
            let inside = kernel[i] != Complex64::default();
            let passed = match inside {
                true => kernel[i],
                false => self.kernel_at(at, &wide, (ky, kx)),
            };
            let sign = if inside { -scale } else { scale };
            let added: Vec<Complex64> = fields.iter().map(|f| f[i] * passed * sign).collect();
            let (turn_y, turn_x) = (
                TAU * (i as i64 / size - half) as f64 / self.optics.height as f64,
                TAU * (i as i64 % size - half) as f64 / self.optics.width as f64,
            );
            let mut changed = 0.0;
            for (pixel, around) in points.chunks_exact(POINTS).enumerate() {
                let mut intensity = 0.0;
                for (point, [px, py]) in around.iter().enumerate() {
                    let wave = Complex64::cis(turn_y * py + turn_x * px);
                    for (light, added) in light.iter().zip(&added) {
                        let more = added * wave;
                        intensity += 2.0 * (light[pixel * POINTS + point].conj() * more).re + more.norm_sqr();
                    }
                }
                let more = gain * intensity * share;
                changed += weights[pixel] * more * (2.0 * residuals[pixel] + more);
            }
            bins.push(RimBin { y, x, inside, changed });
        }
        bins
    }
}

impl Pictures {
    /// Moves the iris to the place where the bins at its edge match the pictures. The iris stays if that is no better.
    /// The whole SLM must be one part, because bins of a piece are coarser than the edge.
    pub(super) fn rim(&self, at: &Parameters, subpixels: usize, which: &[usize]) -> Rim {
        let device = Device::new(&at.model, self.parts[0], &self.optics, subpixels);
        let fields: Vec<_> = self.sets.par_iter().map(|set| device.enter(&set.parts[0], &[]).0).collect();
        let entering = |v: usize| -> Vec<&[Complex64]> {
            let view = &self.views[v];
            fields[view.set].iter().map(|frame| &frame[view.looks[0].1][..]).collect()
        };
        let see = |at: &Parameters| -> Vec<Prediction> {
            which.par_iter().map(|v| self.views[*v].looks[0].0.see(at, &entering(*v), &[], &[])).collect()
        };
        let mut rim = Rim { at: at.clone(), errors: [f64::INFINITY; 3] };
        let mut seen = see(at);
        let mut squares = self.squares(which, &seen);
        let count: usize = which.iter().map(|v| self.views[*v].counts.len()).sum();
        for _ in 0..3 {
            let bins: Vec<(Pupil, Vec<RimBin>)> = which
                .par_iter()
                .zip(&seen)
                .map(|(v, seen)| {
                    let view = &self.views[*v];
                    let weights: Vec<f64> = view.variance.iter().map(|v| v.recip()).collect();
                    let residuals = self.residuals(*v, seen);
                    let gain = self.exposure(*v, seen).gain * view.exposure_ms;
                    (view.pupil(), view.looks[0].0.judged(&rim.at, &entering(*v), (&residuals, &weights, gain)))
                })
                .collect();
            let scale = (squares / count as f64).max(1.0);
            let (off, errors) = place(&self.optics, &rim.at, &bins, scale);
            let mut trial = rim.at.clone();
            (0..3).for_each(|i| trial = trial.moved(Parameter::Iris(i), off[i]));
            let now = see(&trial);
            let left = self.squares(which, &now);
            tracing::debug!("the iris by its edge: {off:?} +- {errors:?}, squares {squares:.1} to {left:.1}");
            rim.errors = errors;
            if left >= squares {
                break;
            }
            (rim.at, seen) = (trial, now);
            let gained = squares - left;
            squares = left;
            if gained < 1e-4 * squares {
                break;
            }
        }
        rim
    }
}

/// The movement of the iris, x, y (mm), scale, and its standard errors. They are the mean and the spread of places that
/// are weighted by the likelihood of the squares that they leave.
fn place(optics: &Optics, at: &Parameters, bins: &[(Pupil, Vec<RimBin>)], scale: f64) -> ([f64; 3], [f64; 3]) {
    let (bin_y, bin_x) = optics.bin_size();
    let bin_mm = bin_y.max(bin_x) * 1e3;
    let unit = [bin_mm, bin_mm, bin_mm / (0.5e3 * optics.eyebox())];
    let squares = |off: &[f64; 3]| {
        let mut moved = at.clone();
        (0..3).for_each(|i| moved = moved.moved(Parameter::Iris(i), off[i]));
        let of_view = |(pupil, bins): &(Pupil, Vec<RimBin>)| {
            let iris = moved.model.true_pupil(pupil);
            let far = (iris.diameter / 2.0).powi(2);
            let passes = |b: &RimBin| (b.y - iris.y).powi(2) + (b.x - iris.x).powi(2) < far;
            bins.iter().filter(|b| passes(b) != b.inside).map(|b| b.changed).sum::<f64>()
        };
        bins.iter().map(of_view).sum::<f64>() / scale
    };
    let mut random = SplitMix(0x0072_696d);
    let (mut middle, mut reach) = ([0.0; 3], unit.map(|u| 0.7 * MARGIN * u));
    let mut errors = reach;
    for _ in 0..ROUNDS {
        let mut trials: Vec<[f64; 3]> =
            (0..TRIALS).map(|_| [0, 1, 2].map(|i| middle[i] + reach[i] * (2.0 * random.unit() - 1.0))).collect();
        trials.push(middle);
        let left: Vec<f64> = trials.par_iter().map(squares).collect();
        let least = left.iter().copied().fold(f64::INFINITY, f64::min);
        let likely: Vec<f64> = left.iter().map(|l| ((least - l) / 2.0).exp()).collect();
        let sum: f64 = likely.iter().sum();
        let mean = |i: usize| trials.iter().zip(&likely).map(|(t, w)| t[i] * w).sum::<f64>() / sum;
        middle = [0, 1, 2].map(mean);
        let spread = |i: usize| {
            (trials.iter().zip(&likely).map(|(t, w)| (t[i] - middle[i]).powi(2) * w).sum::<f64>() / sum).sqrt()
        };
        errors = [0, 1, 2].map(|i| spread(i).max(LEAST * unit[i]));
        reach = [0, 1, 2].map(|i| (4.0 * errors[i]).clamp(0.55 * reach[i], reach[i]));
    }
    (middle, errors)
}
