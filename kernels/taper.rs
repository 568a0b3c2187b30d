//! Weakens the propagation kernel towards the edges of a soft aperture, `transfer[j][k] *= rows[j] columns[k]`. If the
//! weights are the spectrum of a Hann window, the light that passes is one coefficient of the short-time Fourier
//! transform at every pixel (OPTICS 7). One pupil pass.

use crate::{Complex32, simd};

/// Multiplies `transfer` (rows, columns) by the weights. `weights` holds the weights of all rows, then the weights of
/// all `columns`.
pub fn taper(weights: &[f32], columns: usize, transfer: &mut [Complex32]) {
    let (rows, columns) = weights.split_at(weights.len() - columns);
    simd(
        #[inline(always)]
        || {
            for (line, across) in transfer.chunks_exact_mut(columns.len()).zip(rows) {
                for (z, along) in line.iter_mut().zip(columns) {
                    let weight = across * along;
                    *z = Complex32::new(z.re * weight, z.im * weight);
                }
            }
        },
    );
}
