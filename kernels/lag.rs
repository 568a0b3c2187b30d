//! First-order lag over the sub-frames of a set that repeats, `m_t = (1 - h) w_t + h m_(t-1)`, or transposed (OPTICS 10).

use crate::drive::Args;

/// `frames`: the same part of each sub-frame. `back`: transposed, from the last to the first.
pub fn lag(args: &Args, back: bool, frames: &mut [&mut [f32]]) {
    let count = frames.len();
    let (h, settled) = (args.lag, args.settled(count));
    let order = |i: usize| if back { count - 1 - i } else { i };
    for k in 0..frames.first().map_or(0, |part| part.len()) {
        let mut state = settled * (0..count).map(order).fold(0.0, |sum, t| sum * h + frames[t][k]);
        for t in (0..count).map(order) {
            state = (1.0 - h) * frames[t][k] + h * state;
            frames[t][k] = state;
        }
    }
}
