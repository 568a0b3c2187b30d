//! Sums the intensity that the eye averages over sub-frames, `image += gain * sum_f |window_f|^2`. One pupil.

use crate::{Complex32, simd};
use bytemuck::{Pod, Zeroable};

/// The number of values, and their scale.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct Args {
    /// Pixels of the window.
    pub count: u32,
    /// Number of sub-frames in `window`.
    pub frames: u32,
    /// The factor `1 / (F share)`. It gives the mean over all F sub-frames, divided by the pupil's share of the eyebox
    /// (OPTICS 2).
    pub gain: f32,
    /// If 0, `image` is overwritten. If 1, the sum is added to it, for sub-frames that arrive in groups.
    pub accumulate: u32,
}

/// Sums `window` (frames, count) into `image` (count).
pub fn intensity(args: &Args, window: &[Complex32], image: &mut [f32]) {
    let (gain, frames) = (args.gain, args.frames as usize);
    if args.accumulate == 0 {
        image.fill(0.0);
    }
    simd(
        #[inline(always)]
        || {
            for frame in window.chunks_exact(args.count as usize).take(frames) {
                for (out, v) in image.iter_mut().zip(frame) {
                    *out += gain * (v.re * v.re + v.im * v.im);
                }
            }
        },
    );
}
