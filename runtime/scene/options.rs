//! What stands behind the question mark of a file's name.

use super::light::Transfer;

/// What options there are, for people.
const ARRAYS: &str = "an array takes grid=ROWSxCOLUMNS, srgb, linear and array=NAME, with & between";
pub(super) const PICTURES: &str =
    "a picture of many views takes grid=ROWSxCOLUMNS, mosaic or lenslets, srgb and linear, with & between";

/// How views lie in a picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Tiling {
    /// Beside each other.
    Views,
    /// Under each lens a pixel of each view.
    Lenslets,
}

/// What stands behind the question mark of a file's name.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct Options {
    /// Rows and columns of views.
    pub grid: Option<[usize; 2]>,
    /// How values become light.
    pub transfer: Option<Transfer>,
    /// Which array of an archive.
    pub array: Option<String>,
    /// How the views lie in a picture.
    pub tiling: Option<Tiling>,
}

impl Options {
    /// Reads them.
    ///
    /// # Errors
    /// In words.
    pub fn parse(query: &str, is_array: bool) -> Result<Self, String> {
        let mut options = Self::default();
        for part in query.split('&').filter(|part| !part.is_empty()) {
            let number = |text: &str| text.parse::<usize>().ok().filter(|n| (1..=64).contains(n));
            match part.split_once('=').unwrap_or((part, "")) {
                ("grid", value) => {
                    let sides = value.split_once('x').and_then(|(r, c)| Some([number(r)?, number(c)?]));
                    let must = "rows and columns of views, 1 to 64 each, as in grid=9x9";
                    options.grid = Some(sides.ok_or_else(|| format!("'{part}': it must be {must}"))?);
                }
                ("srgb", "") => options.transfer = Some(Transfer::Srgb),
                ("linear", "") => options.transfer = Some(Transfer::Linear),
                ("array", name) if is_array && !name.is_empty() => options.array = Some(name.into()),
                ("mosaic", "") if !is_array => options.tiling = Some(Tiling::Views),
                ("lenslets", "") if !is_array => options.tiling = Some(Tiling::Lenslets),
                _ => return Err(format!("'{part}': {}", if is_array { ARRAYS } else { PICTURES })),
            }
        }
        Ok(options)
    }
}
