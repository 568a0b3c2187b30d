//! Reads light fields from one picture, as tiles or as the pixels under each lens.

use crate::formats::options::{Options, Tiling};
use crate::formats::tone::Reading;
use crate::light_field::cameras::{FirstTile, Positions, Quilt};
use crate::light_field::light::FullScale;
use crate::light_field::resize::Resize;
use crate::read::mosaic_grid::{GridEvidence, shown};
use crate::read::settings::{self, Settings};
use crate::read::views::{self, Frame, Read};
use crate::{Fit, Request, SceneError, formats::picture};
use eyebox_base::files::holds_light;
use eyebox_base::memory;
use eyebox_base::reason;
use eyebox_optics::Color;
use rayon::prelude::*;
use std::path::Path;

/// Pixels of a view are square if its sides differ from the aspect ratio in the quilt's name by no more than this
/// share. Sides are whole pixels, and some quilts leave a few pixels out.
const SQUARE: f64 = 0.02;

/// Returns the settings from the picture's name, its options and the settings file in its folder. The name of a quilt
/// gives the positions of its cameras.
fn stated(file: &Path, options: &Options) -> Result<(Settings, Option<Quilt>), SceneError> {
    let stated = settings::beside(file, options)?;
    match Quilt::of(file).filter(|_| options.tiling != Some(Tiling::Lenslets)) {
        Some(quilt) => Ok((of_quilt(quilt, file, stated)?, Some(quilt))),
        None => Ok((stated, None)),
    }
}

/// Combines the settings file of a quilt with the settings in its name.
///
/// # Errors
/// [`SceneError::Settings`] if they contradict each other.
fn of_quilt(quilt: Quilt, file: &Path, stated: Settings) -> Result<Settings, SceneError> {
    let [rows, columns] = quilt.grid;
    let count = rows * columns;
    let other = stated.grid.is_some_and(|grid| grid != [1, count]) || stated.tiles.is_some_and(|t| t != quilt.grid);
    if other || stated.positions.is_some() {
        let reason = reason!(
            "quilt-arrangement",
            "by its name it is a quilt, one row of {count} cameras in {rows} x {columns} tiles, but another \
             arrangement is stated. Leave that out, or rename the file"
        );
        return Err(SceneError::Settings { file: file.display().to_string(), reason });
    }
    let first = stated.first.or(Some(FirstTile::BottomLeft));
    Ok(Settings { grid: None, tiles: Some(quilt.grid), first, ..stated })
}

/// Returns the stated grid of tiles.
fn tiles(stated: &Settings) -> Option<[usize; 2]> {
    let lines = stated.positions.as_ref().filter(|positions| matches!(positions, Positions::Lines(_)));
    stated.tiles.or(stated.grid).or(lines.map(Positions::grid))
}

/// Returns rows and columns of each view.
pub(crate) fn size(file: &Path, tiling: Tiling, options: &Options) -> Result<[usize; 2], SceneError> {
    let (stated, quilt) = stated(file, options)?;
    let whole = picture::size(file, picture::MANY)?;
    let grid = match tiles(&stated) {
        Some(grid) => grid,
        None => find(file, &decoded(file, &[Color::Green], &stated, whole)?[0], whole, tiling)?.0,
    };
    Ok(square(parts(file, whole, grid, quilt.is_some())?, quilt))
}

/// Returns rows and columns of square pixels of a view.
fn square([height, width]: [usize; 2], quilt: Option<Quilt>) -> [usize; 2] {
    let aspect = width as f64 / height as f64;
    match quilt.and_then(|quilt| quilt.aspect) {
        // One of the sides grows, so no detail is lost.
        Some(a) if a > aspect * (1.0 + SQUARE) => [height, (height as f64 * a).round() as usize],
        Some(a) if a < aspect * (1.0 - SQUARE) => [(width as f64 / a).round() as usize, width],
        _ => [height, width],
    }
}

/// Reads the views of a picture whose grid is stated or found.
pub(crate) fn read(file: &Path, tiling: Tiling, options: &Options, request: &Request) -> Result<Read, SceneError> {
    let (stated, quilt) = stated(file, options)?;
    let whole = picture::size(file, picture::MANY)?;
    let planes = decoded(file, request.colors, &stated, whole)?;
    let (grid, found) = match (tiles(&stated), quilt) {
        (Some(grid), Some(_)) => (grid, "a quilt by its name"),
        (Some(grid), None) => (grid, "as stated"),
        (None, _) => find(file, &planes[0], whole, tiling)?,
    };
    let tile = parts(file, whole, grid, quilt.is_some())?;
    // A quilt begins at the bottom left, so lines that do not fill a whole view remain at the top and on the right.
    let top = if quilt.is_some() { whole[0] - grid[0] * tile[0] } else { 0 };
    let own = square(tile, quilt);
    let squared = (own != tile).then(|| Resize::new(tile, own, Fit::Stretch));
    let frame = Frame::new(own, grid[0] * grid[1], request)?;
    let one = |view: usize| {
        let at = [view / grid[1], view % grid[1]];
        let view = planes.iter().map(|plane| {
            let view = cut(&plane[top * whole[1]..], whole[1], grid, tile, at, tiling);
            squared.as_ref().map_or_else(|| view.clone(), |resize| resize.apply(&view))
        });
        frame.fit(view.collect())
    };
    let fitted: Vec<_> = (0..grid[0] * grid[1]).into_par_iter().map(one).collect();
    let field = frame.field(file, grid, fitted, request, &stated, stated.disparity);
    let how = match tiling {
        Tiling::Views => format!("views next to each other in one picture, {found}"),
        Tiling::Lenslets => format!("pixels under each lens in one picture, {found}"),
    };
    views::ordered(file, field, request, &stated, how, own, holds_light(file))
}

/// Returns planes of linear light of the whole picture.
fn decoded(
    file: &Path,
    colors: &[Color],
    stated: &Settings,
    [height, width]: [usize; 2],
) -> Result<Vec<Vec<f32>>, SceneError> {
    let what = || format!("a picture of {height} x {width} pixels");
    let bytes = memory::bytes_of(&[colors.len() + 2, height, width], 4);
    memory::check_available(what, bytes, "save its views as files of their own, or take `color`")?;
    let reading = Reading::new(stated.tone);
    let planes = picture::read(file, picture::MANY, colors, &reading)?.planes;
    reading.judge(file, FullScale::File)?;
    Ok(planes)
}

/// Returns rows and columns of each view of a picture. A quilt may have remaining lines.
fn parts(file: &Path, whole: [usize; 2], grid: [usize; 2], is_quilt: bool) -> Result<[usize; 2], SceneError> {
    let size = [0, 1].map(|i| whole[i] / grid[i]);
    let is_whole = (0..2).all(|i| whole[i].is_multiple_of(grid[i]));
    if is_whole || is_quilt && (0..2).all(|i| size[i] >= 2 && whole[i] % grid[i] <= size[i] / 8) {
        return Ok(size);
    }
    let reason = reason!("mosaic-remedy", "{}, or state the grid that it has", not_whole(whole, grid));
    Err(SceneError::Corrupt { file: file.display().to_string(), reason })
}

fn not_whole(whole: [usize; 2], grid: [usize; 2]) -> String {
    let [[height, width], [rows, columns]] = [whole, grid];
    let [tall, wide] = [0, 1].map(|i| ((whole[i] + grid[i] / 2) / grid[i]).max(1) * grid[i]);
    format!(
        "{height} x {width} pixels are no {rows} x {columns} views of one size: cut off its border, or scale it to \
         {tall} x {wide}"
    )
}

/// Returns rows and columns of views that a picture clearly shows, and the evidence.
///
/// # Errors
/// [`SceneError::NotAGrid`] with the statement that decides the grid. [`SceneError::Corrupt`] if the views are not
/// whole pixels.
fn find(
    file: &Path,
    plane: &[f32],
    whole: [usize; 2],
    tiling: Tiling,
) -> Result<([usize; 2], &'static str), SceneError> {
    let name = file.display().to_string();
    let lenslets = if tiling == Tiling::Lenslets { "lenslets&" } else { "" };
    match shown(plane, whole, tiling) {
        GridEvidence::Seams(grid) => Ok((grid, "found by where neighboring lines differ")),
        GridEvidence::Repeats(grid) => Ok((grid, "found by how often it repeats")),
        GridEvidence::Parts(grid) => {
            let [rows, columns] = grid;
            let reason =
                reason!("mosaic-size", "it repeats as {rows} x {columns} views do, but {}", not_whole(whole, grid));
            Err(SceneError::Corrupt { file: name, reason })
        }
        GridEvidence::Either([a, b], [c, d]) => {
            let reason = reason!(
                "mosaic-two-grids",
                "the picture may be {a} x {b} views or {c} x {d}. State one of them, as in \
                 {name}?{lenslets}grid={c}x{d}"
            );
            Err(SceneError::NotAGrid { folder: name, reason })
        }
        GridEvidence::Nothing => {
            let reason = reason!(
                "mosaic-no-grid",
                "nothing in the picture shows how many there are. State the grid, as in {name}?{lenslets}grid=9x9"
            );
            Err(SceneError::NotAGrid { folder: name, reason })
        }
    }
}

/// Cuts out one view of the picture.
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
