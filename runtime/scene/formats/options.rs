//! Reads the options after the question mark of a file name.

use crate::formats::halves::Half;
use crate::formats::tone::Tone;
use crate::light_field::light::Transfer;
use eyebox_base::error::Reason;
use eyebox_base::reason;
use std::path::Path;

/// Lists of the options, for people.
const ARRAYS: &str = "an array takes grid=ROWSxCOLUMNS, srgb, linear, full_scale=NUMBER and array=NAME, with & between";
pub(crate) const PICTURES: &str = "a picture takes srgb, linear and full_scale=NUMBER. With depths it takes camera=MM and depth=HALF, the half that has them. With many views it takes grid=ROWSxCOLUMNS, mosaic or lenslets. A depth map takes range=LOW,HIGH. Put & between them";

/// Returns the path of a source that is not a built-in scene, and its options. A file name may have a question mark
/// itself.
pub(crate) fn parts(source: &str) -> (&Path, &str) {
    let whole = Path::new(source);
    match source.rsplit_once('?') {
        Some((path, query)) if !whole.exists() => (Path::new(path), query),
        _ => (whole, ""),
    }
}

/// Returns a query with the option `name` for this length in meters, which it has in millimeters.
pub(crate) fn with_length(query: &str, name: &str, length: f64) -> String {
    let is_it = |pair: &&str| pair.split_once('=').is_some_and(|(key, _)| key == name);
    let kept = query.split('&').filter(|pair| !pair.is_empty() && !is_it(pair));
    let option = format!("{name}={}", (length * 1e7).round() / 1e4);
    kept.chain([option.as_str()]).collect::<Vec<_>>().join("&")
}

/// The arrangement of views in a picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Tiling {
    /// The views are next to each other.
    Views,
    /// Under each lens there is one pixel of each view.
    Lenslets,
}

/// The options after the question mark of a file name.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct Options {
    /// Rows and columns of views.
    pub grid: Option<[usize; 2]>,
    /// The conversion of stored values to light.
    pub tone: Tone,
    /// Name of the array in an archive.
    pub array: Option<String>,
    /// The arrangement of views in a picture.
    pub tiling: Option<Tiling>,
    /// Position of the middle of the views along x, in meters of the pupil plane. It is for a picture with a depth map.
    pub camera: f64,
}

/// Reads the value of white.
fn full_scale(text: &str) -> Result<f32, Reason> {
    let value = text.parse::<f32>().ok().filter(|v| v.is_finite() && *v > 0.0);
    value.ok_or_else(|| {
        reason!("full-scale", "full_scale is '{text}', but it must be a positive number, the stored value of white")
    })
}

impl Options {
    /// Reads the options from the text of a query.
    pub fn parse(query: &str, is_array: bool) -> Result<Self, Reason> {
        let mut options = Self::default();
        for part in query.split('&').filter(|part| !part.is_empty()) {
            let number = |text: &str| text.parse::<usize>().ok().filter(|n| (1..=64).contains(n));
            match part.split_once('=').unwrap_or((part, "")) {
                ("grid", value) => {
                    let sides = value.split_once('x').and_then(|(r, c)| Some([number(r)?, number(c)?]));
                    let must = "rows and columns of views, 1 to 64 each, as in grid=9x9";
                    options.grid = Some(sides.ok_or_else(|| reason!("option-value", "'{part}': it must be {must}"))?);
                }
                ("srgb", "") => options.tone.transfer = Some(Transfer::Srgb),
                ("linear", "") => options.tone.transfer = Some(Transfer::Linear),
                ("full_scale", value) => options.tone.full_scale = Some(full_scale(value)?),
                ("array", name) if is_array && !name.is_empty() => options.array = Some(name.into()),
                ("camera", value) if !is_array => {
                    let camera = value.parse::<f64>().ok().filter(|mm| mm.abs() <= 1e4);
                    let must = "millimeters to the right, -10000 to 10000";
                    options.camera =
                        1e-3 * camera.ok_or_else(|| reason!("option-value", "'{part}': it must be {must}"))?;
                }
                ("depth" | "half", value) if !is_array => drop(Half::named(value)?),
                ("mosaic", "") if !is_array => options.tiling = Some(Tiling::Views),
                ("lenslets", "") if !is_array => options.tiling = Some(Tiling::Lenslets),
                _ => return Err(reason!("option", "'{part}': {}", if is_array { ARRAYS } else { PICTURES })),
            }
        }
        Ok(options)
    }
}
