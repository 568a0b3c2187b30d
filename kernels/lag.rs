//! First-order lag over the sub-frames of a set that repeats, `m_t = (1 - h) w_t + h m_(t-1)`, or transposed (OPTICS 10).

use crate::{Complex32, drive::Args};

/// `waves`: the pairs of `frames` sub-frames, each the same part of the grid. `back`: transposed, from the last to the first.
pub fn lag(args: &Args, frames: usize, back: bool, waves: &mut [&mut [Complex32]]) {
    let (h, settled) = (args.lag, args.settled(frames));
    let order = |i: usize| if back { frames - 1 - i } else { i };
    for k in 0..waves.first().map_or(0, |w| w.len()) {
        let part = |t: usize, z: &Complex32| if t.is_multiple_of(2) { z.re } else { z.im };
        let sum = (0..frames).map(order).fold(0.0, |sum, t| sum * h + part(t, &waves[t / 2][k]));
        let mut state = settled * sum;
        for t in (0..frames).map(order) {
            let z = &mut waves[t / 2][k];
            state = (1.0 - h) * part(t, z) + h * state;
            *(if t.is_multiple_of(2) { &mut z.re } else { &mut z.im }) = state;
        }
    }
}
