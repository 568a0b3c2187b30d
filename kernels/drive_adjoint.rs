//! Carries the gradient of the phases back through the look-up table, `tau' = tau dw'/dw`. The result is the change `i
//! tau' exp(i phi)` of a field of the phases themselves. `project` and `adam` read it from there (OPTICS 10). One
//! frame.

use crate::drive::Args;
use crate::{Complex32, simd, trig};

/// Replaces the SLM's part of `change` (grid_height, grid_width). `level`, `shown` and `wave` are (height, width).
pub fn drive_adjoint(args: &Args, level: &[f32], shown: &[f32], wave: &[f32], change: &mut [Complex32]) {
    let Args { place, bend_sin, bend_cos, .. } = *args;
    let (w, gw, left) = (place.width as usize, place.grid_width as usize, place.left as usize);
    simd(
        #[inline(always)]
        || {
            let rows = change.chunks_exact_mut(gw).skip(place.top as usize).zip(wave.chunks_exact(w));
            for ((change, wave), (shown, level)) in rows.zip(shown.chunks_exact(w).zip(level.chunks_exact(w))) {
                let values = change[left..][..w].iter_mut().zip(wave);
                for ((z, wave), (phase, level)) in values.zip(shown.iter().zip(level)) {
                    let (c, s) = trig::cos_sin(trig::wrapped(*phase));
                    let tau = (level + (bend_sin * c + bend_cos * s)) * wave;
                    *z = Complex32::new(-tau * s, tau * c);
                }
            }
        },
    );
}
