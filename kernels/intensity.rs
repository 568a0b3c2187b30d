//! The intensity that the eye averages over sub-frames: `image += gain * sum_f |window_f|^2`. One pupil.

use crate::{Complex32, simd};
use bytemuck::{Pod, Zeroable};

/// How many values, and their scale.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct Args {
    /// Pixels of the window.
    pub count: u32,
    /// Sub-frames in `window`.
    pub frames: u32,
    /// `1 / (F share)`: the mean over all F sub-frames, divided by the pupil's share of the eyebox (OPTICS 2).
    pub gain: f32,
    /// 0: overwrite `image`; 1: add to it (sub-frames that come in groups).
    pub accumulate: u32,
}

/// `window` (frames, count), `image` (count).
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
