//! Decodes one color of the views of an application to the values that target images are summed from. Samples are 8 or
//! 16 bits or floats, linear or coded in sRGB. Values are whole numbers of 1/65535 of the brightest. The sums of the
//! light are computed on the way.

use crate::half;
use bytemuck::{Pod, Zeroable};

/// Samples are whole numbers of 8 bits, whose largest is full scale.
pub const U8: u32 = 1;
/// Samples are whole numbers of 16 bits, whose largest is full scale.
pub const U16: u32 = 2;
/// Samples are floats of 16 bits, whose 1 is full scale.
pub const F16: u32 = 3;
/// Samples are floats of 32 bits, whose 1 is full scale.
pub const F32: u32 = 4;
/// The largest sample that counts as light, which is the largest finite half.
pub const BRIGHTEST: f32 = 65_504.0;
/// Words of the sums of a part. They are the light, its square, its cube, the brightest value, and the first pixel
/// without valid light.
pub const SUMS: usize = 5;
/// Stored instead of a pixel number if all pixels have valid light.
pub const ALL_LIGHT: u32 = u32::MAX;
/// Number of values of the curve, one for the light of every sample of 16 bits. Samples of 8 bits use every 257th.
pub const CURVE: usize = 65_536;

/// Layout and coding of the views to decode.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct Args {
    /// Pixels of a view.
    pub pixels: u32,
    /// Samples of a pixel.
    pub channels: u32,
    /// Index of the sample in the pixel that is decoded.
    pub channel: u32,
    /// Storage of a sample, one of [`U8`], [`U16`], [`F16`] and [`F32`].
    pub sample: u32,
    /// If not 0, the samples are coded by the sRGB curve, which only whole numbers can be.
    pub coded: u32,
    /// First view in the samples.
    pub first: u32,
    /// Number of values from one view to the next in the output, an even number.
    pub stride: u32,
    /// Light of the value 65535. If it is 0, only the sums are computed and nothing is stored.
    pub scale: f32,
}

/// Returns the light of the sRGB curve at all values of 16 bits.
pub fn curve() -> Vec<f32> {
    let light = |v: f64| if v <= 0.04045 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) };
    (0..CURVE).map(|v| light(v as f64 / 65_535.0) as f32).collect()
}

/// Returns the linear light of a pixel of a view. It is `None` if the value is not finite, below 0 or above 65504.
pub fn light(args: &Args, samples: &[u8], curve: &[f32], view: usize, pixel: usize) -> Option<f32> {
    let at = ((args.first as usize + view) * args.pixels as usize + pixel) * args.channels as usize;
    let at = at + args.channel as usize;
    let two = || u16::from_le_bytes([samples[2 * at], samples[2 * at + 1]]);
    let value = match (args.sample, args.coded != 0) {
        (U8, true) => curve[257 * usize::from(samples[at])],
        (U8, false) => f32::from(samples[at]) / 255.0,
        (U16, true) => curve[usize::from(two())],
        (U16, false) => f32::from(two()) / 65_535.0,
        (F16, _) => half::value(two()),
        _ => f32::from_le_bytes(std::array::from_fn(|i| samples[4 * at + i])),
    };
    (0.0..=BRIGHTEST).contains(&value).then_some(value)
}

/// Writes `values` (height, width) of one view, as many as the slice holds, and `SUMS` words of its light as one part.
/// A pixel without valid light becomes dark.
pub fn decode_views(args: &Args, samples: &[u8], curve: &[f32], view: usize, values: &mut [u16], sums: &mut [u32]) {
    let (mut parts, mut brightest, mut bad) = ([0.0f64; 3], 0.0f32, ALL_LIGHT);
    for (pixel, to) in values.iter_mut().enumerate().take(args.pixels as usize) {
        let found = light(args, samples, curve, view, pixel);
        if found.is_none() {
            bad = bad.min(pixel as u32);
        }
        let value = found.unwrap_or(0.0);
        brightest = brightest.max(value);
        let wide = f64::from(value);
        parts = [parts[0] + wide, parts[1] + wide * wide, parts[2] + wide * wide * wide];
        if args.scale > 0.0 {
            *to = (value / args.scale * 65_535.0 + 0.5) as u16;
        }
    }
    let [one, two, three] = parts.map(|sum| (sum as f32).to_bits());
    sums[..SUMS].copy_from_slice(&[one, two, three, brightest.to_bits(), bad]);
}

#[cfg(test)]
mod tests {
    use super::*;

    const ARGS: Args =
        Args { pixels: 3, channels: 2, channel: 1, sample: U8, coded: 0, first: 0, stride: 4, scale: 1.0 };

    fn decoded(args: &Args, samples: &[u8], view: usize) -> (Vec<u16>, [f64; 4], u32) {
        let (mut values, mut sums) = (vec![0; args.pixels as usize], [0; SUMS]);
        decode_views(args, samples, &curve(), view, &mut values, &mut sums);
        let [one, two, three, brightest, bad] = sums;
        (values, [one, two, three, brightest].map(|bits| f64::from(f32::from_bits(bits))), bad)
    }

    /// Two views of three pixels of two colors are compared with float64.
    #[test]
    fn every_kind_of_sample_is_its_light() {
        let light = |i: usize| (i as f64 * 0.083 + 0.01) % 1.0;
        let coded = |v: f64| if v <= 0.04045 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) };
        let eight = |i: usize| (light(i) * 255.0).round();
        let sixteen = |i: usize| (light(i) * 65_535.0).round();
        for (sample, is_coded) in [(U8, 0), (U8, 1), (U16, 0), (U16, 1), (F32, 0)] {
            let stored = |i: usize| match sample {
                U8 => vec![eight(i) as u8],
                U16 => (sixteen(i) as u16).to_le_bytes().to_vec(),
                _ => (light(i) as f32).to_le_bytes().to_vec(),
            };
            let wanted = |i: usize| match (sample, is_coded) {
                (U8, 0) => eight(i) / 255.0,
                (U8, _) => coded(eight(i) / 255.0),
                (U16, 0) => sixteen(i) / 65_535.0,
                (U16, _) => coded(sixteen(i) / 65_535.0),
                _ => light(i),
            };
            let samples: Vec<u8> = (0..12).flat_map(stored).collect();
            for channel in 0..2 {
                for view in 0..2 {
                    let args = Args { sample, coded: is_coded, channel, ..ARGS };
                    let (values, sums, bad) = decoded(&args, &samples, view);
                    let wanted: Vec<f64> = (0..3).map(|p| wanted((view * 3 + p) * 2 + channel as usize)).collect();
                    let near = values.iter().zip(&wanted).all(|(v, w)| (f64::from(*v) / 65_535.0 - w).abs() < 8e-6);
                    assert!(near, "{sample} {is_coded}: {values:?} {wanted:?}");
                    for (i, sum) in sums[..3].iter().enumerate() {
                        let exact: f64 = wanted.iter().map(|w| w.powi(i as i32 + 1)).sum();
                        assert!((sum - exact).abs() < 1e-6, "{sum} {exact}");
                    }
                    let most = wanted.iter().copied().fold(0.0, f64::max);
                    assert!((sums[3] - most).abs() < 1e-7 && bad == ALL_LIGHT);
                }
            }
        }
    }

    #[test]
    fn halves_and_what_is_no_light() {
        let halves = [0x3c00u16, 0x3800, 1, 0x7bff, 0x7c00, 0x8001].map(u16::to_le_bytes).concat();
        let args = Args { sample: F16, channels: 1, channel: 0, scale: BRIGHTEST, ..ARGS };
        let (values, sums, bad) = decoded(&args, &halves, 0);
        assert_eq!((values, sums[3], bad), (vec![1, 1, 0], 1.0, ALL_LIGHT));
        // The largest half, infinity, and a value below 0.
        let (values, sums, bad) = decoded(&Args { first: 1, ..args }, &halves, 0);
        assert_eq!((values, sums[3], bad), (vec![65_535, 0, 0], f64::from(BRIGHTEST), 1));
        for wrong in [f32::NAN, f32::NEG_INFINITY, -1e-30, 65_505.0] {
            let samples = [0.5f32, 0.25, wrong].map(f32::to_le_bytes).concat();
            let args = Args { sample: F32, channels: 1, channel: 0, ..ARGS };
            assert_eq!(decoded(&args, &samples, 0).2, 2, "{wrong}");
        }
    }
}
