//! Reads the colors and the depths of a frame of an application, and checks them.

use crate::decode_views;
use crate::relief::COLORS;
use bytemuck::{Pod, Zeroable};

/// The largest magnitude of a depth in dioptres.
pub const DEEPEST: f32 = 100.0;
/// Words of the state of a frame, which are the first sample without valid light, the first pixel without valid depth,
/// and the smallest and the largest disparity as [`ordered`] bits.
pub const STATE: usize = 4;
/// The state before a frame is read.
pub const START: [u32; STATE] = [u32::MAX, u32::MAX, u32::MAX, 0];
/// Stored instead of a sample or pixel if all are valid.
pub const ALL_VALID: u32 = u32::MAX;

/// Layout of a frame. The colors (row, column, color) come first.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct Args {
    /// Number of pixels of the frame.
    pub pixels: u32,
    /// Colors of a pixel.
    pub channels: u32,
    /// Indices of the three colors of the picture among them.
    pub wanted: [u32; COLORS],
    /// Storage of a sample, as in [`decode_views::Args::sample`].
    pub sample: u32,
    /// If not 0, the samples are coded by the sRGB curve.
    pub coded: u32,
    /// Place of the depths, which are float32 dioptres, in words of 4 bytes.
    pub depths: u32,
    /// Disparity of a dioptre.
    pub per_dioptre: f32,
}

/// Returns bits that have the order of the numbers.
pub fn ordered(value: f32) -> u32 {
    let bits = value.to_bits();
    if bits >> 31 == 0 { bits | 1 << 31 } else { !bits }
}

/// Returns the number of [`ordered`] bits.
pub fn of_ordered(bits: u32) -> f32 {
    f32::from_bits(if bits >> 31 == 1 { bits & !(1 << 31) } else { !bits })
}

/// Writes the disparities (pixel) and then the colors (pixel, color) of a frame, and updates its state. Invalid values
/// become 0.
pub fn relief_decode(args: &Args, samples: &[u8], curve: &[f32], picture: &mut [f32], state: &mut [u32; STATE]) {
    let pixels = args.pixels as usize;
    let (disparities, colors) = picture.split_at_mut(pixels);
    for (pixel, color) in colors.chunks_exact_mut(COLORS).take(pixels).enumerate() {
        for (to, channel) in color.iter_mut().zip(args.wanted) {
            let of = decode_views::Args {
                pixels: args.pixels,
                channels: args.channels,
                channel,
                sample: args.sample,
                coded: args.coded,
                first: 0,
                stride: 0,
                scale: 0.0,
            };
            let light = decode_views::light(&of, samples, curve, 0, pixel);
            *to = light.unwrap_or(0.0);
            if light.is_none() {
                state[0] = state[0].min(pixel as u32 * args.channels + channel);
            }
        }
    }
    let depths = samples[4 * args.depths as usize..].as_chunks::<4>().0;
    for (pixel, (to, depth)) in disparities.iter_mut().zip(depths).enumerate() {
        let depth = f32::from_le_bytes(*depth);
        let is_valid = (-DEEPEST..=DEEPEST).contains(&depth);
        *to = if is_valid { depth * args.per_dioptre } else { 0.0 };
        if !is_valid {
            state[1] = state[1].min(pixel as u32);
        }
        (state[2], state[3]) = (state[2].min(ordered(*to)), state[3].max(ordered(*to)));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bits_have_the_order_of_their_numbers() {
        let numbers = [f32::NEG_INFINITY, -3.5, -1e-30, -0.0, 0.0, 1e-30, 0.25, 7.0, f32::INFINITY];
        assert!(numbers.windows(2).all(|pair| ordered(pair[0]) < ordered(pair[1])));
        assert!(numbers.iter().all(|number| of_ordered(ordered(*number)).to_bits() == number.to_bits()));
    }
}
