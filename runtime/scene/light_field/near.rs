//! Decides which values of a depth map are near, far or unknown.

use crate::SceneError;
use eyebox_base::error::Reason;
use eyebox_base::reason;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// The values of a depth map that are near. They also determine whether 0 is a value.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Near {
    /// Large numbers are near, as in disparities. Zeros are unknown if a gap separates them from all other values.
    Large,
    /// Small numbers are near, as in distances. Zeros, and 65535 in 16 bits, are unknown.
    Small,
    /// Bright pixels of a picture are near. Every stored value counts.
    Bright,
    /// Dark pixels of a picture are near. Every stored value counts.
    Dark,
}

impl Near {
    /// Returns true if larger values are nearer.
    pub(crate) fn is_larger(self) -> bool {
        matches!(self, Self::Large | Self::Bright)
    }

    fn in_words(self) -> &'static str {
        match self {
            Self::Large => "larger is nearer",
            Self::Small => "distances, smaller is nearer",
            Self::Bright => "bright is near",
            Self::Dark => "dark is near",
        }
    }
}

/// The kind of numbers that the file of a map stores.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    /// A picture of 8 bits.
    Bytes,
    /// A picture of 16 bits.
    Words,
    /// Floating point, or the integers of an array.
    Floats,
}

/// The meaning of the values of a map.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Meaning {
    /// The values are pixels between neighboring views, and larger is nearer.
    Disparity,
    /// Only the order and the proportions of the values count.
    Relative(Near),
}

/// The statements of the caller about a map.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Stated {
    /// The values that are near.
    pub near: Option<Near>,
    /// The depths of the ends in meters. If the nearer one is first, small values are near.
    pub depth: Option<[f64; 2]>,
}

impl Stated {
    /// Returns the values that are stated to be near in a map of this kind.
    fn near(self, kind: Kind) -> Option<Near> {
        let reversed = self.depth.is_some_and(|[a, b]| a > b);
        let small = if kind == Kind::Bytes { Near::Dark } else { Near::Small };
        self.near.or(reversed.then_some(small))
    }
}

/// The remedy for a map that does not show which values are near.
const DECIDES: &str = "`near` small (distances, 0 is unknown), `near` large (disparities), or `near` bright or `near` dark (a picture, 0 is a value)";
/// Renderers write such values for infinitely far. No larger value is a distance or a disparity.
const NOTHING: f32 = 1e9;
/// The largest half float.
const HALF_MOST: f32 = 65504.0;
/// The largest value of 16 bits.
const WORD_MOST: f32 = 65535.0;
/// A distance that is larger than all others by this factor means infinitely far.
const BEYOND_ALL: f32 = 1000.0;
/// Distances of one scene vary by at most this factor. Normalized maps vary more.
const DEEPEST: f32 = 200.0;
/// The largest values of normalized maps.
const NORMALIZED: [f32; 3] = [1.0, 255.0, WORD_MOST];
/// Zeros are unknown disparities if no other value is below this share of the largest.
const GAP: f32 = 0.05;
/// Maps with at most this many values are drawn by hand, as layers.
const LAYERS: usize = 32;
/// Parts of the range of values in which gaps are searched.
const BINS: usize = 4096;

/// A summary of the known values of a map.
struct ValueRange {
    /// Smallest and largest known value other than 0.
    low: f32,
    high: f32,
    /// The largest value that is not far beyond all others.
    most: f32,
    has_zero: bool,
    /// True if there are at least two different negative values. A single one marks unknown pixels of distances.
    is_signed: bool,
    /// True if zero is clearly farther from the smallest value than any values are from each other.
    zero_is_apart: bool,
    /// True if the values belong to a few layers.
    is_layered: bool,
}

impl ValueRange {
    fn of(values: &[f32]) -> Self {
        let known = || values.iter().copied().filter(|v| is_number(*v));
        let first_negative = known().find(|v| *v < 0.0);
        let is_signed = first_negative.is_some_and(|first| known().any(|v| v < 0.0 && v != first));
        let counts = |v: &f32| *v > 0.0 || is_signed && *v < 0.0;
        let ends = known().filter(counts).fold([f32::INFINITY, f32::NEG_INFINITY], |[a, b], v| [a.min(v), b.max(v)]);
        let [low, high] = ends;
        let below = known().filter(|v| *v < high).fold(f32::NEG_INFINITY, f32::max);
        let most = if below > 0.0 && high > BEYOND_ALL * below { below } else { high };
        let mut filled = vec![false; BINS + 1];
        let bins = known().filter(|v| counts(v) && *v <= most);
        bins.for_each(|v| filled[((v - low) / (most - low).max(f32::MIN_POSITIVE) * BINS as f32) as usize] = true);
        let longest = filled.split(|bin| *bin).map(<[bool]>::len).max().unwrap_or(0) + 1;
        let zero_is_apart = most > low && low > 2.0 * longest as f32 * (most - low) / BINS as f32;
        let mut layers: Vec<f32> = Vec::new();
        for v in known().filter(counts) {
            if layers.len() <= LAYERS && !layers.contains(&v) {
                layers.push(v);
            }
        }
        let is_layered = layers.len() <= LAYERS;
        Self { low, high, most, has_zero: values.contains(&0.0), is_signed, zero_is_apart, is_layered }
    }
}

/// Returns true if a stored value can be a distance or a disparity.
fn is_number(v: f32) -> bool {
    v.is_finite() && v.abs() < NOTHING && v != HALF_MOST
}

/// Decides the meaning of the values of a map by the statement of the caller, by the name of the file, or by its kind.
/// It also returns the reason.
///
/// # Errors
/// [`SceneError::Ambiguous`] if none of them decides it.
pub(crate) fn meaning(
    file: &Path,
    kind: Kind,
    values: &[f32],
    stated: Stated,
) -> Result<(Meaning, String), SceneError> {
    let name = file.file_stem().map_or(String::new(), |n| n.to_string_lossy().to_lowercase());
    let ValueRange { low, high, most, has_zero, is_signed, zero_is_apart, .. } = ValueRange::of(values);
    let ambiguous =
        |reason: Reason| Err(SceneError::Ambiguous { file: file.display().to_string(), reason, decides: DECIDES });
    let is_disparity = kind == Kind::Floats && name.contains("disp");
    let is_distance = |word: &str| {
        ["depth", "depths", "depthmap", "dist", "distance", "distances", "range", "z", "mm", "metres", "meters"]
            .contains(&word)
    };
    let mut words = name.split(|c: char| !c.is_alphabetic());
    let is_inverse = name.contains("inv");
    let relative = |near: Near, reason: &str| Ok((Meaning::Relative(near), reason.to_owned()));
    match (kind, stated.near(kind)) {
        (_, Some(Near::Small | Near::Dark)) if is_disparity => Err(SceneError::Ambiguous {
            file: file.display().to_string(),
            reason: reason!("disparities", "its name says disparities, of which the larger are near"),
            decides: "`near` large, or give the file another name",
        }),
        (_, near) if is_disparity && stated.depth.is_none() => {
            let reason = "disparities by its name (pixels between neighboring views, larger is nearer)".to_owned();
            debug_assert!(near.is_none_or(Near::is_larger));
            Ok((Meaning::Disparity, reason))
        }
        (_, Some(near)) => relative(near, &format!("as stated: {}", near.in_words())),
        (_, None) if is_disparity => {
            relative(Near::Large, "disparities by its name, scaled to the stated depths, larger is nearer")
        }
        (_, None) if low >= high && !(has_zero && low.is_finite()) => {
            relative(Near::Bright, "a single value, so one plane in the middle of the depths")
        }
        (Kind::Floats, None) if is_inverse || !words.any(is_distance) => ambiguous(reason!(
            "values",
            "values from {} to {high}, and nothing says whether small or large is near",
            if has_zero { low.min(0.0) } else { low }
        )),
        (Kind::Floats, None) if is_signed => ambiguous(reason!(
            "negative-distances",
            "its name says distances, but some values are negative, which no distance is"
        )),
        (Kind::Floats, None) if most > DEEPEST * low || has_zero && !zero_is_apart && NORMALIZED.contains(&most) => {
            let low = if has_zero { 0.0 } else { low };
            ambiguous(reason!(
                "normalized-distances",
                "its name says distances, but its values go from {low} to {most}, as in a map that was normalized"
            ))
        }
        (Kind::Floats, None) => relative(Near::Small, "distances by its name, smaller is nearer"),
        (Kind::Words, None) => ambiguous(reason!(
            "values",
            "16 bits with values from {} to {high}, and nothing says whether small or large is near",
            if has_zero { 0.0 } else { low }
        )),
        (Kind::Bytes, None) if name.contains("disp") => {
            relative(Near::Large, "disparities by its name, of 8 bits, larger is nearer")
        }
        (Kind::Bytes, None) => relative(Near::Bright, "a picture of 8 bits, bright is near"),
    }
}

/// Refuses an array of 8 bits if neither its name nor a statement says what it is. Some networks write pictures in this
/// way, and others write distances.
///
/// # Errors
/// [`SceneError::Ambiguous`] for such an array.
pub(crate) fn check_bytes(file: &Path, stated: Stated) -> Result<(), SceneError> {
    let is_disparity = file.file_stem().is_some_and(|name| name.to_string_lossy().to_lowercase().contains("disp"));
    if is_disparity || stated.near(Kind::Floats).is_some() {
        return Ok(());
    }
    let reason = reason!("values", "an array of 8 bits, and nothing says whether small or large is near");
    Err(SceneError::Ambiguous { file: file.display().to_string(), reason, decides: DECIDES })
}

/// Returns the test for values that are unknown. NaN, infinity, 1e9 or more and the largest half float are always
/// unknown. In distances, 0, 65535 in integers, a negative value, and a value far beyond all others are also unknown.
fn unknown(kind: Kind, meaning: Meaning, values: &[f32]) -> impl Fn(f32) -> bool + use<> {
    let ValueRange { low, high, most, is_signed, zero_is_apart, is_layered, .. } = ValueRange::of(values);
    let is_distance = meaning == Meaning::Relative(Near::Small) && !is_signed;
    let is_integer = kind != Kind::Floats || values.iter().all(|v| v.fract() == 0.0);
    // In a map of a few layers, the farthest may be at zero.
    let has_gap = low >= GAP * high && (zero_is_apart || !is_layered) && !values.iter().any(|v| *v < 0.0);
    let is_picture = matches!(meaning, Meaning::Relative(Near::Bright | Near::Dark));
    let no_zero = is_distance || has_gap && !is_picture;
    move |v: f32| {
        !v.is_finite()
            || v.abs() >= NOTHING
            || kind == Kind::Floats && v == HALF_MOST
            || is_distance && (v < 0.0 || v > most || is_integer && v == WORD_MOST)
            || no_zero && v == 0.0
    }
}

/// Gives each pixel without a value the value of the farther of its neighbors in the row. A row without any value takes
/// the values of the next rows. Returns the number of pixels that had no value.
///
/// # Errors
/// The reason in words if more than half of the pixels have no value.
pub(crate) fn fill(kind: Kind, meaning: Meaning, values: &mut [f32], width: usize) -> Result<usize, Reason> {
    let empty = unknown(kind, meaning, values);
    let count = values.iter().filter(|v| empty(**v)).count();
    if count == 0 {
        return Ok(0);
    }
    if 2 * count > values.len() {
        return Err(reason!(
            "map-holes",
            "{count} of {} pixels have no value (0, not finite, or infinitely far), so complete the map first, for \
             example with the nearest value",
            values.len()
        ));
    }
    let larger_is_nearer = !matches!(meaning, Meaning::Relative(near) if !near.is_larger());
    let farther = |a: f32, b: f32| if larger_is_nearer { a.min(b) } else { a.max(b) };
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
    // Rows without any value take the row above, then the row below.
    let height = values.len() / width;
    for y in (1..height).chain((0..height - 1).rev()) {
        if values[y * width].is_nan() {
            let from = if y > 0 && !values[(y - 1) * width].is_nan() { y - 1 } else { (y + 1).min(height - 1) };
            values.copy_within(from * width..(from + 1) * width, y * width);
        }
    }
    Ok(count)
}

/// Values of a gray picture as its file stores them, with rows from top to bottom.
#[derive(Debug, PartialEq)]
pub(crate) struct GrayValues {
    pub height: usize,
    pub width: usize,
    pub kind: Kind,
    pub values: Vec<f32>,
    /// The range of values of a video, which its kind gives, because it is the same in every frame.
    pub range: Option<[f32; 2]>,
}
