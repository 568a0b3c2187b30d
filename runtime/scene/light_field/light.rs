//! Defines pictures as planes of linear light, and the transfer functions of stored values.

use serde::Deserialize;
use std::sync::OnceLock;

/// The transfer function of stored values.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum Transfer {
    /// The sRGB curve, which is the default for files of 8 and 16 bits.
    Srgb,
    /// Values are linear light, which is the default for EXR.
    Linear,
}

/// One picture with its rows, its columns, and its planes in the order of the requested colors.
pub(crate) struct Picture {
    pub height: usize,
    pub width: usize,
    pub planes: Vec<Vec<f32>>,
    /// The meaning of its stored values, in words.
    pub read_as: String,
}

/// The ways in which the value of white is stated.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum FullScale {
    /// The value of white of a folder of pictures.
    Folder,
    /// The value of white of a file.
    File,
    /// The value of white of an array from a program.
    Array,
}

impl FullScale {
    /// Returns the remedy in words for a file or folder whose value of white is likely `white`.
    pub(crate) fn states(self, file: &str, white: f32) -> String {
        match self {
            Self::Folder => format!("state the value of white, as in full_scale = {white} in lightfield.toml"),
            Self::File => format!("state the value of white, as in {file}?full_scale={white}"),
            Self::Array => format!("divide the array by the value of white, as by {white}"),
        }
    }
}

/// Converts a stored value from 0 to 1 to linear light, by the exact sRGB curve.
pub fn srgb_to_linear(v: f64) -> f64 {
    if v <= 0.04045 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) }
}

/// Returns the light of each stored value up to `full`, which is 255 or 65535.
pub(crate) fn table(full: u16, transfer: Transfer) -> &'static [f32] {
    static TABLES: [[OnceLock<Vec<f32>>; 2]; 2] = [const { [const { OnceLock::new() }; 2] }; 2];
    let light = |v: f64| if transfer == Transfer::Srgb { srgb_to_linear(v) } else { v };
    let build = || (0..=full).map(|i| light(f64::from(i) / f64::from(full)) as f32).collect();
    TABLES[usize::from(full > 255)][transfer as usize].get_or_init(build)
}
