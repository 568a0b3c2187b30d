//! What the pixels' aperture and the relay do to each bin: `transfer *= relay`, inside the spans (OPTICS 10).

use crate::{Complex32, pass_pupil::Args};

/// `relay` (grid_height, grid_width), in the order of the spectrum; `transfer` (rows, columns).
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
