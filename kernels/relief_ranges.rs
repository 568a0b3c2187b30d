//! Finds the smallest and the largest disparity of each block of pixels, so that drawing visits only the blocks that may
//! be seen at a pixel.

use crate::relief::{ABSENT, Args};
use rayon::prelude::*;

/// Rows, and columns, of a block in pixels.
pub const SIDE: u32 = 8;
/// Values of a block, which are the ends for the surface in front with its fringe, and for the hidden one.
pub const VALUES: usize = 4;

/// Returns the number of blocks along a column and a row.
pub fn blocks(args: &Args) -> [usize; 2] {
    args.size().map(|n| n.div_ceil(SIDE as usize))
}

/// Writes the ends (row, column, [`VALUES`]) of all blocks. The first is larger than the second if there is no surface.
pub fn relief_ranges(args: &Args, front: &[f32], fringe: &[f32], hidden: &[f32], ranges: &mut [f32]) {
    let ([tall, wide], side, across) = (args.size(), SIDE as usize, blocks(args)[1]);
    ranges.par_chunks_exact_mut(VALUES).enumerate().for_each(|(block, ends)| {
        let (left, top) = (block % across * side, block / across * side);
        ends.copy_from_slice(&[-ABSENT, ABSENT, -ABSENT, ABSENT]);
        for y in top..(top + side).min(tall) {
            for p in (left..(left + side).min(wide)).map(|x| y * wide + x) {
                for (at, value) in [(0, front[p]), (0, fringe[p]), (2, hidden[p])] {
                    if value > ABSENT {
                        (ends[at], ends[at + 1]) = (ends[at].min(value), ends[at + 1].max(value));
                    }
                }
            }
        }
    });
}
