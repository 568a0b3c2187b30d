//! Finds how many views a picture of many views has.
//!
//! Neighboring lines differ at seams between views and between the pixels under lenses, and a picture of views repeats.

use crate::formats::options::Tiling;
use crate::read::repeats::Lines;
use rayon::prelude::*;

/// Most views along an axis, and fewest pixels of a view, if nothing states the number of views.
const MOST_VIEWS: usize = 64;
const LEAST_PIXELS: usize = 8;
/// At a seam between views, neighboring lines differ by at least this many times the differences near the seam.
const SEAM: f64 = 1.5;
/// From lens to lens, neighboring lines differ by at least this many times the largest difference under one lens.
const LENS: f64 = 1.15;
/// Lines on each side with which a seam is compared.
const BESIDE: usize = 4;
/// From view to view, a picture differs by at most this share of its difference over half a view.
const ALIKE: f64 = 0.8;

/// The evidence of a picture about its grid, in rows and columns.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum GridEvidence {
    /// Neighboring lines differ at the ends of views.
    Seams([usize; 2]),
    /// The picture repeats without seams.
    Repeats([usize; 2]),
    /// The picture repeats without seams, but its lines do not divide into whole views.
    Parts([usize; 2]),
    /// The picture repeats along one axis, and perhaps along the other. These are the possible grids.
    Either([usize; 2], [usize; 2]),
    Nothing,
}

/// Finds the views of a picture of `height` x `width` values of linear light.
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
        // If nine views are not whole pixels, three times three views may be.
        match (seams[i], times) {
            (Some(seams), Some(times)) if !n.is_multiple_of(times) && times.is_multiple_of(seams) => Some(times),
            (seams, times) => seams.or(times),
        }
    });
    // One row or one column of views is a valid grid, and no view along either axis is not.
    let grid = counts.map(|count| count.unwrap_or(1));
    let doubtful = |i: usize| lines[i].doubtful(MOST_VIEWS.min(axes[i].1 / LEAST_PIXELS));
    // A single row is doubtful if the pictures of several rows differ so much that the repetition is not certain.
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

/// Returns the difference of each row from the one before it, and of each column.
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

/// Returns the number of views next to each other along an axis of `n` lines, whose neighbors differ by `steps`. It is
/// the largest number with seams at the ends of the views.
fn beside(steps: &[f64], n: usize) -> Option<usize> {
    let seam = |at: usize| {
        // The step to line `at` has the index before it.
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

/// Returns the pixels under a lens along an axis, which are the period with which neighboring lines differ most.
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
