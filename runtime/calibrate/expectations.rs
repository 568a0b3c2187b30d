//! Where numbers are expected before any picture is seen: it keeps those in place that the pictures do not show.
//!
//! Most numbers are expected near their start, each by itself. The wavefront is expected to be smooth over the whole eyebox. Its
//! polynomials grow so fast beyond the disc that small coefficients are many waves in the corners, and where no picture looks
//! nothing else would hold them.

use super::parameters::{Parameter, Parameters};
use crate::optics::zernike;
use std::sync::LazyLock;

/// RMS of the wavefront over the eyebox, waves, and of its slopes, waves per half eyebox.
const WAVES: f64 = 0.3;
const SLOPES: f64 = 0.5;
/// The wavefront's polynomials up to the order 10.
const COUNT: usize = 66;

/// Precision of the wavefront's coefficients, by pairs of ANSI indices: means over the eyebox of products of the polynomials and of
/// their slopes.
static SMOOTH: LazyLock<Vec<f64>> = LazyLock::new(|| {
    const SIDE: usize = 24;
    const STEP: f64 = 1e-4;
    let place = |i: usize| (i as f64 + 0.5) * 2.0 / SIDE as f64 - 1.0;
    let mut precision = vec![0.0; COUNT * COUNT];
    for (x, y) in (0..SIDE * SIDE).map(|i| (place(i % SIDE), place(i / SIDE))) {
        let all = |x: f64, y: f64| (0..COUNT as u32).map(|j| zernike(j, x, y)).collect::<Vec<f64>>();
        let slope = |dx: f64, dy: f64| -> Vec<f64> {
            let [after, before] = [all(x + dx, y + dy), all(x - dx, y - dy)];
            after.iter().zip(before).map(|(a, b)| (a - b) / (2.0 * STEP * SLOPES)).collect()
        };
        let value: Vec<f64> = all(x, y).into_iter().map(|v| v / WAVES).collect();
        for part in [value, slope(STEP, 0.0), slope(0.0, STEP)] {
            for (i, row) in precision.chunks_exact_mut(COUNT).enumerate() {
                row.iter_mut().zip(&part).for_each(|(sum, v)| *sum += part[i] * v / (SIDE * SIDE) as f64);
            }
        }
    }
    precision
});

/// How sure one is of these expectations of the wavefront. A number's least squares count each pixel by itself, although neighbors
/// share a speckle and faults that no term describes, so that pictures outweigh what is expected by far.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Smoothness(pub(super) f64);

impl Smoothness {
    /// Until all pictures are found: one that is not yet explained does not pull the wavefront away from the next.
    pub(super) const STRONG: Self = Self(300.0);
    /// Where pictures may be left that are not found.
    pub(super) const SOME: Self = Self(30.0);
    /// Of what no picture shows.
    pub(super) const WEAK: Self = Self(1.0);
}

/// Precision of two numbers.
fn precision(smoothness: Smoothness, a: Parameter, b: Parameter) -> f64 {
    match (a, b) {
        (Parameter::Wavefront(i), Parameter::Wavefront(j)) if i.max(j) < COUNT as u32 => {
            smoothness.0 * SMOOTH[i as usize * COUNT + j as usize]
        }
        (a, b) if a == b => 1.0 / a.usual().powi(2),
        _ => 0.0,
    }
}

/// The cost of numbers that are far from where they are expected.
pub(super) fn expectation(smoothness: Smoothness, start: &Parameters, at: &Parameters, free: &[Parameter]) -> f64 {
    let off: Vec<f64> = free.iter().map(|p| at.get(*p) - start.get(*p)).collect();
    let row = |i: usize| free.iter().zip(&off).map(|(p, off)| precision(smoothness, free[i], *p) * off).sum::<f64>();
    (0..free.len()).map(|i| off[i] * row(i)).sum()
}

/// Normal equations with what is expected.
pub(super) fn with_expectations(
    smoothness: Smoothness,
    (mut normal, mut right): (Vec<Vec<f64>>, Vec<f64>),
    start: &Parameters,
    at: &Parameters,
    free: &[Parameter],
) -> (Vec<Vec<f64>>, Vec<f64>) {
    for (i, a) in free.iter().enumerate() {
        for (j, b) in free.iter().enumerate() {
            let weight = precision(smoothness, *a, *b);
            normal[i][j] += weight;
            right[i] -= weight * (at.get(*b) - start.get(*b));
        }
    }
    (normal, right)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_wavefront_is_expected_to_be_smooth_over_the_corners_too() {
        let cost = |waves: &[(u32, f64)]| {
            let pairs = || waves.iter().flat_map(|a| waves.iter().map(move |b| (a, b)));
            let of = |((i, a), (j, b)): (&(u32, f64), &(u32, f64))| {
                a * b * precision(Smoothness(1.0), Parameter::Wavefront(*i), Parameter::Wavefront(*j))
            };
            pairs().map(of).sum::<f64>()
        };
        // Defocus of a wave: 3^0.5 (2 r^2 - 1) over the square has a mean square of 37 / 15, its slopes of 32.
        let want = (37.0 / 15.0) / WAVES.powi(2) + 32.0 / SLOPES.powi(2);
        assert!((cost(&[(4, 1.0)]) / want - 1.0).abs() < 0.01, "{} {want}", cost(&[(4, 1.0)]));
        // As many waves over the disc cost more, the higher the order.
        assert!(cost(&[(24, 1.0)]) > 10.0 * cost(&[(12, 1.0)]) && cost(&[(12, 1.0)]) > 5.0 * cost(&[(4, 1.0)]));
        // Terms that cancel in the corners cost less than each by itself.
        assert!(cost(&[(12, -0.5), (24, 0.1)]) < cost(&[(12, -0.5)]));
    }
}
