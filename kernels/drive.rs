//! From phases to the phases that their drive gives, by the look-up table of each pixel (OPTICS 10). Sub-frames come in
//! pairs: one is the real part of `wave`, the next the imaginary part, for what follows is real and linear.

use crate::trig::{cos_sin, wrapped};
use crate::{Complex32, ZERO, modulate, simd};
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

/// The phase that the drive of a phase gives.
#[inline(always)]
fn driven(args: &Args, phase: f32, level: f32) -> f32 {
    let w = wrapped(phase);
    let plain = level * w;
    if args.bends() {
        let (c, s) = cos_sin(w);
        plain + (args.bend_sin * s + args.bend_cos * (1.0 - c))
    } else {
        plain
    }
}

/// `level` (height, width), the first table of a pixel; `shown` two sub-frames (height, width), the second empty where their
/// number is odd; `wave` (grid_height, grid_width), zero around the SLM.
pub fn drive(args: &Args, level: &[f32], shown: [&[f32]; 2], wave: &mut [Complex32]) {
    let (place, w, gw) = (args.place, args.place.width as usize, args.place.grid_width as usize);
    simd(
        #[inline(always)]
        || {
            wave.fill(ZERO);
            let rows = wave
                .chunks_exact_mut(gw)
                .skip(place.top as usize)
                .zip(level.chunks_exact(w))
                .take(args.place.height as usize);
            for (y, (wave, level)) in rows.enumerate() {
                let wave = &mut wave[place.left as usize..][..w];
                for ((z, level), phase) in wave.iter_mut().zip(level).zip(&shown[0][y * w..]) {
                    z.re = driven(args, *phase, *level);
                }
                if !shown[1].is_empty() {
                    for ((z, level), phase) in wave.iter_mut().zip(level).zip(&shown[1][y * w..]) {
                        z.im = driven(args, *phase, *level);
                    }
                }
            }
        },
    );
}
