//! Computes `field = scale (amplitude exp(i W) + rest)` on the SLM, and zero in the padding around it. The field
//! includes the source profile and the zero order. W is the phase of the pixels, or of one sub-pixel of each (OPTICS
//! 10). One frame.

use crate::{Complex32, ZERO, modulate, simd, trig};

/// Writes `field` (grid_height, grid_width) from `wave` (height, width). `tables` holds the level, the amplitude, and
/// the real and imaginary part of the rest, each (height, width).
pub fn modulate_wave(args: &modulate::Args, scale: f32, tables: &[f32], wave: &[f32], field: &mut [Complex32]) {
    let (w, gw, pixels) = (args.width as usize, args.grid_width as usize, (args.width * args.height) as usize);
    let [amplitude, re, im] = [1, 2, 3].map(|i| &tables[i * pixels..][..pixels]);
    simd(
        #[inline(always)]
        || {
            if args.height != args.grid_height || args.width != args.grid_width {
                field.fill(ZERO);
            }
            for (y, out) in field.chunks_exact_mut(gw).skip(args.top as usize).take(args.height as usize).enumerate() {
                let row = y * w..(y + 1) * w;
                let values = out[args.left as usize..][..w].iter_mut().zip(&wave[row.clone()]);
                let tables = amplitude[row.clone()].iter().zip(&re[row.clone()]).zip(&im[row]);
                for ((z, phase), ((a, re), im)) in values.zip(tables) {
                    let (c, s) = trig::cos_sin(*phase);
                    *z = Complex32::new((a * c + re) * scale, (a * s + im) * scale);
                }
            }
        },
    );
}
