//! Holds the stored values of a decoded picture.

#![cfg_attr(not(feature = "image-formats"), allow(dead_code, reason = "decoders use it"))]

use super::Primaries;

/// Stored values of a picture, interleaved.
#[derive(Debug, Clone, PartialEq)]
pub enum Samples {
    /// Values of 8 bits.
    U8(Vec<u8>),
    /// Values of 16 bits.
    U16(Vec<u16>),
    /// Floating-point values. A pixel that an EXR file leaves out is NaN.
    F32(Vec<f32>),
}

/// Decoded picture, row by row.
#[derive(Debug, Clone, PartialEq)]
pub struct Pixels {
    /// Rows of the picture.
    pub height: usize,
    /// Columns of the picture.
    pub width: usize,
    /// Values per pixel. 1 is gray, 2 is gray and alpha, 3 is red, green and blue, and 4 has alpha in addition.
    pub channels: usize,
    /// True if colors are already multiplied by alpha.
    pub premultiplied: bool,
    /// EXIF orientation by which it was turned, 1 to 8. 1 is as stored.
    pub orientation: u8,
    /// ICC profile that the file holds.
    pub profile: Option<Vec<u8>>,
    /// Color primaries that the file states in addition to a profile.
    pub primaries: Option<Primaries>,
    /// Stored values of the picture.
    pub samples: Samples,
}

/// The color space that a picture's ICC profile states.
#[derive(Debug, Clone, PartialEq)]
pub enum ColorSpace {
    /// sRGB, within the differences of sRGB profiles.
    Srgb,
    /// Linear light with the primaries of sRGB.
    Linear,
    /// Another color space, with the values converted to sRGB.
    Other {
        /// Name of the profile.
        name: String,
        /// sRGB values as shares of full scale, interleaved like the stored ones. Alpha is unchanged.
        values: Vec<f32>,
    },
}

impl Samples {
    /// Returns the values at these places, in this order.
    pub(super) fn at(&self, places: impl Iterator<Item = usize>) -> Self {
        match self {
            Self::U8(v) => Self::U8(places.map(|i| v[i]).collect()),
            Self::U16(v) => Self::U16(places.map(|i| v[i]).collect()),
            Self::F32(v) => Self::F32(places.map(|i| v[i]).collect()),
        }
    }

    /// Returns the number of values.
    pub(super) fn count(&self) -> usize {
        match self {
            Self::U8(v) => v.len(),
            Self::U16(v) => v.len(),
            Self::F32(v) => v.len(),
        }
    }
}

impl Pixels {
    /// Makes a picture as it is stored, of (rows, columns), without premultiplied colors and stated color spaces.
    pub(super) fn new([height, width]: [usize; 2], channels: usize, samples: Samples) -> Self {
        let (profile, primaries) = (None, None);
        Self { height, width, channels, premultiplied: false, orientation: 1, profile, primaries, samples }
    }

    /// Returns the picture turned by an EXIF orientation.
    pub fn turned(self, orientation: u8) -> Self {
        if !(2..=8).contains(&orientation) {
            return self;
        }
        let (h, w, channels) = (self.height, self.width, self.channels);
        let [height, width] = if orientation >= 5 { [w, h] } else { [h, w] };
        let from = |row: usize, column: usize| match orientation {
            2 => [row, w - 1 - column],
            3 => [h - 1 - row, w - 1 - column],
            4 => [h - 1 - row, column],
            5 => [column, row],
            6 => [h - 1 - column, row],
            7 => [h - 1 - column, w - 1 - row],
            _ => [column, w - 1 - row],
        };
        let places = (0..height * width)
            .map(|i| from(i / width, i % width))
            .flat_map(|[row, column]| (0..channels).map(move |k| (row * w + column) * channels + k));
        let samples = self.samples.at(places);
        Self { height, width, samples, orientation, ..self }
    }

    /// Returns true if a pixel has red, green and blue.
    pub fn has_color(&self) -> bool {
        self.channels >= 3
    }

    /// Returns true if the last channel is alpha.
    pub fn has_alpha(&self) -> bool {
        self.channels.is_multiple_of(2)
    }
}
