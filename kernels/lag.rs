//! Applies the first-order lag over the sub-frames of a repeating set (OPTICS 10), `m_t = (1 - h) w_t + h m_(t-1)`.

use crate::{drive::Args, simd};

/// Neighboring pixels whose states are computed together.
const LANES: usize = 64;

/// Applies the lag to `frames`, the same part of each sub-frame. If `back` is true, it applies the transpose, from the
/// last sub-frame to the first.
pub fn lag(args: &Args, back: bool, frames: &mut [&mut [f32]]) {
    let count = frames.len();
    let (h, settled) = (args.lag, args.settled(count));
    let order = |i: usize| if back { count - 1 - i } else { i };
    let pixels = frames.first().map_or(0, |part| part.len());
    simd(
        #[inline(always)]
        || {
            for first in (0..pixels).step_by(LANES) {
                let part = first..(first + LANES).min(pixels);
                let mut state = [0.0f32; LANES];
                for t in (0..count).map(order) {
                    state.iter_mut().zip(&frames[t][part.clone()]).for_each(|(s, w)| *s = *s * h + w);
                }
                state.iter_mut().for_each(|s| *s *= settled);
                for t in (0..count).map(order) {
                    for (s, w) in state.iter_mut().zip(&mut frames[t][part.clone()]) {
                        *s = (1.0 - h) * *w + h * *s;
                        *w = *s;
                    }
                }
            }
        },
    );
}
