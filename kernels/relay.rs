//! Multiplies each bin inside the spans by the response of the pixel aperture and the relay (OPTICS 10).
//!
//! The kernel computes `transfer *= relay` for one pupil pass.

use crate::{Complex32, pass_pupil::Args};

/// Multiplies `transfer` (rows, columns) by `relay` (grid_height, grid_width), which is in the order of the spectrum.
pub fn relay(args: &Args, relay: &[Complex32], spans: &[[u32; 2]], transfer: &mut [Complex32]) {
    args.simd_pieces(
        spans,
        #[inline(always)]
        |grid, at, length| {
            for (k, r) in transfer[at..at + length].iter_mut().zip(&relay[grid..grid + length]) {
                *k = Complex32::new(k.re * r.re - k.im * r.im, k.re * r.im + k.im * r.re);
            }
        },
    );
}
