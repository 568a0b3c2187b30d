//! What pictures hold: planes of linear light.

use super::SceneError;
use serde::Deserialize;
use std::path::Path;
use std::sync::OnceLock;

/// How stored values become light.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(super) enum Transfer {
    /// The sRGB curve: what 8- and 16-bit files hold unless told otherwise.
    Srgb,
    /// Values are light: what EXR holds.
    Linear,
}

/// One picture: its rows, its columns, and its planes in the order of the colours asked for.
pub(super) struct Picture {
    pub height: usize,
    pub width: usize,
    pub planes: Vec<Vec<f32>>,
}

/// The exact sRGB curve: stored value in 0..=1 to linear light.
pub fn srgb_to_linear(v: f64) -> f64 {
    if v <= 0.04045 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) }
}

/// The light of each stored value up to `full`, which is 255 or 65535.
pub(super) fn table(full: u16, transfer: Transfer) -> &'static [f32] {
    static TABLES: [[OnceLock<Vec<f32>>; 2]; 2] = [const { [const { OnceLock::new() }; 2] }; 2];
    let light = |v: f64| if transfer == Transfer::Srgb { srgb_to_linear(v) } else { v };
    let build = || (0..=full).map(|i| light(f64::from(i) / f64::from(full)) as f32).collect();
    TABLES[usize::from(full > 255)][transfer as usize].get_or_init(build)
}

/// The first pixel that is not as it must be is an error.
#[cfg_attr(not(feature = "image-formats"), allow(dead_code, reason = "pictures use all of it"))]
pub(super) fn check(
    path: &Path,
    plane: &[f32],
    width: usize,
    good: impl Fn(f32) -> bool,
    must: &'static str,
) -> Result<(), SceneError> {
    match plane.iter().position(|&v| !good(v)) {
        None => Ok(()),
        Some(i) => Err(SceneError::Value {
            file: path.display().to_string(),
            row: i / width,
            column: i % width,
            value: plane[i],
            must,
        }),
    }
}
