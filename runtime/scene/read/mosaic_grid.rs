//! How many views a picture of many shows: seams between views and pixels under lenses are where neighboring lines differ, and a
//! picture of views repeats.

use crate::formats::options::Tiling;
use crate::read::repeats::Lines;
use rayon::prelude::*;

/// Views along an axis, at most, and pixels of one, at least, where nothing states how many there are.
const MOST_VIEWS: usize = 64;
const LEAST_PIXELS: usize = 8;
/// Where one view ends and the next begins, neighboring lines differ by as many times what they differ by beside it.
const SEAM: f64 = 1.5;
/// From lens to lens neighboring lines differ by as many times the most that they differ by under one.
const LENS: f64 = 1.15;
/// Lines beside a seam that it is compared with, on each side.
const BESIDE: usize = 4;
/// From view to view a picture differs by at most this share of what it does from half a view to the next.
const ALIKE: f64 = 0.8;

/// What a picture shows of its grid: rows and columns.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum GridEvidence {
    /// Where neighboring lines differ.
    Seams([usize; 2]),
    /// How often it repeats, without a seam.
    Repeats([usize; 2]),
    /// The same, but its lines are no whole views.
    Parts([usize; 2]),
    /// It repeats along one axis, and perhaps along the other: the grids that it may be.
    Either([usize; 2], [usize; 2]),
    Nothing,
}

/// Looks for the views of a picture of `height` x `width` values of linear light.
pub(crate) fn shown(plane: &[f32], [height, width]: [usize; 2], tiling: Tiling) -> GridEvidence {
    let root: Vec<f32> = plane.par_iter().map(|v| v.max(0.0).sqrt()).collect();
    let [rows, columns] = steps(&root, [height, width]);
    let axes = [(&rows, height), (&columns, width)];
    if tiling == Tiling::Lenslets {
        let [rows, columns] = axes.map(|(steps, n)| under(steps, n));
        return rows.zip(columns).map_or(GridEvidence::Nothing, |(rows, columns)| GridEvidence::Seams([rows, columns]));
    }
    let lines = [0, 1].map(|axis| Lines::of(&root, [height, width], axis));
    let seams = [0, 1].map(|i| beside(axes[i].0, axes[i].1).filter(|count| lines[i].unlike(*count) < ALIKE));
    let counts = [0, 1].map(|i| {
        let n = axes[i].1;
        let times = lines[i].times(MOST_VIEWS.min(n / LEAST_PIXELS));
        // Of nine views that are no whole pixels, three times three may be.
        match (seams[i], times) {
            (Some(seams), Some(times)) if !n.is_multiple_of(times) && times.is_multiple_of(seams) => Some(times),
            (seams, times) => seams.or(times),
        }
    });
    // One row or one column of views is as good; none is not.
    let grid = counts.map(|count| count.unwrap_or(1));
    let doubtful = |i: usize| lines[i].doubtful(MOST_VIEWS.min(axes[i].1 / LEAST_PIXELS));
    // One row is no row of many if their pictures differ so much that it is not sure.
    let perhaps = match counts {
        [None, Some(columns)] => doubtful(0).map(|rows| [rows, columns]),
        [Some(rows), None] => doubtful(1).map(|columns| [rows, columns]),
        _ => None,
    };
    if let Some(other) = perhaps {
        return GridEvidence::Either(grid, other);
    }
    match counts {
        [None, None] => GridEvidence::Nothing,
        _ if [0, 1].iter().any(|&i| !axes[i].1.is_multiple_of(grid[i])) => GridEvidence::Parts(grid),
        _ if counts == seams => GridEvidence::Seams(grid),
        _ => GridEvidence::Repeats(grid),
    }
}

/// How much each row differs from the one before it, and each column.
fn steps(root: &[f32], [height, width]: [usize; 2]) -> [Vec<f64>; 2] {
    let apart = |a: f32, b: f32| f64::from((a - b).abs());
    let down = |y: usize| {
        let (above, here) = (&root[(y - 1) * width..][..width], &root[y * width..][..width]);
        above.iter().zip(here).map(|(a, b)| apart(*a, *b)).sum::<f64>() / width as f64
    };
    let rows = (1..height).into_par_iter().map(down).collect();
    let mut columns = vec![0.0; width.saturating_sub(1)];
    for line in root.chunks_exact(width) {
        columns.iter_mut().zip(line.windows(2)).for_each(|(sum, pair)| *sum += apart(pair[0], pair[1]));
    }
    [rows, columns]
}

/// Views beside each other along an axis of `n` lines, of which neighbors differ by `steps`: as many as there are seams at every end of
/// one.
fn beside(steps: &[f64], n: usize) -> Option<usize> {
    let seam = |at: usize| {
        // The step to line `at` is the one before it.
        let step = at - 1;
        let around = (step.saturating_sub(BESIDE)..(step + BESIDE + 1).min(steps.len())).filter(|i| *i != step);
        let mut around: Vec<f64> = around.map(|i| steps[i]).collect();
        around.sort_by(f64::total_cmp);
        steps[step] / around[around.len() / 2].max(1e-6)
    };
    let fits = |count: &usize| n.is_multiple_of(*count) && n / count >= LEAST_PIXELS;
    let mut counts: Vec<usize> = (2..=MOST_VIEWS).filter(fits).collect();
    counts.reverse();
    counts.into_iter().find(|&count| {
        let mut seams: Vec<f64> = (1..count).map(|k| seam(k * n / count)).collect();
        seams.sort_by(f64::total_cmp);
        seams[seams.len() / 5] > SEAM
    })
}

/// Pixels under a lens along an axis: the period with which neighboring lines differ most.
fn under(steps: &[f64], n: usize) -> Option<usize> {
    let clear = |period: usize| {
        let mut means = vec![(0.0, 0u32); period];
        for (i, step) in steps.iter().enumerate() {
            let (sum, count) = &mut means[(i + 1) % period];
            (*sum, *count) = (*sum + step, *count + 1);
        }
        let mut means = means.into_iter().map(|(sum, count)| sum / f64::from(count.max(1)));
        let first = means.next().unwrap_or(0.0);
        first / means.fold(1e-6, f64::max)
    };
    let fits = |period: &usize| n.is_multiple_of(*period) && n / period >= LEAST_PIXELS;
    let best = (2..=MOST_VIEWS).filter(fits).map(|period| (period, clear(period))).max_by(|a, b| a.1.total_cmp(&b.1));
    best.filter(|(_, clear)| *clear > LENS).map(|(period, _)| period)
}
