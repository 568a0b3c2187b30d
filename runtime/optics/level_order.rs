//! Finds mistakes in the memory cells and the level table of a modulator from the order of its levels as it was seen.
//!
//! The heights of a PLM's mirrors rise from level to level. If the cells of the mirrors are upside down, most levels
//! show the height of another level (docs/plm.md).

use super::Encoding;
use eyebox_base::error::Reason;
use eyebox_base::reason;
use serde::Serialize;

/// The conclusion from an order of levels.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
#[serde(tag = "kind", rename_all = "kebab-case")]
#[non_exhaustive]
pub enum LevelOrder {
    /// The phase rises from level to level.
    Rising,
    /// The phase falls from level to level, so the sign is wrong or the order was given backwards.
    Falling,
    /// The cells of the mirrors are upside down.
    UpsideDownCells,
    /// The cells of the mirrors are swapped left to right.
    MirroredCells,
    /// The cells of the mirrors are turned by 180 degrees.
    TurnedCells,
    /// The levels do not rise, and no arrangement of the cells explains it.
    NotRising {
        /// The fewest levels whose removal leaves a rising table.
        levels: Vec<usize>,
    },
}

impl Encoding {
    /// Returns the level whose phase each level shows if the cells of a mirror are read upside down or left to right.
    /// Levels without such a level are left as they are.
    fn levels_with_cells(&self, levels: usize, upside_down: bool, mirrored: bool) -> Vec<usize> {
        let code = |level: usize| self.codes.get(level).map_or(level, |code| usize::from(*code));
        let rows = self.cells.len();
        // The bit that the cell of each bit receives.
        let mut received: Vec<(u8, u8)> = Vec::new();
        for (y, row) in self.cells.iter().enumerate() {
            for (x, bit) in row.iter().enumerate() {
                let from = &self.cells[if upside_down { rows - 1 - y } else { y }];
                let from_x = if mirrored { (row.len() - 1).saturating_sub(x) } else { x };
                received.push((*bit, from.get(from_x).copied().unwrap_or(*bit)));
            }
        }
        let shown = |level: usize| {
            let wanted = code(level);
            let bit = |(bit, from): &(u8, u8)| (wanted >> (from & 7) & 1) << (bit & 7);
            let got = received.iter().map(bit).fold(0, |all, bit| all | bit);
            (0..levels).find(|other| code(*other) == got).unwrap_or(level)
        };
        (0..levels).map(shown).collect()
    }

    /// Judges an order of all `levels` of the modulator, from the smallest phase that was seen to the largest.
    ///
    /// # Errors
    /// A reason if the order does not have each level once.
    pub fn judge_levels(&self, levels: usize, seen: &[usize]) -> Result<LevelOrder, Reason> {
        let mut sorted = seen.to_vec();
        sorted.sort_unstable();
        if !sorted.iter().copied().eq(0..levels) || levels == 0 {
            return Err(reason!(
                "level-order",
                "the order has {} levels, but it must have each level from 0 to {} once",
                seen.len(),
                levels.saturating_sub(1)
            ));
        }
        if seen.is_sorted() {
            return Ok(LevelOrder::Rising);
        }
        if seen.iter().rev().is_sorted() {
            return Ok(LevelOrder::Falling);
        }
        let arrangements = [
            (true, false, LevelOrder::UpsideDownCells),
            (false, true, LevelOrder::MirroredCells),
            (true, true, LevelOrder::TurnedCells),
        ];
        for (upside_down, mirrored, order) in arrangements {
            let shown = self.levels_with_cells(levels, upside_down, mirrored);
            let mut expected: Vec<usize> = (0..levels).collect();
            expected.sort_by_key(|level| shown[*level]);
            if expected == seen {
                return Ok(order);
            }
        }
        Ok(LevelOrder::NotRising { levels: out_of_place(seen) })
    }
}

/// Returns the values that are not part of the longest rising subsequence, in rising order.
fn out_of_place(seen: &[usize]) -> Vec<usize> {
    // The length of the longest rising subsequence that ends at each place, and the place before it.
    let mut best: Vec<(usize, Option<usize>)> = Vec::new();
    for (at, value) in seen.iter().enumerate() {
        let before = (0..at).filter(|before| seen[*before] < *value).max_by_key(|before| best[*before].0);
        best.push((1 + before.map_or(0, |before| best[before].0), before));
    }
    let mut rising = Vec::new();
    let mut at = (0..seen.len()).max_by_key(|at| best[*at].0);
    while let Some(place) = at {
        rising.push(seen[place]);
        at = best[place].1;
    }
    let mut out: Vec<usize> = seen.iter().copied().filter(|value| !rising.contains(value)).collect();
    out.sort_unstable();
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Display;

    fn plm() -> Encoding {
        Display::preset("plm").unwrap().encoding
    }

    /// The orders that were computed for TI's cells and codes.
    #[test]
    fn cells_upside_down_exchange_twelve_of_sixteen_levels() {
        let shown = plm().levels_with_cells(16, true, false);
        assert_eq!(shown, [0, 2, 1, 8, 4, 10, 9, 11, 3, 6, 5, 7, 12, 14, 13, 15]);
        assert_eq!(plm().levels_with_cells(16, false, false), (0..16).collect::<Vec<_>>());
    }

    #[test]
    fn an_order_names_the_mistake() {
        let judge = |seen: &[usize]| plm().judge_levels(16, seen).unwrap();
        let order_of = |upside_down, mirrored| {
            let shown = plm().levels_with_cells(16, upside_down, mirrored);
            let mut seen: Vec<usize> = (0..16).collect();
            seen.sort_by_key(|level| shown[*level]);
            seen
        };
        let rising: Vec<usize> = (0..16).collect();
        let falling: Vec<usize> = (0..16).rev().collect();
        assert_eq!((judge(&rising), judge(&falling)), (LevelOrder::Rising, LevelOrder::Falling));
        assert_eq!(judge(&order_of(true, false)), LevelOrder::UpsideDownCells);
        assert_eq!(judge(&order_of(false, true)), LevelOrder::MirroredCells);
        assert_eq!(judge(&order_of(true, true)), LevelOrder::TurnedCells);
        let mut swapped = rising.clone();
        swapped.swap(9, 10);
        let LevelOrder::NotRising { levels } = judge(&swapped) else { panic!("{swapped:?}") };
        assert!(levels == [9] || levels == [10], "{levels:?}");
        let mut moved = rising;
        let first = moved.remove(0);
        moved.push(first);
        assert_eq!(judge(&moved), LevelOrder::NotRising { levels: vec![0] });
    }

    #[test]
    fn an_order_has_each_level_once() {
        for seen in [&[][..], &[0, 1], &[0, 0, 1, 2], &[0, 1, 2, 4], &[usize::MAX; 4]] {
            assert_eq!(Encoding::default().judge_levels(4, seen).unwrap_err().code(), "level-order", "{seen:?}");
        }
        assert_eq!(Encoding::default().judge_levels(4, &[0, 1, 2, 3]), Ok(LevelOrder::Rising));
        assert!(Encoding::default().judge_levels(0, &[]).is_err());
    }
}
