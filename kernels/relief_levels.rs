//! Marks the levels of disparity that occur in each block of pixels, so that drawing visits only the pixels that may be
//! seen at a pixel.

use crate::relief::{ABSENT, Args};
use bytemuck::{Pod, Zeroable};
use rayon::prelude::*;

/// Rows, and columns, of a block in pixels.
pub const SIDE: u32 = 8;
/// Number of levels, each a bit of a word.
pub const LEVELS: u32 = 32;
/// Words of a block, which are the levels of the surface in front with its fringe, and of the hidden one.
pub const WORDS: usize = 2;

/// Disparities from the largest to the smallest in equal levels.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct Levels {
    /// Smallest disparity of the picture.
    pub low: f32,
    /// Largest disparity of the picture.
    pub high: f32,
    /// Number of levels per disparity.
    pub scale: f32,
}

impl Levels {
    /// Returns the levels between the smallest and the largest disparity, if the outermost view is `reach` views from
    /// the center. Within a level, content moves by at least a pixel there, because every level costs time.
    pub fn new([low, high]: [f32; 2], reach: f32) -> Self {
        let scale = (LEVELS as f32 / (high - low)).min(reach.max(0.5));
        Self { low, high, scale: if high > low { scale } else { 0.0 } }
    }

    /// Returns the level of a disparity, which is 0 for the nearest content.
    pub fn of(&self, disparity: f32) -> u32 {
        (((self.high - disparity) * self.scale) as u32).min(LEVELS - 1)
    }
}

/// Returns the number of blocks along a column and a row.
pub fn blocks(args: &Args) -> [usize; 2] {
    args.size().map(|n| n.div_ceil(SIDE as usize))
}

/// Writes the marks (row, column, [`WORDS`]) of all blocks.
pub fn relief_levels(args: &Args, levels: &Levels, front: &[f32], fringe: &[f32], hidden: &[f32], marks: &mut [u32]) {
    let ([tall, wide], side, across) = (args.size(), SIDE as usize, blocks(args)[1]);
    marks.par_chunks_exact_mut(WORDS).enumerate().for_each(|(block, words)| {
        let (left, top) = (block % across * side, block / across * side);
        words.fill(0);
        for y in top..(top + side).min(tall) {
            for p in (left..(left + side).min(wide)).map(|x| y * wide + x) {
                for (word, value) in [(0, front[p]), (0, fringe[p]), (1, hidden[p])] {
                    if value > ABSENT {
                        words[word] |= 1 << levels.of(value);
                    }
                }
            }
        }
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn levels_begin_with_the_nearest_content() {
        let levels = Levels::new([-4.0, 12.0], 50.0);
        assert_eq!([12.0, 11.6, 11.5, 4.0, -3.9, -4.0].map(|d| levels.of(d)), [0, 0, 1, 16, 31, 31]);
        let few = Levels::new([-4.0, 12.0], 1.0);
        assert_eq!([12.0, 11.6, 11.0, 4.0, -3.9, -4.0].map(|d| few.of(d)), [0, 0, 1, 8, 15, 16]);
        for flat in [[2.0, 2.0], [0.0, 1e-45]] {
            assert_eq!(flat.map(|d| Levels::new(flat, 2.0).of(d)), [0, 0]);
        }
    }
}
