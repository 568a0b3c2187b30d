//! Multiplies each field sample by its factor, `window *= factor`. One frame.

use crate::{Complex32, simd};

/// Multiplies `window` (count) by `factor` (count).
pub fn apply_factor(factor: &[f32], window: &mut [Complex32]) {
    simd(
        #[inline(always)]
        || {
            for (v, f) in window.iter_mut().zip(factor) {
                *v = Complex32::new(v.re * f, v.im * f);
            }
        },
    );
}
