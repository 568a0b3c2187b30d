//! Turns phases into the phases that their drive gives, with the look-up table of each pixel (OPTICS 10). One frame.

use crate::trig::{cos_sin, wrapped};
use crate::{modulate, simd};
use bytemuck::{Pod, Zeroable};

/// The bend of the look-up table, and the lag.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct Args {
    /// Position of the SLM in the grid.
    pub place: modulate::Args,
    /// First coefficient of the bend of the table in radians, in `b1 sin w + b2 (1 - cos w)`.
    pub bend_sin: f32,
    /// Second coefficient of the bend, b2, in radians.
    pub bend_cos: f32,
    /// Share h of the previous sub-frame that is still visible.
    pub lag: f32,
}

impl Args {
    /// Returns true if the table has a bend.
    pub fn bends(&self) -> bool {
        self.bend_sin != 0.0 || self.bend_cos != 0.0
    }

    /// Returns `(1 - h) / (1 - h^frames)`, the factor that makes the weights of a repeating set add up to 1.
    pub fn settled(&self, frames: usize) -> f32 {
        let h = f64::from(self.lag);
        ((1.0 - h) / (1.0 - h.powi(frames as i32))) as f32
    }
}

/// Writes `wave` (height, width) from the phases `shown` (height, width). `level` (height, width) is the first table of
/// each pixel.
pub fn drive(args: &Args, level: &[f32], shown: &[f32], wave: &mut [f32]) {
    simd(
        #[inline(always)]
        || {
            let values = wave.iter_mut().zip(level.iter().zip(shown));
            if args.bends() {
                for (out, (level, phase)) in values {
                    let w = wrapped(*phase);
                    let (c, s) = cos_sin(w);
                    *out = level * w + (args.bend_sin * s + args.bend_cos * (1.0 - c));
                }
            } else {
                for (out, (level, phase)) in values {
                    *out = level * wrapped(*phase);
                }
            }
        },
    );
}
