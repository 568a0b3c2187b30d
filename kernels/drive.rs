//! From phases to the phases that their drive gives, by the look-up table of each pixel (OPTICS 10). One frame.

use crate::trig::{cos_sin, wrapped};
use crate::{modulate, simd};
use bytemuck::{Pod, Zeroable};

/// The look-up table's bend, and the lag.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct Args {
    /// Where the SLM lies in the grid.
    pub place: modulate::Args,
    /// Bend of the table, radians: `b1 sin w`
    pub bend_sin: f32,
    /// `+ b2 (1 - cos w)`.
    pub bend_cos: f32,
    /// Share h of the sub-frame before that is still seen.
    pub lag: f32,
}

impl Args {
    /// Whether the table has a bend.
    pub fn bends(&self) -> bool {
        self.bend_sin != 0.0 || self.bend_cos != 0.0
    }

    /// `(1 - h) / (1 - h^frames)`: what makes the sum of a set that repeats 1.
    pub fn settled(&self, frames: usize) -> f32 {
        let h = f64::from(self.lag);
        ((1.0 - h) / (1.0 - h.powi(frames as i32))) as f32
    }
}

/// `level` (height, width), the first table of a pixel; `shown` and `wave` (height, width).
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
