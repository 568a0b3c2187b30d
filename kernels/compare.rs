//! Compares an image with its target. The intensity becomes the factor by which each field sample is to be multiplied,
//! and the loss is summed. One pupil.

use crate::simd;
use bytemuck::{Pod, Zeroable};

/// The `mode` that replaces the amplitude by the target's (OPTICS 6b).
pub const PROJECTION: u32 = 0;
/// The `mode` with the derivative of the squared difference of intensities (OPTICS 4).
pub const INTENSITY: u32 = 1;
/// The `mode` with the derivative of the squared difference of amplitudes (OPTICS 4).
pub const AMPLITUDE: u32 = 2;

/// Parameters of the comparison for one pupil.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct Args {
    /// Number of pixels compared.
    pub count: u32,
    /// One of [`PROJECTION`], [`INTENSITY`] and [`AMPLITUDE`].
    pub mode: u32,
    /// The exposure s of the image.
    pub exposure: f32,
    /// `2 s g / (F M K B)` for [`INTENSITY`] and [`AMPLITUDE`], whose 2 and 1/2 cancel inside. The projection does not
    /// use it.
    pub weight: f32,
    /// Added to both sides of the ratio, so that dark pixels cause no division by zero.
    pub floor: f32,
    /// Largest ratio of amplitudes in [`PROJECTION`].
    pub limit: f32,
}

/// Pixels whose loss one part holds.
pub const SHARE: usize = 2048;

impl Args {
    /// Returns the number of parts in which the shader leaves the loss.
    pub fn parts(&self) -> usize {
        (self.count as usize).div_ceil(SHARE)
    }
}

/// Replaces the intensities in `image` (count) by factors, with `target` (count). Returns the loss, a sum over pixels.
pub fn compare(args: &Args, image: &mut [f32], target: &[f32]) -> f64 {
    let Args { exposure: s, weight, floor, limit, mode, .. } = *args;
    simd(
        #[inline(always)]
        || {
            let mut loss = 0.0f64;
            // Short sums in float32 are added up in float64.
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
