//! Cuts the window of a pupil out of the spectrum and applies K, `window = scale * spectrum * transfer`. One frame.

use crate::{Complex32, ZERO, simd};
use bytemuck::{Pod, Zeroable};

/// A window on the DFT grid. `pupil_adjoint` and `overlap` have the same arguments.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct Args {
    /// Rows of the grid.
    pub grid_height: u32,
    /// Columns of the grid.
    pub grid_width: u32,
    /// Index of the window's first row on the grid, `0 .. grid_height`. The window wraps.
    pub y0: u32,
    /// Index of the window's first column on the grid, `0 .. grid_width`.
    pub x0: u32,
    /// Rows of the window.
    pub rows: u32,
    /// Columns of the window.
    pub columns: u32,
    /// Factor on every value.
    pub scale: f32,
}

impl Args {
    /// Calls `visit(grid offset, window offset, length)` for each contiguous piece of the spans.
    #[inline(always)]
    pub fn pieces(&self, spans: &[[u32; 2]], mut visit: impl FnMut(usize, usize, usize)) {
        let (gh, gw) = (self.grid_height as usize, self.grid_width as usize);
        for (j, &[first, end]) in spans.iter().enumerate() {
            let y = (self.y0 as usize + j) % gh;
            let (mut k, end) = (first as usize, end as usize);
            while k < end {
                let x = (self.x0 as usize + k) % gw;
                let length = (end - k).min(gw - x);
                visit(y * gw + x, j * self.columns as usize + k, length);
                k += length;
            }
        }
    }

    /// Does the same, compiled for the widest SIMD of the processor.
    #[inline(always)]
    pub(crate) fn simd_pieces(&self, spans: &[[u32; 2]], visit: impl FnMut(usize, usize, usize)) {
        simd(
            #[inline(always)]
            || self.pieces(spans, visit),
        );
    }
}

/// Writes `window` from `transfer`, both (rows, columns), and `spectrum` (grid_height, grid_width). Outside the spans
/// `window` is zero.
pub fn pass_pupil(
    args: &Args,
    spectrum: &[Complex32],
    transfer: &[Complex32],
    spans: &[[u32; 2]],
    window: &mut [Complex32],
) {
    let columns = args.columns as usize;
    for (row, &[first, end]) in window.chunks_exact_mut(columns).zip(spans) {
        row[..first as usize].fill(ZERO);
        row[end as usize..].fill(ZERO);
    }
    args.simd_pieces(
        spans,
        #[inline(always)]
        |grid, at, length| {
            let from = &spectrum[grid..grid + length];
            let kernel = &transfer[at..at + length];
            for ((out, u), k) in window[at..at + length].iter_mut().zip(from).zip(kernel) {
                let (re, im) = (u.re * args.scale, u.im * args.scale);
                *out = Complex32::new(re * k.re - im * k.im, re * k.im + im * k.re);
            }
        },
    );
}
