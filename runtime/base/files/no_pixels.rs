//! A build without the feature `image-formats` decodes no pictures.

use super::{ColorSpace, FileError, Pixels, Wanted};
use crate::error::Reason;
use std::path::Path;

fn absent<T>(file: &Path) -> Result<T, FileError> {
    let reason = "this program was built without the feature `image-formats`: pictures cannot be read";
    Err(FileError::content(file, Reason::new("no-image-formats", reason)))
}

/// Rows and columns of a picture.
pub fn picture_size(file: &Path, _: Wanted, _: u64) -> Result<[usize; 2], FileError> {
    absent(file)
}

/// The EXIF orientation of a picture.
pub fn picture_orientation(file: &Path, _: Wanted) -> Result<u8, FileError> {
    absent(file)
}

/// Decodes a picture.
pub fn read_pixels(file: &Path, _: Wanted, _: u64) -> Result<Pixels, FileError> {
    absent(file)
}

/// Name of the kind of a file whose stored values are light.
pub fn holds_light(_: &Path) -> Option<&'static str> {
    None
}

/// The color space of a picture.
pub fn color_space(_: &Pixels, _: f32) -> Result<Option<ColorSpace>, Reason> {
    Ok(None)
}
