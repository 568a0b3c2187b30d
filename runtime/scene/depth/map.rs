//! Depth and disparity maps of a single picture.

use crate::SceneError;
use crate::formats::still;
use crate::formats::{pfm, video};
use crate::light_field::near::GrayValues;
use crate::light_field::near::{self, Kind, Meaning, Stated};
use eyebox_base::error::Reason;
use eyebox_base::files::{self, FileError, FileKind, NpyArray, Wanted};
use eyebox_base::memory;
use eyebox_base::reason;
use std::path::Path;

/// A map, rows from the top; every value is finite.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Map {
    pub height: usize,
    pub width: usize,
    pub values: Vec<f32>,
    pub meaning: Meaning,
    /// The values that mean the ends of the depths, where they are not the smallest and the largest: so that a video's frames agree.
    pub range: Option<[f32; 2]>,
    /// The reason for the meaning, and the number of pixels that had no value, in words.
    pub read_as: String,
    /// Whether the caller does not know that yet.
    pub is_news: bool,
}

/// Reads a map: `.pfm`, `.npy` (two axes), or any picture (its first channel). Which values are near is `stated`, or decided
/// by the file. Pixels without a value are filled.
///
/// # Errors
/// [`SceneError::NotFound`], [`SceneError::Corrupt`], [`SceneError::Ambiguous`].
pub(crate) fn read(path: &Path, stated: Stated) -> Result<Map, SceneError> {
    let corrupt = |reason: Reason| SceneError::Corrupt { file: path.display().to_string(), reason };
    if path.is_dir() {
        return Err(corrupt(reason!("map-folder", "a folder, not a depth map")));
    }
    let bytes = || files::read::bytes(path, files::read::PICTURE).map_err(|e| SceneError::unreadable(path, &e));
    // A frame of a video is named, the rest is told by its content.
    let found = if video::named(path).is_some() { FileKind::Y4m } else { kind_of(path)? };
    let GrayValues { height, width, kind, mut values, range } = match found {
        FileKind::Pfm => pfm::parse(&bytes()?).map_err(corrupt)?,
        FileKind::Npy | FileKind::Npz => array(path, stated)?,
        _ => still::stored(path)?,
    };
    let (meaning, mut read_as) = near::meaning(path, kind, &values, stated)?;
    let filled = near::fill(kind, meaning, &mut values, width).map_err(corrupt)?;
    if filled > 0 {
        read_as += &format!("; {filled} pixels without a value take the farther of their neighbors'");
    }
    let is_news = filled > 0 || stated.near.is_none();
    Ok(Map { height, width, values, meaning, range, read_as, is_news })
}

/// The kind of a map's file.
fn kind_of(path: &Path) -> Result<FileKind, SceneError> {
    let found = FileKind::of(path).map_err(|e| SceneError::unreadable(path, &e))?;
    let is_map = found.is_picture() || matches!(found, FileKind::Pfm | FileKind::Npy | FileKind::Npz);
    if is_map { Ok(found) } else { Err(FileError::of_kind(path, found, Wanted::DepthMap).into()) }
}

/// Reads an array. Axes of length 1, as networks write them before or after rows and columns, are left out.
fn array(path: &Path, stated: Stated) -> Result<GrayValues, SceneError> {
    let mut array = NpyArray::only(path, |shape| axes(shape).len() == 2)?;
    if array.kind == "u1" {
        near::check_bytes(path, stated)?;
    }
    let shape = axes(&array.shape);
    let what = || format!("{}: a depth map of shape {shape:?}", path.display());
    memory::check_available(what, memory::bytes_of(&shape, 8), "take a smaller map")?;
    let values = array.take(shape.iter().product())?;
    let [height @ 1..=65536, width @ 1..=65536] = shape[..] else {
        let remedy = if shape.len() > 2 { "; save one of several maps, as numpy.save('map.npy', maps[0])" } else { "" };
        let reason =
            reason!("map-shape", "has the shape {shape:?}: a depth map has rows and columns, 1 to 65536{remedy}");
        return Err(SceneError::Corrupt { file: path.display().to_string(), reason });
    };
    Ok(GrayValues { height, width, kind: Kind::Floats, values, range: None })
}

/// The axes of an array of more than two that are longer than 1.
fn axes(shape: &[usize]) -> Vec<usize> {
    let mut axes = shape.to_vec();
    while let (true, Some(at)) = (axes.len() > 2, axes.iter().position(|n| *n == 1)) {
        axes.remove(at);
    }
    axes
}

/// Values of a map of the size `own` (rows, columns) at another size. Between its values where they lie together, the nearest where they
/// do not: a value halfway over an edge would hang in the air. `apart` is the difference that makes an edge.
pub(crate) fn resized(values: &[f32], own: [usize; 2], [height, width]: [usize; 2], apart: f32) -> Vec<f32> {
    if [height, width] == own {
        return values.to_vec();
    }
    let place = |i: usize, n: usize, source: usize| {
        let at = ((i as f64 + 0.5) * source as f64 / n as f64 - 0.5).clamp(0.0, source as f64 - 1.0);
        let first = (at as usize).min(source.saturating_sub(2));
        (first, (first + 1).min(source - 1), (at - first as f64) as f32)
    };
    let columns: Vec<_> = (0..width).map(|i| place(i, width, own[1])).collect();
    let mut out = Vec::with_capacity(height * width);
    for j in 0..height {
        let (above, below, ty) = place(j, height, own[0]);
        for &(left, right, tx) in &columns {
            let at = |row: usize, column: usize| values[row * own[1] + column];
            let four = [at(above, left), at(above, right), at(below, left), at(below, right)];
            let nearest = || at(if ty < 0.5 { above } else { below }, if tx < 0.5 { left } else { right });
            out.push(between(four, tx, ty, apart).unwrap_or_else(nearest));
        }
    }
    out
}

/// Between four values of one surface, above and below, left and right each; none if they differ by more than `apart`.
pub(crate) fn between([a, b, c, d]: [f32; 4], tx: f32, ty: f32, apart: f32) -> Option<f32> {
    let (top, bottom) = (a + (b - a) * tx, c + (d - c) * tx);
    let span = a.max(b).max(c).max(d) - a.min(b).min(c).min(d);
    (span <= apart).then_some(top + (bottom - top) * ty)
}
