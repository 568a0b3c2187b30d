//! Computes a view of Fourier disparity layers (OPTICS 14). A view is the sum of the spectra of the layers, each times
//! the phase ramp that moves the layer. The code is in this crate because a debug build still optimizes it.

use crate::{Complex32, ZERO, simd};
use std::f64::consts::TAU;

/// Sums `layers` (layer, `height`, width / 2 + 1), whose columns are the frequencies from 0 up, into `spectrum`
/// (height, width). `moves` (y, x) moves each layer up and left, in shares of the grid. Only those columns of
/// `spectrum` are written. They are doubled, except column 0, and divided by the number of points of the grid. The real
/// part of the unnormalized inverse transform is therefore the view.
pub fn seen(layers: &[Complex32], moves: &[[f64; 2]], height: usize, spectrum: &mut [Complex32]) {
    let width = spectrum.len() / height;
    let half = width / 2 + 1;
    let ramps: Vec<Vec<Complex32>> =
        moves.iter().map(|[_, x]| (0..half).map(|k| ramp(x * k as f64)).collect()).collect();
    let unit = 1.0 / (height * width) as f32;
    for (y, out) in spectrum.chunks_exact_mut(width).enumerate() {
        let ky = if 2 * y < height { y as f64 } else { y as f64 - height as f64 };
        out.fill(ZERO);
        let out = &mut out[..half];
        for (k, (along_y, ramps)) in moves.iter().zip(&ramps).enumerate() {
            let line = &layers[(k * height + y) * half..][..half];
            let turn = ramp(along_y[0] * ky);
            simd(
                #[inline(always)]
                || {
                    for ((out, layer), ramp) in out.iter_mut().zip(line).zip(ramps) {
                        let (re, im) = (ramp.re * turn.re - ramp.im * turn.im, ramp.re * turn.im + ramp.im * turn.re);
                        out.re += layer.re * re - layer.im * im;
                        out.im += layer.re * im + layer.im * re;
                    }
                },
            );
        }
        for (x, out) in out.iter_mut().enumerate() {
            *out *= if x == 0 { unit } else { 2.0 * unit };
        }
    }
}

fn ramp(turns: f64) -> Complex32 {
    let (sin, cos) = (TAU * turns.fract()).sin_cos();
    Complex32::new(cos as f32, sin as f32)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fft::{Columns, Direction, Plans};

    /// One wave on the second of two layers is moved, and compared with its formula.
    #[test]
    fn a_wave_moves() {
        let (h, w, ky, kx) = (20, 24, -3i64, 4usize);
        let half = w / 2 + 1;
        let mut layers = vec![ZERO; 2 * h * half];
        layers[h * half + (h as i64 + ky) as usize * half + kx] = Complex32::new(0.3, 0.4) * (h * w) as f32;
        let mut got = vec![Complex32::new(f32::NAN, 0.0); h * w];
        seen(&layers, &[[0.0; 2], [0.11, -0.07]], h, &mut got);
        Plans::default().fft(&mut got, h, w, Direction::Inverse, Columns { first: 0, count: half }, |_| {});
        for (i, got) in got.iter().enumerate() {
            let (y, x) = ((i / w) as f64 / h as f64 + 0.11, (i % w) as f64 / w as f64 - 0.07);
            let at = TAU * (ky as f64 * y + kx as f64 * x);
            let want = 2.0 * (at.cos() * 0.3 - at.sin() * 0.4);
            assert!((f64::from(got.re) - want).abs() < 1e-5, "{i}: {}, not {want}", got.re);
        }
    }
}
