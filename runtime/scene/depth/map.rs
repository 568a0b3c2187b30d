//! Reads depth and disparity maps of a single picture.

use crate::SceneError;
use crate::formats::options::parts;
use crate::formats::still;
use crate::formats::{pfm, video};
use crate::light_field::near::GrayValues;
use crate::light_field::near::{self, Kind, Meaning, Stated};
use eyebox_base::error::Reason;
use eyebox_base::files::{self, FileError, FileKind, NpyArray, Wanted};
use eyebox_base::memory;
use eyebox_base::reason;
use std::path::{Path, PathBuf};

/// A map with rows from the top, in which every value is finite.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Map {
    pub height: usize,
    pub width: usize,
    pub values: Vec<f32>,
    pub meaning: Meaning,
    /// The values that mean the ends of the depths, if they are not the smallest and the largest. They keep the frames
    /// of a video consistent.
    pub range: Option<[f32; 2]>,
    /// The reason for the meaning, and the number of pixels that had no value, in words.
    pub read_as: String,
    /// True if the caller does not know `read_as` yet.
    pub is_news: bool,
}

/// Reads a map from a `.pfm`, an `.npy` (two axes) or the first channel of any picture. `stated` determines which
/// values are near, otherwise the file does. Pixels without a value are filled.
///
/// # Errors
/// [`SceneError::NotFound`], [`SceneError::Corrupt`] or [`SceneError::Ambiguous`].
pub(crate) fn read(path: &Path, stated: Stated) -> Result<Map, SceneError> {
    let (path, stated_range) = without_range(path)?;
    let path = path.as_path();
    let corrupt = |reason: Reason| SceneError::Corrupt { file: path.display().to_string(), reason };
    if path.is_dir() {
        return Err(corrupt(reason!("map-folder", "it is a folder and not a depth map")));
    }
    let bytes = || files::read::bytes(path, files::read::PICTURE).map_err(|e| SceneError::unreadable(path, &e));
    // The name identifies a frame of a video, and the content identifies every other kind.
    let file = path.to_str().map_or(path, |source| parts(source).0);
    let found = if video::named(path).is_some() { FileKind::Y4m } else { kind_of(file)? };
    let GrayValues { height, width, kind, mut values, range } = match found {
        FileKind::Pfm => pfm::parse(&bytes()?).map_err(corrupt)?,
        FileKind::Npy | FileKind::Npz => array(path, stated)?,
        _ => still::stored(path)?,
    };
    let (meaning, mut read_as) = near::meaning(path, kind, &values, stated)?;
    let filled = near::fill(kind, meaning, &mut values, width).map_err(corrupt)?;
    if filled > 0 {
        read_as += &format!(", and {filled} pixels without a value take the value of the farther neighbor");
    }
    let is_news = filled > 0 || stated.near.is_none();
    let range = match (stated_range, meaning) {
        (Some(_), Meaning::Disparity) => {
            return Err(corrupt(reason!(
                "map-range",
                "its values are disparities in pixels, so a range has no effect"
            )));
        }
        (Some([low, high]), Meaning::Relative(_)) => {
            values.iter_mut().for_each(|v| *v = v.clamp(low, high));
            read_as += &format!(", from {low} to {high}");
            stated_range
        }
        (None, _) => range,
    };
    Ok(Map { height, width, values, meaning, range, read_as, is_news })
}

/// Returns the smallest and the largest value.
pub(crate) fn ends(values: &[f32]) -> [f32; 2] {
    values.iter().fold([f32::INFINITY, f32::NEG_INFINITY], |[low, high], v| [low.min(*v), high.max(*v)])
}

/// Splits the option `range` from the path of a map. It has the values that mean the ends of the depths.
fn without_range(path: &Path) -> Result<(PathBuf, Option<[f32; 2]>), SceneError> {
    let given = path.to_str().map(parts);
    let Some((file, query)) = given.filter(|(_, query)| !query.is_empty()) else { return Ok((path.into(), None)) };
    let (mut range, mut kept) = (None, Vec::new());
    for part in query.split('&') {
        let Some(value) = part.strip_prefix("range=") else {
            kept.push(part);
            continue;
        };
        let number = |text: &str| text.parse::<f32>().ok().filter(|v| v.is_finite());
        let ends = value.split_once(',').and_then(|(low, high)| Some([number(low)?, number(high)?]));
        range = Some(ends.filter(|[low, high]| low < high).ok_or_else(|| {
            let reason =
                reason!("option-value", "'{part}': it must be two values, the smaller one first, as in range=0.5,20");
            SceneError::Options { scene: path.display().to_string(), reason }
        })?);
    }
    let kept = kept.join("&");
    let whole = if kept.is_empty() { file.into() } else { format!("{}?{kept}", file.display()).into() };
    Ok((whole, range))
}

/// Returns the kind of a map's file.
fn kind_of(path: &Path) -> Result<FileKind, SceneError> {
    let found = FileKind::of(path).map_err(|e| SceneError::unreadable(path, &e))?;
    let is_map = found.is_picture() || matches!(found, FileKind::Pfm | FileKind::Npy | FileKind::Npz);
    if is_map { Ok(found) } else { Err(FileError::of_kind(path, found, Wanted::DepthMap).into()) }
}

/// Reads an array. It leaves out axes of length 1, which networks write before or after rows and columns.
fn array(path: &Path, stated: Stated) -> Result<GrayValues, SceneError> {
    let mut array = NpyArray::only(path, |shape| axes(shape).len() == 2)?;
    if array.kind == "u1" {
        near::check_bytes(path, stated)?;
    }
    let shape = axes(&array.shape);
    let what = || format!("the depth map {} of shape {shape:?}", path.display());
    memory::check_available(what, memory::bytes_of(&shape, 8), "take a smaller map")?;
    let values = array.take(shape.iter().product())?;
    let [height @ 1..=65536, width @ 1..=65536] = shape[..] else {
        let remedy = if shape.len() > 2 { ". Save one of several maps, as numpy.save('map.npy', maps[0])" } else { "" };
        let reason =
            reason!("map-shape", "has the shape {shape:?}, but a depth map has 1 to 65536 rows and columns{remedy}");
        return Err(SceneError::Corrupt { file: path.display().to_string(), reason });
    };
    Ok(GrayValues { height, width, kind: Kind::Floats, values, range: None })
}

/// Returns the axes of an array without axes of length 1, as long as more than two remain.
fn axes(shape: &[usize]) -> Vec<usize> {
    let mut axes = shape.to_vec();
    while let (true, Some(at)) = (axes.len() > 2, axes.iter().position(|n| *n == 1)) {
        axes.remove(at);
    }
    axes
}

/// Resizes the values of a map of the size `own` (rows, columns). It interpolates between values of one surface and
/// takes the nearest value at edges, because a value halfway over an edge would float in the air. `apart` is the
/// difference that makes an edge.
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

/// Interpolates between four values of one surface (above left, above right, below left, below right). It returns
/// `None` if they differ by more than `apart`.
pub(crate) fn between([a, b, c, d]: [f32; 4], tx: f32, ty: f32, apart: f32) -> Option<f32> {
    let (top, bottom) = (a + (b - a) * tx, c + (d - c) * tx);
    let span = a.max(b).max(c).max(d) - a.min(b).min(c).min(d);
    (span <= apart).then_some(top + (bottom - top) * ty)
}
