//! `field = scale (amplitude exp(i W) + rest)` on the SLM, zero in the padding around it: source profile and undiffracted
//! light with the phases W of one half of a pair (OPTICS 10). One frame.

use crate::{Complex32, ZERO, modulate, simd, trig};

/// `tables`: level, amplitude, real and imaginary part of the rest, each (height, width); `wave` (grid_height, grid_width), of
/// which the real or, of every second sub-frame, the imaginary part is this one's; `field` likewise.
pub fn modulate_wave(
    args: &modulate::Args,
    scale: f32,
    tables: &[f32],
    second: bool,
    wave: &[Complex32],
    field: &mut [Complex32],
) {
    let (w, gw, pixels) = (args.width as usize, args.grid_width as usize, (args.width * args.height) as usize);
    let [amplitude, re, im] = [1, 2, 3].map(|i| &tables[i * pixels..][..pixels]);
    let (top, left) = (args.top as usize, args.left as usize);
    simd(
        #[inline(always)]
        || {
            field.fill(ZERO);
            let rows = field.chunks_exact_mut(gw).zip(wave.chunks_exact(gw)).skip(top).take(args.height as usize);
            for (y, (out, wave)) in rows.enumerate() {
                let row = y * w..(y + 1) * w;
                let values = out[left..][..w].iter_mut().zip(&wave[left..][..w]);
                let tables = amplitude[row.clone()].iter().zip(&re[row.clone()]).zip(&im[row]);
                for ((z, wave), ((a, re), im)) in values.zip(tables) {
                    let (c, s) = trig::cos_sin(if second { wave.im } else { wave.re });
                    *z = Complex32::new((a * c + re) * scale, (a * s + im) * scale);
                }
            }
        },
    );
}
