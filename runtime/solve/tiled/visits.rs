//! Orders the visits to regions, and finds their dependencies if several machines take them.
//!
//! Regions that share no pixel are visited side by side. The result equals the one of a single machine, which visits
//! one region after the other.

use super::RegionSize;
use crate::hologram::TileVersion;
use crate::plan::ModelTables;
use crate::solve::SplitMix;
use std::collections::{BTreeSet, HashMap};

/// The regions of a solve, pass by pass. Each pass covers the SLM in a shuffled order, on a grid that is moved at
/// random by whole tiles.
#[derive(Debug, Clone, PartialEq)]
pub struct Schedule {
    /// First pixel (row, column) of each visit.
    pub visits: Vec<[usize; 2]>,
}

impl Schedule {
    /// Creates the schedule over an SLM of `height` x `width` pixels with tiles of `side`.
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
            // This is the shuffle of Fisher and Yates.
            for i in (1..pass.len()).rev() {
                pass.swap(i, (random.unit() * (i + 1) as f64) as usize);
            }
            visits.extend(pass);
        }
        Self { visits }
    }
}

/// Returns the starts of regions along an axis of `n` pixels. Regions overlap by a quarter at whole tiles, and the last
/// one ends at the end.
fn starts(n: usize, region: usize, side: usize, random: &mut SplitMix) -> Vec<usize> {
    if region >= n {
        return vec![0];
    }
    let stride = ((region - region / 4) / side).max(1) * side;
    let moved = (random.unit() * (stride / side) as f64) as usize * side;
    // The last region also begins at a whole tile. It may extend past the end by less than one tile, and is cut.
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

/// The dependencies of the visits of one color.
#[derive(Debug, Clone, PartialEq)]
pub struct Waits {
    /// For each visit, the tiles that it reads, and the earlier visit that changed each of them last.
    reads: Vec<Vec<([usize; 2], Option<usize>)>>,
    /// The visit that changes each tile last of all.
    last: HashMap<[usize; 2], usize>,
}

impl Waits {
    /// Finds the dependencies of the visits of a `schedule`.
    ///
    /// The regions have this `size`, on an SLM of `whole` (rows, columns) pixels in tiles of `side`. `model` is the
    /// display model, which may reach into a region from around it.
    pub fn new(
        schedule: &Schedule,
        size: RegionSize,
        whole: [usize; 2],
        side: usize,
        model: Option<&ModelTables>,
    ) -> Self {
        let (mut reads, mut last) = (Vec::with_capacity(schedule.visits.len()), HashMap::new());
        for (k, &at) in schedule.visits.iter().enumerate() {
            let size = size.inside(at, whole);
            let (first, held) = held(model, at, size);
            let found = tiles(first, held, whole, side).into_iter();
            reads.push(found.map(|tile| (tile, last.get(&tile).copied())).collect());
            for tile in tiles(at.map(|i| i as i64), size, whole, side) {
                last.insert(tile, k);
            }
        }
        Self { reads, last }
    }

    /// Returns the visits for which visit `k` waits, in ascending order.
    pub fn after(&self, k: usize) -> Vec<usize> {
        let before: BTreeSet<usize> = self.reads[k].iter().filter_map(|(_, visit)| *visit).collect();
        before.into_iter().collect()
    }

    /// Returns the version of each tile (row, column) that visit `k` reads. Visit `i` is part `before` + `i` + 1 of the
    /// job.
    pub fn versions(&self, k: usize, before: u64) -> impl Iterator<Item = ([usize; 2], TileVersion)> {
        self.reads[k].iter().map(move |&(tile, visit)| match visit {
            None => (tile, TileVersion::First),
            Some(visit) if self.is_last(tile, visit) => (tile, TileVersion::Last),
            Some(visit) => (tile, TileVersion::Of(before + visit as u64 + 1)),
        })
    }

    /// Returns true if no visit after `k` changes this tile (row, column).
    pub fn is_last(&self, tile: [usize; 2], k: usize) -> bool {
        self.last.get(&tile) == Some(&k)
    }

    /// Returns the visits in the longest chain of dependent visits, which take place one after the other on any number
    /// of machines.
    pub fn longest(&self) -> usize {
        let mut length: Vec<usize> = Vec::with_capacity(self.reads.len());
        for k in 0..self.reads.len() {
            let before = self.reads[k].iter().filter_map(|(_, visit)| *visit).map(|visit| length[visit]).max();
            length.push(before.unwrap_or(0) + 1);
        }
        length.into_iter().max().unwrap_or(0)
    }
}

/// Returns the pixels that an engine holds for a visit, which are its region and the surroundings from which crosstalk
/// reaches into it.
pub(super) fn held(model: Option<&ModelTables>, at: [usize; 2], size: [usize; 2]) -> ([i64; 2], [usize; 2]) {
    model.map_or((at.map(|i| i as i64), size), |model| model.around(at, size))
}

/// Returns the tiles (row, column) that a rectangle touches. It wraps around at the SLM's edges.
fn tiles(first: [i64; 2], size: [usize; 2], whole: [usize; 2], side: usize) -> BTreeSet<[usize; 2]> {
    let along = |k: usize| -> BTreeSet<usize> {
        (0..size[k]).map(|i| (first[k] + i as i64).rem_euclid(whole[k] as i64) as usize / side).collect()
    };
    let columns = along(1);
    along(0).into_iter().flat_map(|row| columns.iter().map(move |&column| [row, column])).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// Every pixel is visited in every pass, regions begin at whole tiles, and the seed decides the whole schedule.
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

    proptest! {
        /// In any order that respects the dependencies, each visit finds every pixel as in the sequential order.
        #[test]
        fn any_order_that_waits_is_the_order_of_one_machine(
            height in 40usize..300, width in 40usize..300, side in 8usize..40, tiles in 1usize..5, passes in 1usize..4, seed in 0u64..99
        ) {
            let region = |n: usize| (tiles * side).min(n);
            let size = RegionSize { rows: region(height), columns: region(width), bytes: 0 };
            let schedule = Schedule::new([height, width], size, side, passes, seed);
            let waits = Waits::new(&schedule, size, [height, width], side, None);
            let grid = [height, width].map(|n| n.div_ceil(side));
            let visits = schedule.visits.len();
            let written = |k: usize| {
                let [rows, columns] = [0, 1].map(|i| {
                    let at = schedule.visits[k][i];
                    at / side..(at + size.inside(schedule.visits[k], [height, width])[i]).div_ceil(side)
                });
                rows.flat_map(move |row| columns.clone().map(move |column| [row, column])).collect::<Vec<_>>()
            };
            // These are the visits that each tile has had when visit k reads it, in sequential order.
            let mut seen = vec![Vec::new(); grid[0] * grid[1]];
            let mut found = Vec::new();
            for k in 0..visits {
                found.push(written(k).iter().map(|t| seen[t[0] * grid[1] + t[1]].last().copied()).collect::<Vec<_>>());
                written(k).iter().for_each(|t| seen[t[0] * grid[1] + t[1]].push(k));
            }
            for (k, found) in found.iter().enumerate() {
                let versions: HashMap<_, _> = waits.versions(k, 0).collect();
                for (tile, before) in written(k).iter().zip(found) {
                    let expected = match before {
                        None => TileVersion::First,
                        Some(v) => TileVersion::Of(*v as u64 + 1),
                    };
                    prop_assert_eq!(versions[tile], expected);
                    prop_assert!(before.is_none_or(|v| waits.after(k).contains(&v)));
                    prop_assert_eq!(waits.is_last(*tile, k), seen[tile[0] * grid[1] + tile[1]].last() == Some(&k));
                }
                prop_assert!(waits.after(k).iter().all(|v| *v < k));
            }
            prop_assert!(waits.longest() >= passes.min(visits) && waits.longest() <= visits);
        }
    }

    #[test]
    fn what_crosstalk_brings_in_is_waited_for_and_goes_round() {
        let found = tiles([-2, 6], [4, 4], [20, 8], 4);
        let expected = [[0, 0], [0, 1], [4, 0], [4, 1]].into();
        assert_eq!(found, expected);
    }
}
