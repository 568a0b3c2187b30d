//! Applies the adjoint of the pupil, `change += scale * window * conj(transfer)`, inside the spans. One frame, one
//! pupil.

use crate::Complex32;
pub use crate::pass_pupil::Args;

/// Adds `window` times conj(`transfer`), both (rows, columns), to `change` (grid_height, grid_width), which is in the
/// order of the DFT.
pub fn pupil_adjoint(
    args: &Args,
    window: &[Complex32],
    transfer: &[Complex32],
    spans: &[[u32; 2]],
    change: &mut [Complex32],
) {
    args.simd_pieces(
        spans,
        #[inline(always)]
        |grid, at, length| {
            let from = &window[at..at + length];
            let kernel = &transfer[at..at + length];
            for ((out, v), k) in change[grid..grid + length].iter_mut().zip(from).zip(kernel) {
                let (re, im) = (v.re * args.scale, v.im * args.scale);
                out.re += re * k.re + im * k.im;
                out.im += im * k.re - re * k.im;
            }
        },
    );
}
