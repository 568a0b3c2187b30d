//! Looks up the first phases of each pixel and sub-frame in a table, by brightness and place. The phase is interpolated
//! between two levels of brightness. The place is in a tile that repeats over the SLM. There is no transform.
//! Arithmetic is in whole numbers, so every engine has the same result.

use crate::{binary_angle, simd};
use bytemuck::{Pod, Zeroable};

/// Number of brightnesses for which a table has phases. 1 is the light at every place of the eyebox if the SLM's light
/// is spread evenly.
pub const LEVELS: usize = 17;
/// Level at which the spacing changes. Levels below it are 0.05 apart.
pub const BEND: usize = 4;
/// Factor by which levels are farther apart from the bend on. Brighter light than the last level is treated as the
/// last.
pub const COARSER: usize = 2;
/// Difference in brightness of two levels below the bend.
const FINE: f64 = 0.05;
/// Mask for the index of a level that has another level above it.
const BELOW: usize = LEVELS - 2;
const _: () = assert!((LEVELS - 1).is_power_of_two(), "a mask keeps levels in the table");
/// Number of units between two levels.
const UNIT: u32 = 65_536;

/// Sizes, and the conversion from light to levels.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
pub struct Args {
    /// Rows of the SLM.
    pub height: u32,
    /// Columns of the SLM.
    pub width: u32,
    /// Pixels along a side of the tile, which is square.
    pub side: u32,
    /// First sub-frame of the table that is used.
    pub first: u32,
    /// Number of sub-frames that are used.
    pub frames: u32,
    /// Factor on the light, before the shift.
    pub factor: u32,
    /// Bits (1 to 63) by which the product is shifted down. The result is the position among levels with the finest
    /// spacing, in units of 1 / 65536.
    pub shift: u32,
    /// If not 0, all pixels have the same light.
    pub evenly_lit: u32,
    /// Values from one sub-frame to the next in the output.
    pub stride: u32,
    /// If not 0, the output is binary angles.
    pub angles: u32,
}

impl Args {
    /// Returns the same arguments for pictures in which a light of 2^32 has the brightness `of_all`.
    #[must_use]
    pub fn brightness(self, of_all: f64) -> Self {
        // The number is positive and of ordinary size, so its exponent is the bits of the shift.
        let factor = (of_all / FINE * f64::from(UNIT) / 2f64.powi(32)).clamp(2f64.powi(-30), 2f64.powi(29));
        let exponent = factor.log2().floor() as i32 + 1;
        let mantissa = (factor * 2f64.powi(32 - exponent)).min(f64::from(u32::MAX));
        Self { factor: mantissa as u32, shift: (32 - exponent) as u32, ..self }
    }

    /// Returns the same arguments for light that is already a brightness, as [`add_brightness`] sums it.
    #[must_use]
    pub fn as_it_is(self) -> Self {
        Self { factor: 1 << 31, shift: 31, ..self }
    }
}

/// Returns the brightness of a level.
pub fn level(at: usize) -> f64 {
    let coarse = at.saturating_sub(BEND);
    FINE * (at + (COARSER - 1) * coarse) as f64
}

/// Returns the factor on the light of a pixel that receives the share `lit` of the light of an evenly lit SLM, in units
/// of 1 / 65536.
pub fn need(lit: f32) -> u32 {
    (UNIT as f32 / lit).min(u32::MAX as f32) as u32
}

/// Returns `a * b`, shifted down by `shift` bits, at most 2^31.
#[inline(always)]
fn product(a: u32, b: u32, shift: u32) -> u32 {
    ((u64::from(a) * u64::from(b)) >> shift).min(1 << 31) as u32
}

/// Returns the position of a light among the levels. The high half is the level below, and the low half the way from
/// there to the next level.
#[inline(always)]
fn place(args: &Args, light: u32, need: Option<u32>) -> u32 {
    let (bend, end) = (BEND as u32 * UNIT, (LEVELS as u32 - 1) * UNIT);
    let even = product(light, args.factor, args.shift);
    let at = need.map_or(even, |need| product(even, need, 16));
    let at = if at < bend { at } else { bend + (at - bend) / COARSER as u32 };
    at.min(end - 1)
}

/// Writes the position of each pixel's light among the levels, for [`table_start`], from `light` (height, width) and
/// [`need`]s (the same shape, or `None`). It is the same in all sub-frames.
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

/// Adds the brightness of each pixel to `sums`, in steps of the finest levels over 65536. `light` and [`need`]s are as
/// for [`places`].
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

/// Writes `phases` (rows, width) in radians from -pi to pi, from [`places`] (rows, width) and `table` (side, side,
/// levels), which holds binary angles. The phases are whole binary angles. The rows belong to one sub-frame and begin
/// at `row`.
pub fn table_start(args: &Args, row: usize, places: &[u32], table: &[u16], phases: &mut [f32]) {
    let [width, side] = [args.width, args.side].map(|n| n as usize);
    for (y, (places, phases)) in (row..).zip(places.chunks_exact(width).zip(phases.chunks_exact_mut(width))) {
        let row = &table[y % side * side * LEVELS..][..side * LEVELS];
        for (places, phases) in places.chunks(side).zip(phases.chunks_mut(side)) {
            for ((at, phase), levels) in places.iter().zip(phases).zip(row.as_chunks::<LEVELS>().0) {
                // A place is below the last level. The mask shows this to the compiler.
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

    /// Compared with float64. The test covers the levels, interpolation across the end of a turn, the tile, light
    /// beyond both ends, and pixels with less light.
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
            // The rows are computed in two parts, and the second begins within a tile.
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

    /// The mean brightness of several equal pictures has the position of the picture itself among the levels.
    #[test]
    fn brightness_lies_where_its_light_does() {
        let light: Vec<u32> = (0..300).map(|i| i * 14_211_013).collect();
        let needs: Vec<u32> = (0..300).map(|i| need(0.3 + (i % 5) as f32 / 4.0)).collect();
        for (bright, needs) in [(1.9, None), (1e-3, None), (700.0, None), (1.0, Some(&needs[..]))] {
            let args = Args::zeroed().brightness(bright);
            let (mut sums, mut wanted, mut found) = (vec![0; 300], vec![0; 300], vec![0; 300]);
            places(&args, &light, needs, &mut wanted);
            // Two equal pictures.
            (0..2).for_each(|_| add_brightness(&args, &light, needs, &mut sums));
            let mean: Vec<u32> = sums.iter().map(|sum| (sum / 2) as u32).collect();
            places(&args.as_it_is(), &mean, None, &mut found);
            assert_eq!(found, wanted, "{bright}");
        }
    }
}
