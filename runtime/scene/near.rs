//! Which values of a depth map are near, and pixels without a value.

use super::SceneError;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Which values of a depth map are near.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Near {
    /// The large ones, or the bright ones of a picture.
    Large,
    /// The small ones, as of distances; or the dark ones of a picture.
    Small,
}

/// How a map's file keeps its values.
#[cfg_attr(not(feature = "image-formats"), allow(dead_code, reason = "pictures use all of it"))]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    /// A picture of 8 bits.
    Bytes,
    /// A picture of 16 bits.
    Words,
    /// Floating point.
    Floats,
}

/// What the values mean.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Meaning {
    /// Pixels between neighbouring views, larger being nearer.
    Disparity,
    /// Only their order and their proportions count.
    Relative(Near),
}

/// 16-bit values up to this, some of them 0, are taken for a depth camera's millimetres.
const MILLIMETRES: f32 = 16383.0;
/// What renderers write where there is nothing: infinitely far.
const NOTHING: f32 = 1e9;
const HALF_MOST: f32 = 65504.0;

/// Means of the values of this file, by what was asked, by its name, or by its kind; says what was assumed.
///
/// # Errors
/// [`SceneError::Ambiguous`] where none of them tells.
pub(super) fn meaning(file: &Path, kind: Kind, values: &[f32], asked: Option<Near>) -> Result<Meaning, SceneError> {
    let name = file.file_stem().map_or(String::new(), |n| n.to_string_lossy().to_lowercase());
    let [low, high] = ends(values);
    let ambiguous =
        |found: String, decides| Err(SceneError::Ambiguous { file: file.display().to_string(), found, decides });
    let is_disparity = kind == Kind::Floats && name.contains("disp");
    let is_distance = |word: &str| {
        ["depth", "depths", "depthmap", "dist", "distance", "distances", "range", "z", "mm", "metres", "meters"]
            .contains(&word)
    };
    let mut words = name.split(|c: char| !c.is_alphabetic());
    let is_inverse = name.contains("inv");
    match (kind, asked) {
        (_, Some(Near::Small)) if is_disparity => ambiguous(
            "by its name it holds disparities, of which the larger are near".into(),
            "another name, or --near left out",
        ),
        (_, _) if is_disparity => Ok(Meaning::Disparity),
        (_, Some(near)) => Ok(Meaning::Relative(near)),
        (_, None) if low >= high => Ok(Meaning::Relative(Near::Large)),
        (Kind::Floats, None) if !is_inverse && words.any(is_distance) => {
            tracing::info!("{}: distances by its name: small values are near (--near large if not)", file.display());
            Ok(Meaning::Relative(Near::Small))
        }
        (Kind::Floats, None) => ambiguous(
            format!("values from {low} to {high}, and nothing says whether small or large is near"),
            "--near small (distances) or --near large",
        ),
        (Kind::Words, None) if high <= MILLIMETRES && values.contains(&0.0) => ambiguous(
            format!("16 bits with values from {low} to {high} and zeros, as depth cameras write millimetres"),
            "--near small (distances, 0 unknown) or --near large",
        ),
        (Kind::Bytes | Kind::Words, None) => {
            tracing::info!("{}: bright is near (--near dark if not)", file.display());
            Ok(Meaning::Relative(Near::Large))
        }
    }
}

/// Smallest and largest value that says something.
fn ends(values: &[f32]) -> [f32; 2] {
    let known = values.iter().filter(|v| v.is_finite() && **v < NOTHING && **v != HALF_MOST);
    known.fold([f32::INFINITY, f32::NEG_INFINITY], |[a, b], v| [a.min(*v), b.max(*v)])
}

/// Gives pixels without a value that of the farther of their neighbours in the row, or, in rows without any, that of the
/// rows beside; and says how many. Without a value is what is not finite; of distances also what is infinitely far, and
/// 0 where every other value is far from it.
///
/// # Errors
/// In words, where more than half of the pixels have none.
pub(super) fn fill(file: &Path, kind: Kind, meaning: Meaning, values: &mut [f32], width: usize) -> Result<(), String> {
    let distances = meaning == Meaning::Relative(Near::Small) && kind != Kind::Bytes;
    let [mut least, most] = [f32::INFINITY, ends(values)[1]];
    values.iter().filter(|v| **v != 0.0).for_each(|v| least = least.min(*v));
    let zeros = distances && least >= 0.05 * most && least > 0.0;
    let far = |v: f32| distances && kind == Kind::Floats && (v >= NOTHING || v == HALF_MOST);
    let empty = |v: f32| !v.is_finite() || far(v) || (zeros && v == 0.0);
    let count = values.iter().filter(|v| empty(**v)).count();
    if count == 0 {
        return Ok(());
    }
    if 2 * count > values.len() {
        return Err(format!("{count} of {} pixels have no value (0, not finite, or infinitely far)", values.len()));
    }
    let farther = |a: f32, b: f32| if distances { a.max(b) } else { a.min(b) };
    for row in values.chunks_exact_mut(width) {
        let mut x = 0;
        while x < width {
            let run = row[x..].iter().take_while(|v| empty(**v)).count();
            let left = x.checked_sub(1).map(|i| row[i]);
            let value = match (left, row.get(x + run).copied()) {
                (Some(a), Some(b)) => farther(a, b),
                (a, b) => a.or(b).unwrap_or(f32::NAN),
            };
            row[x..x + run].fill(value);
            x += run + 1;
        }
    }
    // Rows without any: from above, then from below.
    let height = values.len() / width;
    for y in (1..height).chain((0..height - 1).rev()) {
        if values[y * width].is_nan() {
            let from = if y > 0 && !values[(y - 1) * width].is_nan() { y - 1 } else { (y + 1).min(height - 1) };
            values.copy_within(from * width..(from + 1) * width, y * width);
        }
    }
    tracing::info!("{}: {count} pixels without a value take the farther of their neighbours'", file.display());
    Ok(())
}
