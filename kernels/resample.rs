//! Resamples an image from a level of the pyramid to the window of a pupil, by separable weights from a table. One
//! pupil.

use crate::simd;
use bytemuck::{Pod, Zeroable};

/// Both sizes, and the number of weights per output sample on each axis.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
pub struct Args {
    /// Rows of the input.
    pub in_height: u32,
    /// Columns of the input.
    pub in_width: u32,
    /// Rows of the output.
    pub height: u32,
    /// Columns of the output.
    pub width: u32,
    /// Weights per output row.
    pub row_taps: u32,
    /// Weights per output column.
    pub column_taps: u32,
}

impl Args {
    /// Returns the arguments from one size (rows, columns) to another, with these weights along rows and columns.
    pub fn between(from: (usize, usize), to: (usize, usize), rows: &Table, columns: &Table) -> Self {
        let [in_height, in_width, height, width] = [from.0, from.1, to.0, to.1].map(|n| n as u32);
        Self { in_height, in_width, height, width, row_taps: rows.taps as u32, column_taps: columns.taps as u32 }
    }
}

/// Weights of one axis. Output sample `j` is the sum over `t` of `weights[j * taps + t] * input[(first[j] + t) mod n]`.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Table {
    /// First input sample per output sample, `0 .. n`.
    pub first: Vec<u32>,
    /// Weights, `taps` per output sample, whose sum is 1.
    pub weights: Vec<f32>,
    /// Number of weights per output sample.
    pub taps: usize,
}

impl Table {
    /// Returns weights for the mean over the interval of one output sample, periodic. Sample `j` of `n_out` is at
    /// `j n_in / n_out`, the place that the inverse transform of a window gives it. An input sample covers the interval
    /// of width 1 around it. If there are more output samples than input samples, each output sample is interpolated
    /// between its two neighbors.
    pub fn area(n_in: usize, n_out: usize) -> Self {
        let step = n_in as f64 / n_out as f64;
        if n_out > n_in {
            let places = || (0..n_out).map(|j| j as f64 * step);
            let first = places().map(|at| at as u32 % n_in as u32).collect();
            let weights = places().flat_map(|at| [1.0 - at.fract() as f32, at.fract() as f32]).collect();
            return Self { first, weights, taps: 2 };
        }
        let taps = if n_in == n_out { 1 } else { step.ceil() as usize + 1 };
        let (mut first, mut weights) = (Vec::with_capacity(n_out), Vec::with_capacity(n_out * taps));
        let mut row = Vec::with_capacity(taps);
        for j in 0..n_out {
            let (low, high) = ((j as f64 - 0.5) * step + 0.5, (j as f64 + 0.5) * step + 0.5);
            let start = low.floor();
            first.push((start as i64).rem_euclid(n_in as i64) as u32);
            row.clear();
            row.extend((0..taps).map(|t| (high.min(start + t as f64 + 1.0) - low.max(start + t as f64)).max(0.0)));
            let sum: f64 = row.iter().sum();
            weights.extend(row.iter().map(|w| (w / sum) as f32));
        }
        Self { first, weights, taps }
    }
}

/// Returns the sum of the samples times their weights, in order.
#[inline(always)]
fn weighted(samples: &[f32], weights: &[f32]) -> f32 {
    let mut sum = 0.0;
    for (v, weight) in samples.iter().zip(weights) {
        sum += weight * v;
    }
    sum
}

/// Resamples a line by a table of `N` weights per sample.
#[inline(always)]
fn along<const N: usize>(line: &[f32], table: &Table, out: &mut [f32]) {
    let weights = table.weights.as_chunks::<N>().0;
    for ((out, &first), weights) in out.iter_mut().zip(&table.first).zip(weights) {
        *out = weighted(&line[first as usize..][..N], weights);
    }
}

/// Resamples `input` (in_height, in_width) to `output` (height, width). `scratch` is overwritten, and grows to at least
/// in_width values.
pub fn resample(args: &Args, input: &[f32], rows: &Table, columns: &Table, output: &mut [f32], scratch: &mut Vec<f32>) {
    let (ih, iw, w) = (args.in_height as usize, args.in_width as usize, args.width as usize);
    if args.in_height == args.height && args.in_width == args.width {
        output.copy_from_slice(input);
        return;
    }
    scratch.resize(iw + columns.taps, 0.0);
    simd(
        #[inline(always)]
        || {
            for (j, out) in output.chunks_exact_mut(w).enumerate() {
                let line = &mut scratch[..iw];
                line.fill(0.0);
                for t in 0..rows.taps {
                    let weight = rows.weights[j * rows.taps + t];
                    let from = &input[(rows.first[j] as usize + t) % ih * iw..][..iw];
                    for (sum, v) in line.iter_mut().zip(from) {
                        *sum += weight * v;
                    }
                }
                // Repeats the beginning of the line after its end, so that no column below has to wrap.
                for t in 0..columns.taps {
                    scratch[iw + t] = scratch[t % iw];
                }
                // Halving a level takes three weights, so that loop is unrolled.
                match columns.taps {
                    2 => along::<2>(scratch, columns, out),
                    3 => along::<3>(scratch, columns, out),
                    _ => {
                        for ((out, &first), weights) in
                            out.iter_mut().zip(&columns.first).zip(columns.weights.chunks_exact(columns.taps))
                        {
                            *out = weighted(&scratch[first as usize..], weights);
                        }
                    }
                }
            }
        },
    );
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn keeps_a_constant_and_the_mean(n_in in 1usize..60, n_out in 1usize..60) {
            let n_out = n_out.min(n_in);
            let table = Table::area(n_in, n_out);
            let mut used = vec![0.0f64; n_in];
            for j in 0..n_out {
                let weights = &table.weights[j * table.taps..][..table.taps];
                prop_assert!((weights.iter().sum::<f32>() - 1.0).abs() < 1e-5);
                for (t, w) in weights.iter().enumerate() { used[(table.first[j] as usize + t) % n_in] += f64::from(*w); }
            }
            // Each input sample has the same total weight.
            for u in used { prop_assert!((u - n_out as f64 / n_in as f64).abs() < 1e-4, "{}", u); }
        }
    }

    #[test]
    fn more_samples_lie_between_those_that_there_are() {
        let table = Table::area(4, 8);
        let input = [0.0f32, 2.0, 4.0, 2.0];
        let sample =
            |j: usize| (0..2).map(|t| table.weights[2 * j + t] * input[(table.first[j] as usize + t) % 4]).sum();
        assert_eq!((0..8).map(sample).collect::<Vec<f32>>(), [0.0, 1.0, 2.0, 3.0, 4.0, 3.0, 2.0, 1.0]);
    }

    #[test]
    fn a_wave_keeps_its_phase() {
        // A slow cosine keeps its phase, because samples are at j n_in / n_out.
        let (n_in, n_out) = (96, 40);
        let wave = |n: usize| {
            (0..n).map(|i| (std::f64::consts::TAU * 2.0 * i as f64 / n as f64).cos() as f32).collect::<Vec<_>>()
        };
        let args = Args { in_height: 1, in_width: 96, height: 1, width: 40, row_taps: 1, column_taps: 4 };
        let mut out = vec![0.0; n_out];
        resample(&args, &wave(n_in), &Table::area(1, 1), &Table::area(n_in, n_out), &mut out, &mut Vec::new());
        let scale = out[0];
        assert!(scale > 0.97);
        for (got, want) in out.iter().zip(wave(n_out)) {
            assert!((got / scale - want).abs() < 0.02, "{got} {want}");
        }
    }
}
