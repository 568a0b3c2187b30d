//! First phases by a table: for each pixel and sub-frame the phase that the table has for the pixel's brightness, between two of its
//! levels, and for the pixel's place in a tile that repeats over the SLM. Nothing is transformed.

use crate::{binary_angle, simd};
use bytemuck::{Pod, Zeroable};

/// Brightnesses that a table has phases for. 1 is the light that every place of the eyebox has if the SLM's is spread evenly.
pub const LEVELS: usize = 17;
/// The last of them; what is brighter is shown so.
pub const BRIGHTEST: f32 = 1.4;
/// Below `BEND` levels are `1 / FINE` apart, above it `1 / COARSE`.
const BEND: f32 = 0.2;
const FINE: f32 = 20.0;
const COARSE: f32 = 10.0;

/// Sizes, and what brings a picture to the table's brightness.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct Args {
    /// Rows of the SLM.
    pub height: u32,
    /// Columns of the SLM.
    pub width: u32,
    /// Pixels along a side of the tile.
    pub side: u32,
    /// Brightness of the light 1: one over the exposure.
    pub share: f32,
}

/// The brightness of a level.
pub fn level(at: usize) -> f32 {
    let bend = (BEND * FINE) as usize;
    if at < bend { at as f32 / FINE } else { BEND + (at - bend) as f32 / COARSE }
}

/// The level below a brightness, and how far it is from there to the next, 0 to 1.
#[inline(always)]
fn place(light: f32, share: f32) -> (usize, f32) {
    let brightness = (light * share).clamp(0.0, BRIGHTEST);
    let at = if brightness < BEND { brightness * FINE } else { BEND * FINE + (brightness - BEND) * COARSE };
    let below = (at as usize).min(LEVELS - 2);
    (below, at - below as f32)
}

/// From `table` (side, side, levels), binary angles, and `light` (height, width) to `phases` (height, width), radians in -pi .. pi:
/// whole binary angles. One sub-frame.
pub fn table_start(args: &Args, table: &[u16], light: &[f32], phases: &mut [f32]) {
    let [width, side] = [args.width, args.side].map(|n| n as usize);
    let lines = light.chunks_exact(width).zip(phases.chunks_exact_mut(width));
    for (y, (light, phases)) in lines.enumerate() {
        let row = &table[y % side * side * LEVELS..][..side * LEVELS];
        simd(
            #[inline(always)]
            || {
                for (x, (light, phase)) in light.iter().zip(phases).enumerate() {
                    let (below, part) = place(*light, args.share);
                    let angles = &row[x % side * LEVELS + below..][..2];
                    *phase = binary_angle::between([angles[0], angles[1]], part);
                }
            },
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f32::consts::PI;
    use std::f64::consts::TAU;

    /// Against float64: levels, the way from one to the next across the turn's end, the tile, and what is too dark or too bright.
    #[test]
    fn phases_lie_between_those_of_two_levels() {
        let (height, width, side) = (7, 9, 4);
        let table: Vec<u16> = (0..side * side * LEVELS).map(|i| (i * 26_881 % 65_536) as u16).collect();
        let light: Vec<f32> = (0..height * width).map(|i| (i * 37 % 97) as f32 / 97.0 * 1.2 - 0.05).collect();
        let args = Args { height: height as u32, width: width as u32, side: side as u32, share: 1.6 };
        let mut phases = vec![0.0; height * width];
        table_start(&args, &table, &light, &mut phases);
        let levels: Vec<f64> = (0..LEVELS).map(|at| f64::from(level(at))).collect();
        assert!((levels[4] - 0.2).abs() < 1e-6 && (levels[16] - 1.4).abs() < 1e-6, "{levels:?}");
        for (i, (light, phase)) in light.iter().zip(&phases).enumerate() {
            let (y, x) = (i / width, i % width);
            let wanted = (f64::from(*light) * 1.6).clamp(0.0, 1.4);
            let below = (0..LEVELS - 1).rev().find(|at| levels[*at] <= wanted + 1e-7).unwrap();
            let part = (wanted - levels[below]) / (levels[below + 1] - levels[below]);
            let at = (y % side * side + x % side) * LEVELS + below;
            let turns = [table[at], table[at + 1]].map(|angle| f64::from(angle) / 65_536.0);
            let step = turns[1] - turns[0];
            let step = if step >= 0.5 {
                step - 1.0
            } else if step < -0.5 {
                step + 1.0
            } else {
                step
            };
            let off = (turns[0] + part * step) - f64::from(*phase) / TAU;
            assert!((off - off.round()).abs() < 2e-5, "{i}: {off}");
            assert!((-PI..=PI).contains(phase));
        }
    }
}
