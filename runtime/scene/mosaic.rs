//! Light fields in one picture: views beside each other, or the pixels under each lens of an array of them.

use super::options::{Options, Tiling};
use super::settings::{self, Settings};
use super::views::{self, Frame, Read};
use super::{Request, SceneError, picture};
use crate::memory;
use crate::optics::Color;
use rayon::prelude::*;
use std::path::Path;

/// Views along an axis, at most, and pixels of one, at least, where nothing states how many there are.
const MOST_VIEWS: usize = 64;
const LEAST_PIXELS: usize = 8;
/// Where one view ends and the next begins, neighbouring lines differ by as many times what they differ by beside it.
const SEAM: f64 = 1.5;
/// From lens to lens neighbouring lines differ by as many times the most that they differ by under one.
const LENS: f64 = 1.15;
/// Lines beside a seam that it is compared with, on each side.
const BESIDE: usize = 4;

/// Rows and columns of each view.
///
/// # Errors
/// Those of [`read`].
pub(super) fn size(file: &Path, tiling: Tiling, options: &Options) -> Result<[usize; 2], SceneError> {
    let stated = settings::beside(file, options)?;
    let whole = picture::size_of_many(file)?;
    let grid = match stated.grid {
        Some(grid) => grid,
        None => find(file, &decoded(file, &[Color::Green], &stated, whole)?[0], whole, tiling)?,
    };
    parts(file, whole, grid)
}

/// Reads the views of a picture, its grid stated or found.
///
/// # Errors
/// Every [`SceneError`] that a file can cause; it names the file.
pub(super) fn read(file: &Path, tiling: Tiling, options: &Options, request: &Request) -> Result<Read, SceneError> {
    let stated = settings::beside(file, options)?;
    let whole = picture::size_of_many(file)?;
    let planes = decoded(file, request.colors, &stated, whole)?;
    let (grid, found) = match stated.grid {
        Some(grid) => (grid, "as stated"),
        None => (find(file, &planes[0], whole, tiling)?, "found by where neighbouring lines differ"),
    };
    let own = parts(file, whole, grid)?;
    let frame = Frame::new(own, grid[0] * grid[1], request)?;
    let one = |view: usize| {
        let at = [view / grid[1], view % grid[1]];
        frame.fit(planes.iter().map(|plane| cut(plane, whole[1], grid, own, at, tiling)).collect())
    };
    let fitted: Vec<_> = (0..grid[0] * grid[1]).into_par_iter().map(one).collect();
    let field = frame.field(file, grid, fitted, request, &stated, stated.disparity);
    let how = match tiling {
        Tiling::Views => format!("views beside each other in one picture, {found}"),
        Tiling::Lenslets => format!("pixels under each lens in one picture, {found}"),
    };
    let linear = picture::is_linear(file).then_some("EXR");
    views::ordered(file, field, request, &stated, how, own, linear)
}

/// Planes of linear light of the whole picture.
fn decoded(
    file: &Path,
    colors: &[Color],
    stated: &Settings,
    [height, width]: [usize; 2],
) -> Result<Vec<Vec<f32>>, SceneError> {
    let what = || format!("a picture of {height} x {width} pixels");
    let bytes = memory::bytes_of(&[colors.len() + 2, height, width], 4);
    memory::promise(what, bytes, "save its views as files of their own, or take --color")?;
    Ok(picture::read_of_many(file, colors, stated.transfer)?.planes)
}

/// Rows and columns of each view of a picture.
fn parts(file: &Path, whole: [usize; 2], grid: [usize; 2]) -> Result<[usize; 2], SceneError> {
    if [0, 1].iter().all(|&i| whole[i].is_multiple_of(grid[i])) {
        return Ok([0, 1].map(|i| whole[i] / grid[i]));
    }
    let [[height, width], [rows, columns]] = [whole, grid];
    let reason = format!(
        "{height} x {width} pixels are no {rows} x {columns} views of one size: cut off its border, or state the grid that it \
         has, as in {}?grid={rows}x{columns}",
        file.display()
    );
    Err(SceneError::Corrupt { file: file.display().to_string(), reason })
}

/// One view of the picture.
fn cut(plane: &[f32], width: usize, grid: [usize; 2], own: [usize; 2], at: [usize; 2], tiling: Tiling) -> Vec<f32> {
    let mut view = Vec::with_capacity(own[0] * own[1]);
    for y in 0..own[0] {
        match tiling {
            Tiling::Views => view.extend(&plane[(at[0] * own[0] + y) * width + at[1] * own[1]..][..own[1]]),
            Tiling::Lenslets => {
                let line = &plane[(y * grid[0] + at[0]) * width..][..width];
                view.extend(line.iter().skip(at[1]).step_by(grid[1]));
            }
        }
    }
    view
}

/// Rows and columns of views that a picture clearly shows.
///
/// # Errors
/// [`SceneError::NotAGrid`] with what states them.
fn find(file: &Path, plane: &[f32], whole: [usize; 2], tiling: Tiling) -> Result<[usize; 2], SceneError> {
    let grid = found(plane, whole, tiling);
    grid.ok_or_else(|| {
        let lenslets = if tiling == Tiling::Lenslets { "lenslets&" } else { "" };
        let reason = format!(
            "nothing in the picture shows how many there are: state it, as in {}?{lenslets}grid=9x9",
            file.display()
        );
        SceneError::NotAGrid { folder: file.display().to_string(), reason }
    })
}

/// The same; none where it shows none.
pub(super) fn found(plane: &[f32], [height, width]: [usize; 2], tiling: Tiling) -> Option<[usize; 2]> {
    let root: Vec<f32> = plane.par_iter().map(|v| v.max(0.0).sqrt()).collect();
    let apart = |a: f32, b: f32| f64::from((a - b).abs());
    let down = |y: usize| {
        let (above, here) = (&root[(y - 1) * width..][..width], &root[y * width..][..width]);
        above.iter().zip(here).map(|(a, b)| apart(*a, *b)).sum::<f64>() / width as f64
    };
    let rows: Vec<f64> = (1..height).into_par_iter().map(down).collect();
    let mut columns = vec![0.0; width.saturating_sub(1)];
    for line in root.chunks_exact(width) {
        columns.iter_mut().zip(line.windows(2)).for_each(|(sum, pair)| *sum += apart(pair[0], pair[1]));
    }
    let grid = [(&rows, height), (&columns, width)].map(|(steps, n)| match tiling {
        Tiling::Views => beside(steps, n),
        Tiling::Lenslets => under(steps, n),
    });
    // One row or one column of views is as good; none is not.
    match (grid, tiling) {
        ([Some(rows), Some(columns)], _) => Some([rows, columns]),
        ([rows, columns], Tiling::Views) if rows.or(columns).is_some() => {
            Some([rows.unwrap_or(1), columns.unwrap_or(1)])
        }
        _ => None,
    }
}

/// Views beside each other along an axis of `n` lines, of which neighbours differ by `steps`: as many as there are seams at every end of
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

/// Pixels under a lens along an axis: the period with which neighbouring lines differ most.
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
