//! First phases by a table: for each pixel and sub-frame the phase that the table has for the pixel's brightness, between two of its
//! levels, and for the pixel's place in a tile that repeats over the SLM. Nothing is transformed. In whole numbers, so that every
//! engine has the same.

use crate::{binary_angle, simd};
use bytemuck::{Pod, Zeroable};

/// Brightnesses that a table has phases for. 1 is the light that every place of the eyebox has if the SLM's is spread evenly.
pub const LEVELS: usize = 17;
/// Where levels part: below this one they are 0.05 apart, from it on
pub const BEND: usize = 4;
/// so many times that. What is brighter than the last is shown as that.
pub const COARSER: usize = 2;
/// Brightness from one level to the next below the bend.
const FINE: f64 = 0.05;
/// Bits of a level that is below another.
const BELOW: usize = LEVELS - 2;
const _: () = assert!((LEVELS - 1).is_power_of_two(), "a mask keeps levels in the table");
/// Units of a level.
const UNIT: u32 = 65_536;

/// Sizes, and what brings light to levels.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
pub struct Args {
    /// Rows of the SLM.
    pub height: u32,
    /// Columns of the SLM.
    pub width: u32,
    /// Pixels along a side of the tile.
    pub side: u32,
    /// The first sub-frame that is looked up, of those that the table has,
    pub first: u32,
    /// and how many are.
    pub frames: u32,
    /// Light times this,
    pub factor: u32,
    /// moved down by so many bits (1 to 63), is its place among levels that are all as fine, in units of 1 / 65536.
    pub shift: u32,
    /// Whether all pixels have the same light.
    pub evenly_lit: u32,
    /// Values from one sub-frame to the next where the phases are written.
    pub stride: u32,
    /// Whether they are binary angles there.
    pub angles: u32,
}

impl Args {
    /// The same for pictures whose light of 2^32 is so bright.
    #[must_use]
    pub fn brightness(self, of_all: f64) -> Self {
        // A positive number of ordinary size, so that its exponent is one.
        let factor = (of_all / FINE * f64::from(UNIT) / 2f64.powi(32)).clamp(2f64.powi(-30), 2f64.powi(29));
        let exponent = factor.log2().floor() as i32 + 1;
        let mantissa = (factor * 2f64.powi(32 - exponent)).min(f64::from(u32::MAX));
        Self { factor: mantissa as u32, shift: (32 - exponent) as u32, ..self }
    }

    /// The same for light that is brightness already, as [`add_brightness`] has it.
    #[must_use]
    pub fn as_it_is(self) -> Self {
        Self { factor: 1 << 31, shift: 31, ..self }
    }
}

/// The brightness of a level.
pub fn level(at: usize) -> f64 {
    let coarse = at.saturating_sub(BEND);
    FINE * (at + (COARSER - 1) * coarse) as f64
}

/// What a pixel needs more of light because it has so much, over an even SLM's: in units of 1 / 65536, at most 65535.
pub fn need(lit: f32) -> u32 {
    (UNIT as f32 / lit).min(u32::MAX as f32) as u32
}

/// `a * b`, moved down by so many bits, at most 2^31.
#[inline(always)]
fn product(a: u32, b: u32, shift: u32) -> u32 {
    ((u64::from(a) * u64::from(b)) >> shift).min(1 << 31) as u32
}

/// Where a light lies among the levels: in the high half the level below, in the low half the way from there to the next.
#[inline(always)]
fn place(args: &Args, light: u32, need: Option<u32>) -> u32 {
    let (bend, end) = (BEND as u32 * UNIT, (LEVELS as u32 - 1) * UNIT);
    let even = product(light, args.factor, args.shift);
    let at = need.map_or(even, |need| product(even, need, 16));
    let at = if at < bend { at } else { bend + (at - bend) / COARSER as u32 };
    at.min(end - 1)
}

/// Where each pixel's light lies among the levels, for [`table_start`]: from `light` (height, width) and [`need`]s (the same, or none).
/// It is the same in all sub-frames.
pub fn places(args: &Args, light: &[u32], needs: Option<&[u32]>, places: &mut [u32]) {
    simd(
        #[inline(always)]
        || match needs {
            Some(needs) => {
                let both = light.iter().zip(needs).zip(places);
                both.for_each(|((light, need), at)| *at = place(args, *light, Some(*need)));
            }
            None => light.iter().zip(places).for_each(|(light, at)| *at = place(args, *light, None)),
        },
    );
}

/// Adds how bright each pixel is, `light` and [`need`]s as for [`places`], to `sums`, in steps of the finest levels over 65536.
pub fn add_brightness(args: &Args, light: &[u32], needs: Option<&[u32]>, sums: &mut [u64]) {
    let even = |light: &u32| product(*light, args.factor, args.shift);
    match needs {
        Some(needs) => {
            let both = light.iter().zip(needs).zip(sums);
            both.for_each(|((light, need), sum)| *sum += u64::from(product(even(light), *need, 16)));
        }
        None => light.iter().zip(sums).for_each(|(light, sum)| *sum += u64::from(even(light))),
    }
}

/// From [`places`] (rows, width) and `table` (side, side, levels), binary angles, to `phases` (rows, width), radians in -pi .. pi:
/// whole binary angles. Rows of one sub-frame, from `row` on.
pub fn table_start(args: &Args, row: usize, places: &[u32], table: &[u16], phases: &mut [f32]) {
    let [width, side] = [args.width, args.side].map(|n| n as usize);
    for (y, (places, phases)) in (row..).zip(places.chunks_exact(width).zip(phases.chunks_exact_mut(width))) {
        let row = &table[y % side * side * LEVELS..][..side * LEVELS];
        for (places, phases) in places.chunks(side).zip(phases.chunks_mut(side)) {
            for ((at, phase), levels) in places.iter().zip(phases).zip(row.as_chunks::<LEVELS>().0) {
                // A place is below the last level: with the mask the compiler knows it, too.
                let (below, part) = ((at >> 16) as usize & BELOW, at & 0xffff);
                let turn = i32::from(levels[below + 1].wrapping_sub(levels[below]) as i16);
                let by = (turn * part as i32 + 32_768) >> 16;
                *phase = binary_angle::value(levels[below].wrapping_add(by as u16));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Against float64: levels, the way from one to the next across the turn's end, the tile, what is too dark or too bright, and pixels
    /// with less light.
    #[test]
    fn phases_lie_between_those_of_two_levels() {
        let (height, width, side) = (7, 9, 4);
        let table: Vec<u16> = (0..side * side * LEVELS).map(|i| (i * 26_881 % 65_536) as u16).collect();
        let light: Vec<u32> = (0..height * width).map(|i| (i * 37 % 97) as u32 * 44_278_013).collect();
        let needs: Vec<u32> = (0..height * width).map(|i| need(0.2 + (i % 5) as f32 / 4.0)).collect();
        let sizes = Args { height: height as u32, width: width as u32, side: side as u32, ..Args::zeroed() };
        let levels: Vec<f64> = (0..LEVELS).map(level).collect();
        assert!((levels[4] - 0.2).abs() < 1e-9 && (levels[16] - 1.4).abs() < 1e-9, "{levels:?}");
        for (bright, needs) in [(1.9, None), (1e-3, None), (700.0, None), (1e9, None), (1.0, Some(&needs[..]))] {
            let args = sizes.brightness(bright);
            let (mut at, mut phases) = (vec![0; height * width], vec![0.0; height * width]);
            places(&args, &light, needs, &mut at);
            // In two parts, the second of which begins within a tile.
            let (above, below) = phases.split_at_mut(3 * width);
            table_start(&args, 0, &at[..3 * width], &table, above);
            table_start(&args, 3, &at[3 * width..], &table, below);
            for (i, (light, phase)) in light.iter().zip(&phases).enumerate() {
                let (y, x) = (i / width, i % width);
                let lit = needs.map_or(1.0, |needs| 65_536.0 / f64::from(needs[i]));
                let wanted = (f64::from(*light) / 2f64.powi(32) * bright / lit).min(1.4);
                let below = (0..LEVELS - 1).rev().find(|at| levels[*at] <= wanted + 1e-9).unwrap();
                let part = (wanted - levels[below]) / (levels[below + 1] - levels[below]);
                let at = (y % side * side + x % side) * LEVELS + below;
                let step = f64::from(table[at + 1].wrapping_sub(table[at]) as i16);
                let off = f64::from(table[at]) + part * step - f64::from(*phase) / std::f64::consts::TAU * 65_536.0;
                let off = off - 65_536.0 * (off / 65_536.0).round();
                assert!(off.abs() < 1.6, "{bright}, {i}: {off}");
            }
        }
    }

    /// Brightness that is added up, of one picture, lies among the levels where the picture itself does.
    #[test]
    fn brightness_lies_where_its_light_does() {
        let light: Vec<u32> = (0..300).map(|i| i * 14_211_013).collect();
        let needs: Vec<u32> = (0..300).map(|i| need(0.3 + (i % 5) as f32 / 4.0)).collect();
        for (bright, needs) in [(1.9, None), (1e-3, None), (700.0, None), (1.0, Some(&needs[..]))] {
            let args = Args::zeroed().brightness(bright);
            let (mut sums, mut wanted, mut found) = (vec![0; 300], vec![0; 300], vec![0; 300]);
            places(&args, &light, needs, &mut wanted);
            // Of two alike.
            (0..2).for_each(|_| add_brightness(&args, &light, needs, &mut sums));
            let mean: Vec<u32> = sums.iter().map(|sum| (sum / 2) as u32).collect();
            places(&args.as_it_is(), &mean, None, &mut found);
            assert_eq!(found, wanted, "{bright}");
        }
    }
}
