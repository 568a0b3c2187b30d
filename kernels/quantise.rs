//! Moves each phase to the nearest level that an SLM can show, or a share of the way. Distances are around the circle.
//! The method is straight-through. The levels make the field, and the change that they cause moves the phase. One
//! frame.

use crate::{simd, trig};
use bytemuck::{Pod, Zeroable};

/// The number of levels, and the share of the way.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct Args {
    /// Number of pixels of a frame.
    pub count: u32,
    /// Number of levels, 1 to [`MOST`].
    pub levels: u32,
    /// Share of the way to the level, 0 to 1. A solve begins with a small share.
    pub hardness: f32,
}

/// Maximum number of levels.
pub const MOST: usize = 256;

impl Args {
    /// Returns true if the arguments are for frames of `pixels` pixels, and the number of levels is valid.
    pub fn fits(&self, pixels: usize) -> bool {
        self.count as usize == pixels && (1..=MOST).contains(&(self.levels as usize))
    }
}

/// Writes `shown` (count) from `phases` (count), in radians from -pi to pi. `levels` holds at least `args.levels`
/// phases from -pi to pi, in ascending order. Half-way between two levels, the lower one is taken.
pub fn quantise(args: &Args, phases: &[f32], levels: &[f32], shown: &mut [f32]) {
    let levels = &levels[..args.levels as usize];
    let n = levels.len();
    simd(
        #[inline(always)]
        || {
            for (phase, shown) in phases.iter().zip(shown) {
                // Number of levels below the phase, found by bisection.
                let (mut low, mut high) = (0, n);
                while low < high {
                    let middle = (low + high) / 2;
                    if levels[middle] < *phase {
                        low = middle + 1;
                    } else {
                        high = middle;
                    }
                }
                // The two neighboring levels, around the circle.
                let below = levels[(low + n - 1) % n];
                let above = levels[low % n];
                let level = if distance(*phase, below) <= distance(*phase, above) { below } else { above };
                let soft = trig::wrap(*phase + args.hardness * trig::wrap(level - *phase));
                *shown = if args.hardness == 1.0 { level } else { soft };
            }
        },
    );
}

fn distance(a: f32, b: f32) -> f32 {
    let off = (a - b).abs();
    off.min(std::f32::consts::TAU - off)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f32::consts::{PI, TAU};

    #[test]
    fn the_nearest_level_round_the_circle() {
        let levels = [-2.0, -0.5, 0.25, 2.5];
        let phases = [-PI, -2.1, -1.3, -1.2, 0.0, 0.25, 1.3, 1.5, 3.1, -2.8, 2.9];
        let mut shown = [0.0; 11];
        quantise(&Args { count: 11, levels: 4, hardness: 1.0 }, &phases, &levels, &mut shown);
        // -pi is 0.64 from 2.5 around the circle, and 1.14 from -2.
        assert_eq!(shown, [2.5, -2.0, -2.0, -0.5, 0.25, 0.25, 0.25, 2.5, 2.5, -2.0, 2.5]);
        quantise(&Args { count: 11, levels: 1, hardness: 1.0 }, &phases, &[1.0], &mut shown);
        assert_eq!(shown, [1.0; 11]);
        // Half the way, in the shorter direction.
        let half = Args { count: 2, levels: 4, hardness: 0.5 };
        quantise(&half, &[3.1, 0.05], &[-3.1, -0.5, 0.25, 2.0], &mut shown[..2]);
        assert!((shown[0].abs() - PI).abs() < 1e-5 && (shown[1] - 0.15).abs() < 1e-6, "{shown:?}");
    }

    #[test]
    fn no_other_level_is_nearer() {
        for n in [1, 2, 3, 16, 255, 256] {
            let levels: Vec<f32> = (0..n).map(|i| (i as f32 + 0.3 * (i % 2) as f32) * TAU / n as f32 - PI).collect();
            let phases: Vec<f32> = (0..999).map(|i| i as f32 * TAU / 999.0 - PI).collect();
            let mut shown = vec![0.0; 999];
            quantise(&Args { count: 999, levels: n as u32, hardness: 1.0 }, &phases, &levels, &mut shown);
            for (p, s) in phases.iter().zip(&shown) {
                let best = levels.iter().map(|l| distance(*p, *l)).fold(f32::INFINITY, f32::min);
                assert_eq!(distance(*p, *s), best, "{p} of {n}");
            }
        }
    }
}
