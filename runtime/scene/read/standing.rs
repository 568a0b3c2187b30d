//! Detects pictures that contradict the grid of cameras.
//!
//! In a grid, content moves along the rows of pixels from column to column of views, and along the columns of pixels
//! from row to row. It moves twice as far to the second neighbor as to the first. Views of one row that is laid out in
//! tiles, of cameras that are unevenly spaced, and of cameras at any positions do not move in this way.

use crate::depth::neighbors::{Found, Patches, Small};
use crate::light_field::cameras::{CamerasFound, FirstTile, Tiles};
use crate::{LightField, Order};
use rayon::prelude::*;

/// Fewest patches that decide.
const LEAST: usize = 8;
/// Views are not neighbors if at most this share of their patches is found again.
const SEEN_AGAIN: f64 = 0.15;
/// A patch has moved if its movement is at least this number of pixels of the small copies.
const MOVED: f64 = 0.4;
/// A patch has moved along an axis if its movement across the axis is at most this number of pixels, plus this share of
/// the movement along it.
const ACROSS: [f64; 2] = [0.3, 0.2];
/// A grid is contradicted if less than this share of the patches moves along an axis.
const FEW: f64 = 0.5;
/// A patch has another focus if its variance differs by more than this factor.
const CONTRAST: f32 = 2.0;
/// Neighbors on each side whose spacing is compared.
const SPACED: isize = 3;
/// Spacings of one row are uneven if they differ by more than this factor.
const UNEVEN: f64 = 1.7;
/// Least movement of a patch that measures the positions of cameras, in pixels of the small copies.
const SPREAD: f64 = 2.0;
/// A spacing explains movements if it leaves at most this share of their squares.
const EXPLAINED: f64 = 0.1;

/// An arrangement in tiles must explain at least this share of the movements.
const MOST: f64 = 0.7;

/// Returns true if a movement is along x (0) or y (1).
fn along(axis: usize, by: &[f64; 2]) -> bool {
    by[1 - axis].abs() <= ACROSS[0] + ACROSS[1] * by[axis].abs()
}

/// A view with the positions of the central view's patches in it.
struct ComparedView {
    /// Rows and columns from the central view.
    at: [isize; 2],
    small: Small,
    found: Vec<Found>,
}

/// Views of the central row, or of the central column.
struct Line {
    /// Steps from the central view, with the view.
    views: Vec<(isize, ComparedView)>,
    /// For each axis and view, marks the patches that moved across the axis, but are alike along it in this view or in
    /// the opposite one.
    covered: [Vec<Vec<bool>>; 2],
}

impl Line {
    fn of(patches: &Patches, views: Vec<(isize, ComparedView)>) -> Self {
        let covered = [0, 1].map(|axis| {
            let of_view = |(step, seen): &(isize, ComparedView)| {
                let opposite = views.iter().find(|(other, _)| *other == -step);
                let alike = |(p, found): (usize, &Found)| match (found, opposite) {
                    (Found::Moved(by), Some((_, other))) if !along(axis, by) => {
                        patches.alike_along(p, axis, [&seen.small, &other.small])
                    }
                    _ => false,
                };
                seen.found.par_iter().enumerate().map(alike).collect()
            };
            views.iter().map(of_view).collect()
        });
        Self { views, covered }
    }

    /// Returns the movements, each with true if it is along x (0) or y (1), or if there is none. Content that one view
    /// covers may be alike in the opposite view.
    fn movements(&self, axis: usize) -> impl Iterator<Item = ([f64; 2], bool)> {
        let of_view = move |((_, seen), covered): (&'_ (isize, ComparedView), &'_ Vec<bool>)| {
            let moved = |(found, covered): (&Found, &bool)| match found {
                Found::Moved(by) if by[0].hypot(by[1]) >= MOVED => Some((*by, *covered || along(axis, by))),
                _ => None,
            };
            seen.found.iter().zip(covered).filter_map(moved).collect::<Vec<_>>()
        };
        self.views.iter().zip(&self.covered[axis]).flat_map(of_view)
    }

    fn count(&self) -> usize {
        self.movements(0).count()
    }

    /// Returns the share of the movements that are along x (0) or y (1), and the number of movements.
    fn along(&self, axis: usize) -> (f64, usize) {
        let count = self.count();
        (self.movements(axis).filter(|(_, along)| *along).count() as f64 / count.max(1) as f64, count)
    }

    /// Returns the share of the patches that are found again in the nearest views, and the number of patches that were
    /// searched with a result.
    fn again(&self) -> (f64, usize) {
        let nearest = self.views.iter().map(|(step, _)| step.unsigned_abs()).min().unwrap_or(0);
        let near = || {
            let is_near = |(step, _): &&(isize, ComparedView)| step.unsigned_abs() == nearest;
            self.views.iter().filter(is_near).flat_map(|(_, seen)| &seen.found)
        };
        let seen = near().filter(|found| matches!(found, Found::Moved(_))).count();
        let all = seen + near().filter(|found| matches!(found, Found::Nowhere)).count();
        (seen as f64 / all.max(1) as f64, all)
    }

    /// Returns the positions of the cameras with a mean spacing of 1, from the movement along an axis. It returns
    /// `None` if the movement does not show them.
    fn positions(&self, axis: usize) -> Option<Vec<f64>> {
        let steps: Vec<f64> = self.views.iter().map(|(step, _)| *step as f64).collect();
        if steps.len() < 2 {
            return None;
        }
        // Movements of the patches that are found in all views.
        let patches: Vec<Vec<f64>> = (0..self.views[0].1.found.len())
            .filter_map(|p| {
                let by = |found: &Found| match found {
                    Found::Moved(by) => Some(by[axis]),
                    _ => None,
                };
                self.views.iter().map(|(_, seen)| by(&seen.found[p])).collect::<Option<Vec<f64>>>()
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

/// Returns the contradiction between the pictures and the grid of the views. A `stated` order as-named turns it into a
/// warning.
pub(crate) fn refused(field: &LightField, stated: Option<Order>) -> Option<CamerasFound> {
    let found = contradicted(field)?;
    if stated == Some(Order::default()) {
        tracing::warn!("{}: the views are read as the stated grid, although {found}", field.name);
        return None;
    }
    Some(found)
}

/// Returns the contradiction between the pictures and the grid of the views. It returns `None` if they agree.
pub(crate) fn contradicted(field: &LightField) -> Option<CamerasFound> {
    let [rows, columns] = field.grid;
    if rows * columns < 2 {
        return None;
    }
    let (r, c) = (rows / 2, columns / 2);
    let patches = Patches::of(field, r * columns + c)?;
    if patches.count() < LEAST {
        return None;
    }
    let lines = [line(field, &patches, columns, c, |step| [0, step]), line(field, &patches, rows, r, |step| [step, 0])];
    for line in lines.iter().filter(|line| !line.views.is_empty()) {
        let (share, count) = line.again();
        if count >= LEAST && share < SEEN_AGAIN {
            return Some(CamerasFound::Unlike((100.0 * share) as u8));
        }
    }
    if in_one_place(field, &patches, &lines) {
        return Some(CamerasFound::OnePlace);
    }
    // The grid may be as named or transposed, because the order is checked elsewhere.
    let share = |axes: [usize; 2]| {
        let [a, b] = [0, 1].map(|i| lines[i].along(axes[i]));
        ((a.0 * a.1 as f64 + b.0 * b.1 as f64) / (a.1 + b.1).max(1) as f64, [a, b])
    };
    let [named, transposed] = [share([0, 1]), share([1, 0])];
    // Rows that move only along the axis of the columns are not a transposed grid, which moves along both axes.
    let both = lines.iter().all(|line| line.views.is_empty() || line.count() >= LEAST);
    let (axes, all) = if named.0 >= transposed.0 || !both { ([0, 1], named) } else { ([1, 0], transposed) };
    let poor = all.1.iter().filter(|(share, count)| *count >= LEAST && *share < FEW).map(|(share, _)| *share);
    if let Some(share) = poor.reduce(f64::min) {
        let tiles = row_in_tiles(field, &patches, &lines);
        return Some(tiles.map_or(CamerasFound::Elsewhere((100.0 * share) as u8), CamerasFound::RowInTiles));
    }
    let uneven = |(i, axis): (usize, usize)| {
        let positions = lines[i].positions(axis)?;
        let steps: Vec<f64> = positions.windows(2).map(|w| w[1] - w[0]).collect();
        let (least, most) = steps.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), s| (a.min(*s), b.max(*s)));
        (least <= 0.0 || most > UNEVEN * least).then_some(CamerasFound::Uneven { columns: i == 0, positions })
    };
    [(0, axes[0]), (1, axes[1])].into_iter().find_map(uneven)
}

/// Returns true if nothing moves to the nearest views and contrast changes locally to one of the outermost views.
fn in_one_place(field: &LightField, patches: &Patches, lines: &[Line; 2]) -> bool {
    let [rows, columns] = field.grid;
    let far = |(by, _): &([f64; 2], bool)| by[0].hypot(by[1]) >= 1.0;
    if rows.min(columns) > 1 || lines.iter().any(|line| 4 * line.movements(0).filter(far).count() > patches.count()) {
        return false;
    }
    let changed = |view: usize| {
        let ratios = patches.contrast(field, view);
        let other = ratios.iter().filter(|ratio| !(1.0 / CONTRAST..=CONTRAST).contains(*ratio)).count();
        other >= LEAST && 3 * other >= ratios.len()
    };
    changed(0) || changed(rows * columns - 1)
}

/// Returns the view at these rows and columns from the central one, with the patches of the central view in it.
fn seen(field: &LightField, patches: &Patches, at: [isize; 2]) -> Option<ComparedView> {
    let [rows, columns] = field.grid;
    let place = |n: usize, step: isize| (n / 2).checked_add_signed(step).filter(|i| *i < n);
    let view = place(rows, at[0])? * columns + place(columns, at[1])?;
    let small = patches.small(field, view);
    let found = patches.found(&small);
    (at != [0, 0]).then_some(ComparedView { at, small, found })
}

/// Returns the nearest views of a line of `n` around the view at `middle`, or the farthest if nothing moves to the
/// nearest.
fn line(field: &LightField, patches: &Patches, n: usize, middle: usize, at: impl Fn(isize) -> [isize; 2]) -> Line {
    let found = |step: isize| Some((step, seen(field, patches, at(step))?));
    let near = Line::of(patches, (-SPACED..=SPACED).filter_map(found).collect());
    let far = [-(middle as isize), (n - 1 - middle) as isize];
    if near.count() >= LEAST || far.iter().all(|step| step.abs() <= SPACED) {
        return near;
    }
    Line::of(patches, far.into_iter().filter_map(found).collect())
}

/// Finds one row of cameras in tiles. Its content moves along x both from column to column and from row to row, by the
/// distance that the tiles predict.
fn row_in_tiles(field: &LightField, patches: &Patches, lines: &[Line; 2]) -> Option<Tiles> {
    let [rows, columns] = field.grid;
    if rows < 2 || columns < 2 {
        return None;
    }
    // Rows of tiles that run backwards differ from others next to the central column, and most at the ends of the rows.
    let ends = [-((columns / 2) as isize), -1, 1, (columns - 1 - columns / 2) as isize];
    let beside: Vec<Option<ComparedView>> = [-1, 1]
        .into_iter()
        .flat_map(|down| ends.map(|right| [down, right]))
        .map(|at| seen(field, patches, at))
        .collect();
    let views: Vec<&ComparedView> =
        lines.iter().flat_map(|line| &line.views).map(|(_, seen)| seen).chain(beside.iter().flatten()).collect();
    // For each patch, one movement per camera is fitted. The result is the share of the movements that these explain.
    let explained = |tiles: &Tiles| {
        let mut camera = vec![0.0; rows * columns];
        tiles.order().into_iter().enumerate().for_each(|(k, tile)| camera[tile] = k as f64);
        let central = camera[rows / 2 * columns + columns / 2];
        let away = |[down, right]: [isize; 2]| {
            let [row, column] = [rows / 2, columns / 2];
            camera[row.saturating_add_signed(down) * columns + column.saturating_add_signed(right)] - central
        };
        let (mut right, mut count) = (0, 0);
        for p in 0..patches.count() {
            let moved = |seen: &&ComparedView| match seen.found[p] {
                Found::Moved(by) => Some((away(seen.at), by)),
                _ => None,
            };
            let moves: Vec<(f64, [f64; 2])> = views.iter().filter_map(moved).collect();
            let explained = |rate: f64| {
                let near = |(k, [x, y]): &&(f64, [f64; 2])| (x - k * rate).hypot(*y) <= ACROSS[0] + ACROSS[1] * x.abs();
                moves.iter().filter(near).count()
            };
            right += moves.iter().map(|(k, [x, _])| explained(x / k)).max().unwrap_or(0);
            count += moves.len();
        }
        right as f64 / count.max(1) as f64
    };
    // A row from right to left looks the same with near and far exchanged. After it is read, occlusion decides.
    let plain = [FirstTile::BottomLeft, FirstTile::TopLeft].map(|first| (first, false));
    let serpentine = FirstTile::ALL.map(|first| (first, true));
    let mut best: Option<(f64, Tiles)> = None;
    for (first, serpentine) in plain.into_iter().chain(serpentine) {
        let tiles = Tiles { grid: field.grid, first, serpentine };
        let right = explained(&tiles);
        if right >= MOST && best.as_ref().is_none_or(|(most, _)| right > *most) {
            best = Some((right, tiles));
        }
    }
    best.map(|(_, tiles)| tiles)
}
