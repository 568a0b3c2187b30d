//! Marks the splats that touch each bin of a picture, so that a tile need not look at all of them.
//!
//! A bin is a square of tiles. A word has the marks of 32 splats in their order, with the first in the lowest bit. So
//! marks need no lists, whose lengths only the device would know.

use crate::draw_splats::{SIDE, Splat};
use bytemuck::{Pod, Zeroable};
use rayon::prelude::*;

/// Rows, and columns, of a bin in pixels.
pub const BIN: u32 = 4 * SIDE;
/// Words that an invocation of `draw_splats` reads together. A bin has a multiple of them.
pub const TOGETHER: u32 = 4;

/// Size of the marks.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
pub struct Args {
    /// Number of splats in the order.
    pub count: u32,
    /// Bins along a row.
    pub across: u32,
    /// Number of bins in the picture.
    pub bins: u32,
    /// Number of words of each bin.
    pub words: u32,
}

impl Args {
    /// Returns the arguments for a number of splats and a picture of this size.
    pub fn new(count: usize, height: usize, width: usize) -> Self {
        let [rows, across] = [height, width].map(|n| (n as u32).div_ceil(BIN));
        Self {
            count: count as u32,
            across,
            bins: rows * across,
            words: (count as u32).div_ceil(32 * TOGETHER) * TOGETHER,
        }
    }
}

/// Writes the marks of all bins, as (bin, word).
pub fn mark_splats(args: &Args, splats: &[Splat], marks: &mut [u32]) {
    marks.par_chunks_mut((args.words as usize).max(1)).enumerate().for_each(|(bin, marks)| {
        let (left, top) = (bin as u32 % args.across * BIN, bin as u32 / args.across * BIN);
        let touches = |span: u32, from: u32| (span & 0xffff) < from + BIN && span >> 16 > from;
        marks.fill(0);
        for (i, splat) in splats.iter().enumerate() {
            marks[i / 32] |= u32::from(touches(splat.columns, left) && touches(splat.rows, top)) << (i % 32);
        }
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_splat_is_marked_in_the_bins_that_it_touches() {
        let args = Args::new(35, 100, 200);
        assert_eq!((args.across, args.bins, args.words), (4, 8, 4));
        let mut splats = vec![Splat::default(); 35];
        let span = |first: u32, end: u32| first | end << 16;
        // One ends before the second bin, and one reaches into the last.
        splats[3] = Splat { columns: span(10, 64), rows: span(0, 65), ..Splat::default() };
        splats[33] = Splat { columns: span(150, 193), rows: span(63, 64), ..Splat::default() };
        let mut marks = vec![9; 32];
        mark_splats(&args, &splats, &mut marks);
        let found: Vec<(usize, u32)> = marks.iter().copied().enumerate().filter(|(_, word)| *word != 0).collect();
        assert_eq!(found, [(0, 8), (9, 2), (13, 2), (16, 8)]);
    }
}
