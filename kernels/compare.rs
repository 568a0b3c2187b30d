//! What an image lacks: turns the image into the factor by which each field sample is to be multiplied, and sums the
//! loss. One pupil.

use crate::simd;
use bytemuck::{Pod, Zeroable};

/// `mode`: replace the amplitude by the target's (OPTICS 6b).
pub const PROJECTION: u32 = 0;
/// `mode`: derivative of the squared difference of intensities (OPTICS 4).
pub const INTENSITY: u32 = 1;
/// `mode`: derivative of the squared difference of amplitudes (OPTICS 4).
pub const AMPLITUDE: u32 = 2;

/// One pupil's comparison.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct Args {
    /// Pixels.
    pub count: u32,
    /// [`PROJECTION`], [`INTENSITY`] or [`AMPLITUDE`].
    pub mode: u32,
    /// Exposure s.
    pub exposure: f32,
    /// `2 s g / (F M K B)` for [`INTENSITY`], the same for [`AMPLITUDE`] (whose 2 and 1/2 cancel inside); unused else.
    pub weight: f32,
    /// Added to both sides of the ratio: what is dark must not be divided by nothing.
    pub floor: f32,
    /// Largest ratio of amplitudes in [`PROJECTION`].
    pub limit: f32,
}

/// Pixels whose loss a part holds.
pub const SHARE: usize = 2048;

impl Args {
    /// Parts that the shader leaves the loss in.
    pub fn parts(&self) -> usize {
        (self.count as usize).div_ceil(SHARE)
    }
}

/// `image` (count): intensity in, factor out; `target` (count). Returns the loss, a sum over pixels.
pub fn compare(args: &Args, image: &mut [f32], target: &[f32]) -> f64 {
    let Args { exposure: s, weight, floor, limit, mode, .. } = *args;
    simd(
        #[inline(always)]
        || {
            let mut loss = 0.0f64;
            // Short float32 sums, added up in float64.
            for (image, target) in image.chunks_mut(64).zip(target.chunks(64)) {
                let mut part = [0.0f32; 64];
                match mode {
                    PROJECTION => {
                        for ((i, t), part) in image.iter_mut().zip(target).zip(&mut part) {
                            let seen = s * *i;
                            *part = (seen - t) * (seen - t);
                            *i = ((t + floor) / (seen + floor)).sqrt().min(limit) - 1.0;
                        }
                    }
                    INTENSITY => {
                        for ((i, t), part) in image.iter_mut().zip(target).zip(&mut part) {
                            let rest = s * *i - t;
                            *part = rest * rest;
                            *i = weight * rest;
                        }
                    }
                    _ => {
                        for ((i, t), part) in image.iter_mut().zip(target).zip(&mut part) {
                            let (seen, wanted) = ((s * *i + floor).sqrt(), (t + floor).sqrt());
                            *part = (seen - wanted) * (seen - wanted);
                            *i = 0.5 * weight * (1.0 - wanted / seen);
                        }
                    }
                }
                let mut sum = 0.0f32;
                for p in part {
                    sum += p;
                }
                loss += f64::from(sum);
            }
            loss
        },
    )
}
