//! Turns the change of the field behind a mask into the gradient of the phases in front of it (OPTICS 12). The gradient
//! `tau = Im(sum g conj(mask) conj(amplitude exp(i W)))` replaces W. The sum is over the mask pixels of a pixel of the
//! SLM. One frame.

use crate::modulate_mask::Args;
use crate::{Complex32, ZERO, simd, trig};

/// Replaces `wave` (height, width) by the gradient. `tables` and `mask` have the layout of `modulate_mask`, and
/// `change` is (grid_height, grid_width).
pub fn phase_gradient_mask(args: &Args, tables: &[f32], mask: &[Complex32], change: &[Complex32], wave: &mut [f32]) {
    let Args { place, here, cover, .. } = *args;
    let (k, w, gw) = (args.factor as usize, place.width as usize, place.grid_width as usize);
    let (top, left, pixels) = (place.top as usize, place.left as usize, (place.width * place.height) as usize);
    let amplitude = &tables[pixels..2 * pixels];
    let mut sums = vec![ZERO; w];
    simd(
        #[inline(always)]
        || {
            for (y, (wave, amplitude)) in wave.chunks_exact_mut(w).zip(amplitude.chunks_exact(w)).enumerate() {
                sums.fill(ZERO);
                for down in 0..k {
                    let change = &change[(top + k * y + down) * gw + left..][..k * w];
                    let mask = &mask[(k * y + down) * k * w..][..k * w];
                    for ((sum, change), mask) in sums.iter_mut().zip(change.chunks_exact(k)).zip(mask.chunks_exact(k)) {
                        for ((g, m), across) in change.iter().zip(mask).zip(cover) {
                            let part = cover[down] * across;
                            let m = if here != 0 { *m } else { Complex32::new(1.0, 0.0) };
                            sum.re += part * (g.re * m.re + g.im * m.im);
                            sum.im += part * (g.im * m.re - g.re * m.im);
                        }
                    }
                }
                for ((out, a), g) in wave.iter_mut().zip(amplitude).zip(&sums) {
                    let (c, s) = trig::cos_sin(*out);
                    *out = a * (c * g.im - s * g.re);
                }
            }
        },
    );
}
