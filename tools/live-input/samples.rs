//! Converts stored samples to linear light.

use crate::{FrameFault, Sample, Transfer};

/// The sRGB curve at all values of 16 bits, computed once for decoding. Values of 8 bits are every 257th entry.
#[derive(Debug)]
pub(crate) struct Curve(Vec<f32>);

impl Curve {
    pub(crate) fn new() -> Self {
        let light = |v: f64| if v <= 0.04045 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) };
        Self((0..=65_535u32).map(|v| light(f64::from(v) / 65_535.0) as f32).collect())
    }
}

/// Returns the value of a float of 16 bits.
fn half(bits: u16) -> f32 {
    // 2^112 is the difference of the exponents of both formats. It is also exact for subnormal numbers.
    const APART: f32 = f32::from_bits(0x7780_0000);
    let (sign, size) = (u32::from(bits & 0x8000) << 16, u32::from(bits & 0x7fff) << 13);
    let finite = (f32::from_bits(size) * APART).to_bits();
    let size = if bits & 0x7c00 == 0x7c00 { 0x7f80_0000 | size } else { finite };
    f32::from_bits(sign | size)
}

/// The storage of channels.
pub(crate) struct Stored {
    pub sample: Sample,
    pub transfer: Transfer,
    /// The number of channels of a pixel.
    pub channels: usize,
    /// The number of channels that are colors. A channel after them is opacity.
    pub colors: usize,
}

/// The number of pixels that are decoded together. All their channels stay in the first-level cache, so the memory of a
/// frame is read once.
const BLOCK: usize = 1024;

/// Decodes stored pixels (pixel, channel) to `light` (channel, pixel).
///
/// # Errors
/// Returns [`FrameFault::Value`] for a value outside its range.
pub(crate) fn decode(raw: &[u8], stored: &Stored, curve: &Curve, light: &mut [f32]) -> Result<(), FrameFault> {
    let pixels = light.len() / stored.channels;
    for begin in (0..pixels).step_by(BLOCK) {
        for (channel, light) in light.chunks_exact_mut(pixels).enumerate() {
            let out = &mut light[begin..pixels.min(begin + BLOCK)];
            let coded = stored.transfer == Transfer::Srgb && channel < stored.colors;
            let limit = if channel < stored.colors { (65_504.0, "0 to 65504") } else { (1.0, "an opacity, 0 to 1") };
            let place = Place { raw, first: begin * stored.channels + channel, stride: stored.channels };
            match (stored.sample, coded) {
                (Sample::U8, false) => place.fill(out, |[b]: [u8; 1]| f32::from(b) / 255.0),
                (Sample::U8, true) => place.fill(out, |[b]: [u8; 1]| curve.0[usize::from(b) * 257]),
                (Sample::U16, false) => place.fill(out, |b| f32::from(u16::from_le_bytes(b)) / 65_535.0),
                (Sample::U16, true) => place.fill(out, |b| curve.0[usize::from(u16::from_le_bytes(b))]),
                (Sample::F16, _) => place.fill(out, |b| half(u16::from_le_bytes(b))),
                (Sample::F32, _) => place.fill(out, f32::from_le_bytes),
            }
            if matches!(stored.sample, Sample::F16 | Sample::F32) {
                judge(out, (channel, begin), [0.0, limit.0], limit.1)?;
            }
        }
    }
    Ok(())
}

/// Decodes stored depths to dioptres.
///
/// # Errors
/// Returns [`FrameFault::Value`] for a value outside its range.
pub(crate) fn decode_depth(raw: &[u8], channel: usize, dioptres: &mut [f32]) -> Result<(), FrameFault> {
    Place { raw, first: 0, stride: 1 }.fill(dioptres, f32::from_le_bytes);
    judge(dioptres, (channel, 0), [-100.0, 100.0], "-100 to 100 dioptres")
}

/// A selection of the stored samples.
struct Place<'a> {
    raw: &'a [u8],
    first: usize,
    stride: usize,
}

impl Place<'_> {
    fn fill<const N: usize>(&self, out: &mut [f32], value: impl Fn([u8; N]) -> f32) {
        let samples = &self.raw.as_chunks::<N>().0[self.first..];
        // The samples of a single color have no gaps, so the compiler uses its widest instructions.
        if self.stride == 1 {
            for (to, from) in out.iter_mut().zip(samples) {
                *to = value(*from);
            }
            return;
        }
        for (to, from) in out.iter_mut().zip(samples.iter().step_by(self.stride)) {
            *to = value(*from);
        }
    }
}

/// Refuses values that are out of range. They belong to a channel, from the pixel `begin` on.
fn judge(
    values: &[f32],
    (channel, begin): (usize, usize),
    [least, most]: [f32; 2],
    must: &'static str,
) -> Result<(), FrameFault> {
    // NaN is outside all ranges.
    let is_wrong = |v: &f32| !(*v >= least && *v <= most);
    // The first pass only detects a wrong value, without a branch for each value.
    if !values.iter().fold(false, |wrong, v| wrong | is_wrong(v)) {
        return Ok(());
    }
    let wrong = values.iter().position(is_wrong);
    wrong.map_or(Ok(()), |at| Err(FrameFault::Value { channel, index: begin + at, found: values[at], must }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn halves_have_their_values() {
        let known = [
            (0u16, 0.0f32),
            (0x3c00, 1.0),
            (0xc000, -2.0),
            (0x7bff, 65_504.0),
            (1, 5.960_464_5e-8),
            (0x3555, 0.333_251_95),
        ];
        assert!(known.iter().all(|(bits, value)| half(*bits) == *value), "{:?}", known.map(|(b, _)| half(b)));
        // This checks all values against the definition.
        for bits in 0..=u16::MAX {
            let (exponent, fraction) = (i32::from(bits >> 10 & 31), f64::from(bits & 1023) / 1024.0);
            let size = match exponent {
                0 => fraction * (-14f64).exp2(),
                31 => continue,
                _ => (1.0 + fraction) * f64::from(exponent - 15).exp2(),
            };
            assert_eq!(f64::from(half(bits)), if bits >> 15 == 1 { -size } else { size }, "{bits:#x}");
        }
        assert!(half(0x7c00).is_infinite() && half(0x7e00).is_nan() && half(0x8000).is_sign_negative());
    }

    #[test]
    fn channels_come_apart_and_opacity_is_never_coded() {
        let raw = [0u8, 255, 128, 128, 255, 0];
        let stored = Stored { sample: Sample::U8, transfer: Transfer::Srgb, channels: 2, colors: 1 };
        let mut light = [9.0f32; 6];
        decode(&raw, &stored, &Curve::new(), &mut light).unwrap();
        // The number of pixels is larger than a block and not a multiple of it.
        let many: Vec<u8> = (0..3 * (2 * BLOCK + 77)).map(|i| (i * 7 % 251) as u8).collect();
        let thrice = Stored { transfer: Transfer::Linear, channels: 3, colors: 3, ..stored };
        let mut apart = vec![9.0f32; many.len()];
        decode(&many, &thrice, &Curve::new(), &mut apart).unwrap();
        let pixels = many.len() / 3;
        assert!((0..many.len()).all(|i| apart[i % 3 * pixels + i / 3] == f32::from(many[i]) / 255.0));
        let gray = ((128.0f64 / 255.0 + 0.055) / 1.055).powf(2.4) as f32;
        assert_eq!(light, [0.0, gray, 1.0, 1.0, 128.0 / 255.0, 0.0]);
    }

    #[test]
    fn what_is_no_light_is_refused() {
        let decoded = |value: f32, sample, channels| {
            let raw = value.to_le_bytes();
            let stored = Stored { sample, transfer: Transfer::Linear, channels, colors: 1 };
            decode(&[&[0; 4][..], &raw].concat(), &stored, &Curve::new(), &mut [0.0; 2])
        };
        for bad in [f32::NAN, f32::INFINITY, -1e-7, 1e6] {
            let fault = decoded(bad, Sample::F32, 1).unwrap_err();
            assert!(matches!(fault, FrameFault::Value { channel: 0, index: 1, .. }), "{fault}");
        }
        // The wrong value is far behind the first block.
        let mut raw = vec![0; 8 * (3 * BLOCK + 7)];
        raw[8 * (2 * BLOCK + 5) + 4..][..4].copy_from_slice(&2.0f32.to_le_bytes());
        let stored = Stored { sample: Sample::F32, transfer: Transfer::Linear, channels: 2, colors: 1 };
        let fault = decode(&raw, &stored, &Curve::new(), &mut vec![0.0; 2 * (3 * BLOCK + 7)]).unwrap_err();
        assert!(matches!(fault, FrameFault::Value { channel: 1, index, .. } if index == 2 * BLOCK + 5), "{fault}");
        assert!(decoded(1.5, Sample::F32, 1).is_ok() && decoded(1.5, Sample::F32, 2).is_err(), "an opacity of 1.5");
        assert!(decode_depth(&200.0f32.to_le_bytes(), 3, &mut [0.0]).is_err());
    }
}
