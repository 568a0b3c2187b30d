//! What the change of a pair's fields asks of their phases: `tau = Im(g conj(amplitude exp(i W)))`, in place of W (OPTICS 10).

use crate::{Complex32, ZERO, modulate, simd, trig};

/// Of one value.
#[inline(always)]
fn tau(a: f32, phase: f32, g: &Complex32) -> f32 {
    let (c, s) = trig::cos_sin(phase);
    a * (c * g.im - s * g.re)
}

/// `tables` as `modulate_wave` has them; `change`: those of two sub-frames (grid_height, grid_width), the second empty where
/// their number is odd; `wave` (grid_height, grid_width).
pub fn turn(args: &modulate::Args, tables: &[f32], change: [&[Complex32]; 2], wave: &mut [Complex32]) {
    let (w, gw, pixels) = (args.width as usize, args.grid_width as usize, (args.width * args.height) as usize);
    let amplitude = &tables[pixels..2 * pixels];
    let (top, left, height) = (args.top as usize, args.left as usize, args.height as usize);
    simd(
        #[inline(always)]
        || {
            for (y, row) in wave.chunks_exact_mut(gw).enumerate() {
                if !(top..top + height).contains(&y) {
                    row.fill(ZERO);
                    continue;
                }
                row[..left].fill(ZERO);
                row[left + w..].fill(ZERO);
                let values = row[left..][..w].iter_mut().zip(&amplitude[(y - top) * w..]);
                let first = &change[0][y * gw + left..][..w];
                if change[1].is_empty() {
                    values.zip(first).for_each(|((z, a), g)| *z = Complex32::new(tau(*a, z.re, g), 0.0));
                } else {
                    let second = &change[1][y * gw + left..][..w];
                    for (((z, a), g), h) in values.zip(first).zip(second) {
                        *z = Complex32::new(tau(*a, z.re, g), tau(*a, z.im, h));
                    }
                }
            }
        },
    );
}
