//! Depth and disparity maps of a single picture.

use super::near::{self, Kind, Meaning, Stated};
use super::{SceneError, pfm, still};
use crate::files::{self, FileError};
use std::path::Path;

/// A map, rows from the top; every value is finite.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Map {
    pub height: usize,
    pub width: usize,
    pub values: Vec<f32>,
    pub meaning: Meaning,
    /// The values that mean the ends of the depths, where they are not the smallest and the largest: so that a video's frames agree.
    pub range: Option<[f32; 2]>,
    /// The reason for the meaning, and the number of pixels that had no value, in words.
    pub read_as: String,
}

/// Reads a map: `.pfm`, `.npy` (two axes), or any picture (its first channel). Which values are near is `stated`, or decided
/// by the file. Pixels without a value are filled.
///
/// # Errors
/// [`SceneError::NotFound`], [`SceneError::Corrupt`], [`SceneError::Ambiguous`].
pub(super) fn read(path: &Path, stated: Stated) -> Result<Map, SceneError> {
    let name = path.file_name().map_or(String::new(), |n| n.to_string_lossy().to_lowercase());
    let corrupt = |reason: String| SceneError::Corrupt { file: path.display().to_string(), reason };
    if path.is_dir() {
        return Err(corrupt("a folder, not a depth map".into()));
    }
    let bytes = || files::read::bytes(path, files::read::PICTURE).map_err(|e| SceneError::unreadable(path, &e));
    let mut range = None;
    let (height, width, kind, mut values) = if name.ends_with(".pfm") {
        let map = pfm::parse(&bytes()?).map_err(corrupt)?;
        (map.height, map.width, Kind::Floats, map.values)
    } else if name.ends_with(".npy") {
        let array = files::read_npy_with_gaps(path).map_err(|e| match e {
            FileError::Content { reason, .. } => corrupt(reason),
            other => SceneError::Unreadable { path: path.display().to_string(), reason: other.to_string() },
        })?;
        let [height @ 1..=65536, width @ 1..=65536] = array.shape[..] else {
            return Err(corrupt(format!(
                "has the shape {:?}: a depth map has rows and columns, 1 to 65536",
                array.shape
            )));
        };
        (height, width, Kind::Floats, array.values)
    } else {
        let still::Stored { height, width, kind, values, range: fixed } = still::stored(path)?;
        range = fixed;
        (height, width, kind, values)
    };
    let (meaning, mut read_as) = near::meaning(path, kind, &values, stated)?;
    let filled = near::fill(kind, meaning, &mut values, width).map_err(corrupt)?;
    if filled > 0 {
        read_as += &format!("; {filled} pixels without a value take the farther of their neighbors'");
    }
    if filled > 0 || stated.near.is_none() {
        tracing::info!("{}: {read_as}", path.display());
    }
    Ok(Map { height, width, values, meaning, range, read_as })
}

impl Map {
    /// The map at another size. Between its values where they lie together, the nearest where they do not: a value
    /// halfway over an edge would hang in the air. `apart` is the difference that makes an edge.
    pub fn resize(&self, height: usize, width: usize, apart: f32) -> Vec<f32> {
        if (height, width) == (self.height, self.width) {
            return self.values.clone();
        }
        let place = |i: usize, n: usize, source: usize| {
            let at = ((i as f64 + 0.5) * source as f64 / n as f64 - 0.5).clamp(0.0, source as f64 - 1.0);
            let first = (at as usize).min(source.saturating_sub(2));
            (first, (first + 1).min(source - 1), (at - first as f64) as f32)
        };
        let columns: Vec<_> = (0..width).map(|i| place(i, width, self.width)).collect();
        let mut out = Vec::with_capacity(height * width);
        for j in 0..height {
            let (above, below, ty) = place(j, height, self.height);
            for &(left, right, tx) in &columns {
                let at = |row: usize, column: usize| self.values[row * self.width + column];
                let [a, b, c, d] = [at(above, left), at(above, right), at(below, left), at(below, right)];
                let low = a.min(b).min(c).min(d);
                let high = a.max(b).max(c).max(d);
                out.push(if high - low <= apart {
                    let top = a + (b - a) * tx;
                    top + (c + (d - c) * tx - top) * ty
                } else {
                    at(if ty < 0.5 { above } else { below }, if tx < 0.5 { left } else { right })
                });
            }
        }
        out
    }
}
