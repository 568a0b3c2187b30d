//! Which regions are visited, and in which order.

use super::RegionSize;
use crate::solve::SplitMix;

/// The regions of a solve, pass by pass: each covers the SLM, on a grid that is moved at random by whole tiles, in a
/// shuffled order.
#[derive(Debug, Clone, PartialEq)]
pub struct Schedule {
    /// (row, column) of each visit's first pixel.
    pub visits: Vec<[usize; 2]>,
}

impl Schedule {
    /// Over an SLM of `height` x `width` pixels with tiles of `side`.
    pub fn new([height, width]: [usize; 2], size: RegionSize, side: usize, passes: usize, seed: u64) -> Self {
        let mut random = SplitMix(seed ^ 0x7669_7369_7473);
        let mut visits = Vec::new();
        for _ in 0..passes {
            let mut pass = Vec::new();
            let rows = starts(height, size.rows, side, &mut random);
            let columns = starts(width, size.columns, side, &mut random);
            for &row in &rows {
                pass.extend(columns.iter().map(|&column| [row, column]));
            }
            // Fisher and Yates.
            for i in (1..pass.len()).rev() {
                pass.swap(i, (random.unit() * (i + 1) as f64) as usize);
            }
            visits.extend(pass);
        }
        Self { visits }
    }
}

/// Where regions begin along an axis of `n` pixels: they overlap by a quarter, at whole tiles, and the last ends at the end.
fn starts(n: usize, region: usize, side: usize, random: &mut SplitMix) -> Vec<usize> {
    if region >= n {
        return vec![0];
    }
    let stride = ((region - region / 4) / side).max(1) * side;
    let moved = (random.unit() * (stride / side) as f64) as usize * side;
    // The last region begins at a whole tile, too: it may hang over by less than one, and is cut.
    let last = (n - region).div_ceil(side) * side;
    let mut found = vec![0];
    let mut at = moved;
    while at < last {
        if at > 0 {
            found.push(at);
        }
        at += stride;
    }
    found.push(last);
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// Every pixel is visited in every pass, regions begin at whole tiles, and the seed decides all of it.
        #[test]
        fn every_pass_covers_everything(height in 1usize..900, width in 1usize..900, side in 1usize..80, tiles in 1usize..9, passes in 1usize..4, seed in 0u64..99) {
            let region = |n: usize| (tiles * side).min(n);
            let size = RegionSize { rows: region(height), columns: region(width), bytes: 0 };
            let schedule = Schedule::new([height, width], size, side, passes, seed);
            prop_assert_eq!(&schedule, &Schedule::new([height, width], size, side, passes, seed));
            for k in 0..2 {
                let (n, region) = ([height, width][k], [size.rows, size.columns][k]);
                let mut hit = vec![0; n];
                for visit in &schedule.visits {
                    prop_assert!(visit[k] < n && visit[k] % side == 0);
                    hit[visit[k]..(visit[k] + region).min(n)].iter_mut().for_each(|h| *h += 1);
                }
                prop_assert!(hit.iter().all(|h| *h >= passes));
            }
        }
    }
}
