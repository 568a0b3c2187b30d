//! Whether the pictures show that cameras do not stand as views are read.
//!
//! From column to column of a grid content moves along the rows of pixels, from row to row along their columns, and twice as
//! far to the second neighbor as to the first. Views of one row that is laid out in tiles, of cameras that are unevenly spaced,
//! and of cameras that stand anywhere do not.

use super::cameras::{CamerasFound, FirstTile, Tiles};
use super::neighbors::{Found, Patches};
use super::{LightField, SceneError};

/// Patches that decide, at least.
const LEAST: usize = 8;
/// Views are no neighbors if no larger share of their patches is found again.
const SEEN_AGAIN: f64 = 0.15;
/// A patch moved if it did so by this many pixels of the small copies.
const MOVED: f64 = 0.4;
/// It moved along an axis if it moved across it by no more pixels, and by no larger share.
const ACROSS: [f64; 2] = [0.3, 0.2];
/// Shares of the patches that move along an axis: most, and too few.
const MOST: f64 = 0.7;
const FEW: f64 = 0.5;
/// The variance of a patch that differs by more times is that of another focus.
const CONTRAST: f32 = 2.0;
/// Neighbors on each side whose spacing is compared.
const SPACED: isize = 3;
/// Spacings of one row that differ by as many times are uneven.
const UNEVEN: f64 = 1.7;
/// Pixels of the small copies by which a patch moves at least whose camera's position is measured.
const SPREAD: f64 = 2.0;
/// Movements that are explained by a spacing leave no larger share of their squares.
const EXPLAINED: f64 = 0.1;

impl CamerasFound {
    /// The refusal of a scene.
    pub(super) fn of(self, scene: &str) -> SceneError {
        SceneError::Cameras { scene: scene.into(), found: self }
    }
}

/// Views of the central row, or of the central column.
struct Line {
    /// Steps from the central view, and what became of its patches there.
    views: Vec<(isize, Vec<Found>)>,
}

impl Line {
    fn movements(&self) -> impl Iterator<Item = [f64; 2]> {
        let moved = |found: &Found| match found {
            Found::Moved(by) if by[0].hypot(by[1]) >= MOVED => Some(*by),
            _ => None,
        };
        self.views.iter().flat_map(|(_, found)| found).filter_map(moved)
    }

    /// Share of the movements that are along x (0) or y (1), and how many there are.
    fn along(&self, axis: usize) -> (f64, usize) {
        let along = |by: &[f64; 2]| by[1 - axis].abs() <= ACROSS[0] + ACROSS[1] * by[axis].abs();
        let count = self.movements().count();
        (self.movements().filter(along).count() as f64 / count.max(1) as f64, count)
    }

    /// Share of the patches that are found again in the nearest views, and how many patches are or are not.
    fn again(&self) -> (f64, usize) {
        let nearest = self.views.iter().map(|(step, _)| step.unsigned_abs()).min().unwrap_or(0);
        let near = || self.views.iter().filter(|(step, _)| step.unsigned_abs() == nearest).flat_map(|(_, found)| found);
        let seen = near().filter(|found| matches!(found, Found::Moved(_))).count();
        let all = seen + near().filter(|found| matches!(found, Found::Nowhere)).count();
        (seen as f64 / all.max(1) as f64, all)
    }

    /// Positions of the cameras, the mean spacing is 1, by what moves along an axis; none where that does not tell.
    fn positions(&self, axis: usize) -> Option<Vec<f64>> {
        let steps: Vec<f64> = self.views.iter().map(|(step, _)| *step as f64).collect();
        if steps.len() < 2 {
            return None;
        }
        // Patches that are found in all views, and movements of each.
        let patches: Vec<Vec<f64>> = (0..self.views[0].1.len())
            .filter_map(|p| {
                let by = |found: &Found| match found {
                    Found::Moved(by) => Some(by[axis]),
                    _ => None,
                };
                self.views.iter().map(|(_, found)| by(&found[p])).collect::<Option<Vec<f64>>>()
            })
            .filter(|moves| moves.iter().any(|by| by.abs() >= SPREAD))
            .collect();
        if patches.len() < LEAST {
            return None;
        }
        let mut positions = steps.clone();
        for _ in 0..20 {
            let squares = positions.iter().map(|x| x * x).sum::<f64>().max(1e-9);
            let rate = |moves: &Vec<f64>| moves.iter().zip(&positions).map(|(m, x)| m * x).sum::<f64>() / squares;
            let rates: Vec<f64> = patches.iter().map(rate).collect();
            let power = rates.iter().map(|r| r * r).sum::<f64>().max(1e-9);
            let at = |k: usize| patches.iter().zip(&rates).map(|(moves, r)| moves[k] * r).sum::<f64>() / power;
            positions = (0..steps.len()).map(at).collect();
        }
        let squares = positions.iter().map(|x| x * x).sum::<f64>().max(1e-9);
        let (mut left, mut all) = (0.0, 0.0);
        for moves in &patches {
            let rate = moves.iter().zip(&positions).map(|(m, x)| m * x).sum::<f64>() / squares;
            left += moves.iter().zip(&positions).map(|(m, x)| (m - rate * x).powi(2)).sum::<f64>();
            all += moves.iter().map(|m| m * m).sum::<f64>();
        }
        if left > EXPLAINED * all {
            return None;
        }
        let middle = steps.partition_point(|step| *step < 0.0);
        positions.insert(middle, 0.0);
        let span = positions[positions.len() - 1] - positions[0];
        let unit = span / (positions.len() - 1) as f64;
        (unit.abs() > 1e-6).then(|| positions.iter().map(|x| x / unit).collect())
    }
}

impl LightField {
    /// Refuses views whose pictures show that their cameras do not stand on the grid of the views.
    ///
    /// # Errors
    /// [`SceneError::Cameras`].
    pub fn check_cameras(&self) -> Result<(), SceneError> {
        contradicted(self).map_or(Ok(()), |found| Err(found.of(&self.name)))
    }
}

/// What the pictures show against the grid in which views are read; none where they do not contradict it.
pub(super) fn contradicted(field: &LightField) -> Option<CamerasFound> {
    let [rows, columns] = field.grid;
    if rows * columns < 2 {
        return None;
    }
    let (r, c) = (rows / 2, columns / 2);
    let patches = Patches::of(field, r * columns + c)?;
    if patches.count() < LEAST {
        return None;
    }
    let lines = [
        line(field, &patches, columns, c, |column| r * columns + column),
        line(field, &patches, rows, r, |row| row * columns + c),
    ];
    for line in lines.iter().filter(|line| !line.views.is_empty()) {
        let (share, count) = line.again();
        if count >= LEAST && share < SEEN_AGAIN {
            return Some(CamerasFound::Unlike((100.0 * share) as u8));
        }
    }
    if in_one_place(field, &patches, &lines) {
        return Some(CamerasFound::OnePlace);
    }
    // As named, or transposed: the order is another question.
    let share = |axes: [usize; 2]| {
        let [a, b] = [0, 1].map(|i| lines[i].along(axes[i]));
        ((a.0 * a.1 as f64 + b.0 * b.1 as f64) / (a.1 + b.1).max(1) as f64, [a, b])
    };
    let [named, transposed] = [share([0, 1]), share([1, 0])];
    // Rows that move alone along the columns' axis are no transposed grid: that moves along both axes alike.
    let both = lines.iter().all(|line| line.views.is_empty() || line.movements().count() >= LEAST);
    let (axes, all) = if named.0 >= transposed.0 || !both { ([0, 1], named) } else { ([1, 0], transposed) };
    let poor = all.1.iter().any(|(share, count)| *count >= LEAST && *share < FEW);
    if poor {
        let tiles = row_in_tiles(field, &lines);
        return Some(tiles.map_or(CamerasFound::Elsewhere((100.0 * all.0) as u8), CamerasFound::RowInTiles));
    }
    let uneven = |(i, axis): (usize, usize)| {
        let positions = lines[i].positions(axis)?;
        let steps: Vec<f64> = positions.windows(2).map(|w| w[1] - w[0]).collect();
        let (least, most) = steps.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), s| (a.min(*s), b.max(*s)));
        (least <= 0.0 || most > UNEVEN * least).then_some(CamerasFound::Uneven { columns: i == 0, positions })
    };
    [(0, axes[0]), (1, axes[1])].into_iter().find_map(uneven)
}

/// Whether nothing moves to the outermost views, whose contrast changes from place to place.
fn in_one_place(field: &LightField, patches: &Patches, lines: &[Line; 2]) -> bool {
    let [rows, columns] = field.grid;
    let far = |by: &[f64; 2]| by[0].hypot(by[1]) >= 1.0;
    if rows.min(columns) > 1 || lines.iter().any(|line| 4 * line.movements().filter(far).count() > patches.count()) {
        return false;
    }
    let count = rows * columns;
    let changed = |view: usize| {
        let ratios = patches.contrast(field, view);
        let other = ratios.iter().filter(|ratio| !(1.0 / CONTRAST..=CONTRAST).contains(*ratio)).count();
        other >= LEAST && 3 * other >= ratios.len()
    };
    changed(0) || changed(count - 1)
}

/// The nearest views of a line of `n` around that at `middle`; the farthest where nothing moves to the nearest.
fn line(field: &LightField, patches: &Patches, n: usize, middle: usize, view: impl Fn(usize) -> usize) -> Line {
    let found = |step: isize| {
        let at = middle.checked_add_signed(step).filter(|at| *at < n && step != 0)?;
        Some((step, patches.found(field, view(at))))
    };
    let near = Line { views: (-SPACED..=SPACED).filter_map(found).collect() };
    let far = [-(middle as isize), (n - 1 - middle) as isize];
    if near.movements().count() >= LEAST || far.iter().all(|step| step.abs() <= SPACED) {
        return near;
    }
    Line { views: far.into_iter().filter_map(found).collect() }
}

/// One row of cameras in tiles, if content moves along x from column to column and from row to row, as far as it does there.
fn row_in_tiles(field: &LightField, lines: &[Line; 2]) -> Option<Tiles> {
    let [rows, columns] = field.grid;
    let across = |line: &Line| line.along(0).1 >= LEAST && line.along(0).0 < MOST;
    if rows < 2 || columns < 2 || lines.iter().any(across) {
        return None;
    }
    let (r, c) = (rows / 2, columns / 2);
    let views: Vec<(usize, &Vec<Found>)> = (lines[0].views.iter())
        .map(|(step, found)| (r * columns + c.saturating_add_signed(*step), found))
        .chain(lines[1].views.iter().map(|(step, found)| (r.saturating_add_signed(*step) * columns + c, found)))
        .collect();
    let left = |tiles: &Tiles| {
        let mut camera = vec![0.0; rows * columns];
        tiles.order().into_iter().enumerate().for_each(|(k, tile)| camera[tile] = k as f64);
        let (mut left, mut all) = (0.0, 1e-9);
        for p in 0..views.first().map_or(0, |(_, found)| found.len()) {
            let moves: Vec<(f64, f64)> = views
                .iter()
                .filter_map(|(view, found)| match found[p] {
                    Found::Moved(by) => Some((camera[*view] - camera[r * columns + c], by[0])),
                    _ => None,
                })
                .collect();
            let squares: f64 = moves.iter().map(|(k, _)| k * k).sum();
            let rate = moves.iter().map(|(k, m)| k * m).sum::<f64>() / squares.max(1e-9);
            left += moves.iter().map(|(k, m)| (m - k * rate).powi(2)).sum::<f64>();
            all += moves.iter().map(|(_, m)| m * m).sum::<f64>();
        }
        left / all
    };
    // The row from right to left is the same row, near and far exchanged: what covers what tells, once it is read.
    let best = |serpentine: bool| {
        let all =
            [FirstTile::BottomLeft, FirstTile::TopLeft].map(|first| Tiles { grid: field.grid, first, serpentine });
        let all = all.map(|tiles| (left(&tiles), tiles));
        let best = all.into_iter().min_by(|a, b| a.0.total_cmp(&b.0));
        best.filter(|(left, _)| *left < EXPLAINED).map(|(_, tiles)| tiles)
    };
    // The central row and column of an odd number of tiles are the same in both.
    best(false).or_else(|| best(true))
}
