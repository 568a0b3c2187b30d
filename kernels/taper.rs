//! Weakens the propagation kernel towards the edges of an aperture that is not sharp: `transfer[j][k] *= rows[j]
//! columns[k]`. With the spectrum of a Hann window as weights, what passes is one coefficient of the short-time Fourier
//! transform at every pixel (OPTICS 7). One pupil pass.

use crate::{Complex32, simd, transfer};
use bytemuck::{Pod, Zeroable};

/// A pupil pass's window.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
pub struct Args {
    /// Rows of the window.
    pub rows: u32,
    /// Columns of the window.
    pub columns: u32,
}

impl From<&transfer::Args> for Args {
    fn from(args: &transfer::Args) -> Self {
        Self { rows: args.rows, columns: args.columns }
    }
}

/// `weights`: those of all rows, then those of all columns; `transfer` (rows, columns).
pub fn taper(args: &Args, weights: &[f32], transfer: &mut [Complex32]) {
    let (rows, columns) = weights.split_at(args.rows as usize);
    simd(
        #[inline(always)]
        || {
            for (line, across) in transfer.chunks_exact_mut(args.columns as usize).zip(rows) {
                for (z, along) in line.iter_mut().zip(columns) {
                    let weight = across * along;
                    *z = Complex32::new(z.re * weight, z.im * weight);
                }
            }
        },
    );
}
