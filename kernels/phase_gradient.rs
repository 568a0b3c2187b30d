//! Turns the change of the field into the gradient of the phases, `tau = Im(g conj(amplitude exp(i W)))`. The gradient
//! replaces W of the pixels or of one sub-pixel of each (OPTICS 10). One frame.

use crate::{Complex32, modulate, simd, trig};

/// Replaces `wave` (height, width) by the gradient. `tables` has the layout of `modulate_wave`, and `change` is
/// (grid_height, grid_width).
pub fn phase_gradient(args: &modulate::Args, tables: &[f32], change: &[Complex32], wave: &mut [f32]) {
    let (w, gw, pixels) = (args.width as usize, args.grid_width as usize, (args.width * args.height) as usize);
    let amplitude = &tables[pixels..2 * pixels];
    simd(
        #[inline(always)]
        || {
            let rows = change.chunks_exact(gw).skip(args.top as usize);
            for ((wave, amplitude), change) in wave.chunks_exact_mut(w).zip(amplitude.chunks_exact(w)).zip(rows) {
                let values = wave.iter_mut().zip(amplitude).zip(&change[args.left as usize..][..w]);
                for ((out, a), g) in values {
                    let (c, s) = trig::cos_sin(*out);
                    *out = a * (c * g.im - s * g.re);
                }
            }
        },
    );
}
