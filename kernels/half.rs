//! Stores complex fields as two halves (IEEE 754 binary16), with arithmetic in float32. CPU twin of `half.glsl`.
//!
//! A half has 11 bits and reaches from 6e-8 to 65504. All devices round to the nearest, ties to even. Vulkan leaves the
//! rounding of `packHalf2x16` to the device, so shaders round in integers if the device does not guarantee this. Values
//! that are too large become infinite, and NaN stays NaN. `check_finite` finds both. The twin keeps float32 values and
//! rounds them to halves at the points where a shader would store one.

use crate::{Complex32, simd};

/// The largest finite half.
pub const LARGEST: f32 = 65504.0;

/// Returns the half nearest to `x`.
#[inline(always)]
pub fn rounded(x: f32) -> f32 {
    let bits = x.to_bits();
    let (sign, size) = (bits & 0x8000_0000, bits & 0x7fff_ffff);
    // Eleven bits, ties to even. A carry continues into the exponent.
    let normal = f32::from_bits((size + 0xfff + ((size >> 13) & 1)) & !0x1fff);
    // Below 2^-14 halves are 2^-24 apart, as float32 is next to 1/2.
    let small = (f32::from_bits(size) + 0.5) - 0.5;
    let large = if size > 0x7f80_0000 { f32::NAN } else { f32::INFINITY };
    let value = if size < 0x3880_0000 { small } else { normal };
    // 65520 is half-way between the largest half and the next value, which a half cannot hold.
    let value = if size >= 0x477f_f000 { large } else { value };
    f32::from_bits(value.to_bits() | sign)
}

/// Rounds all values to halves.
pub fn round(values: &mut [Complex32]) {
    simd(
        #[inline(always)]
        || {
            for value in bytemuck::cast_slice_mut::<_, f32>(values) {
                *value = rounded(*value);
            }
        },
    );
}

/// Returns the bits of the half nearest to `x`.
fn bits(x: f32) -> u16 {
    let value = rounded(x).to_bits();
    let (sign, size) = ((value >> 16) as u16 & 0x8000, value & 0x7fff_ffff);
    sign | match size {
        // Below 2^-14 halves are whole multiples of 2^-24.
        0..0x3880_0000 => (f32::from_bits(size) * 16_777_216.0) as u16,
        0x3880_0000..0x7f80_0000 => ((size - 0x3800_0000) >> 13) as u16,
        0x7f80_0000 => 0x7c00,
        _ => 0x7e00,
    }
}

/// Returns the exact value of a half.
pub fn value(bits: u16) -> f32 {
    let (sign, size) = (u32::from(bits & 0x8000) << 16, u32::from(bits & 0x7fff));
    let size = match size {
        0..0x0400 => (size as f32 / 16_777_216.0).to_bits(),
        0x0400..0x7c00 => (size << 13) + 0x3800_0000,
        _ => 0x7f80_0000 | (size & 0x03ff) << 13,
    };
    f32::from_bits(sign | size)
}

/// Rounds drives, their gradients and velocities to halves. Values beyond the range become the largest half.
pub fn round_drives(drives: &mut [f32]) {
    simd(
        #[inline(always)]
        || drives.iter_mut().for_each(|value| *value = rounded(value.clamp(-LARGEST, LARGEST))),
    );
}

/// Returns the bits of the nearest halves.
pub fn pack(values: &[f32]) -> Vec<u16> {
    values.iter().map(|v| bits(*v)).collect()
}

/// Returns halves as exact float32.
pub fn unpack(halves: &[u16]) -> Vec<f32> {
    halves.iter().map(|b| value(*b)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use half::f16;

    /// Tests every half, its closest neighbors, and the point half-way to the next half, against an independent
    /// conversion.
    #[test]
    fn rounds_as_conversions_do() {
        let same = |x: f32| {
            for x in [x, -x] {
                let want = f16::from_f32(x).to_f32();
                let got = rounded(x);
                assert!(
                    got == want && got.is_sign_negative() == want.is_sign_negative(),
                    "{x:e}: {got:e}, not {want:e}"
                );
            }
        };
        for bits in 0..0x7c00u16 {
            let here = f16::from_bits(bits).to_f32();
            let next = if bits == 0x7bff { 65536.0 } else { f16::from_bits(bits + 1).to_f32() };
            let middle = 0.5 * (here + next);
            for x in [here, middle] {
                same(x);
                same(f32::from_bits(x.to_bits() + 1));
                same(f32::from_bits(x.to_bits().saturating_sub(1)));
            }
        }
        for x in [0.0, f32::MIN_POSITIVE, 1e-30, 1e-40, 1e30, f32::MAX, f32::INFINITY] {
            same(x);
        }
        assert!(rounded(f32::NAN).is_nan() && rounded(f32::from_bits(0x7fff_ffff)).is_nan());
    }

    /// Tests drives over a turn. Their error power is (36 % 2^-16 + 32 % 2^-18 + 16 % 2^-20 + ...) / 12, which is 62 dB
    /// below the light that they turn.
    #[test]
    fn drives_keep_62_decibels() {
        let exact: Vec<f32> = (0..100_000).map(|i| i as f32 / 100_000.0 * std::f32::consts::TAU).collect();
        let mut drives = exact.clone();
        round_drives(&mut drives);
        let error = drives.iter().zip(&exact).map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>() / 1e5;
        let decibels = -10.0 * error.log10();
        assert!((62.0..63.0).contains(&decibels), "{decibels} dB");
        let mut far = [1e9, -1e9, f32::INFINITY, 65504.0, -3.0];
        round_drives(&mut far);
        assert_eq!(far, [65504.0, -65504.0, 65504.0, 65504.0, -3.0]);
    }

    #[test]
    fn what_is_packed_comes_back() {
        let all: Vec<u16> = (0..=u16::MAX).filter(|b| !f16::from_bits(*b).is_nan()).collect();
        assert_eq!(pack(&unpack(&all)), all);
        assert!(all.iter().all(|b| value(*b).to_bits() == f16::from_bits(*b).to_f32().to_bits()));
        assert!(f16::from_bits(bits(f32::NAN)).is_nan() && value(0x7e00).is_nan());
        assert_eq!((bits(65520.0), bits(-1e9)), (0x7c00, 0xfc00));
    }
}
