//! A build without the feature `image-formats` neither reads nor writes pictures, and says so.

use super::{ColorSpace, FileError, Pixels, Wanted};
use crate::error::Reason;
use crate::reason;
use std::fs::File;
use std::io::{self, Write};
use std::path::Path;

const WHY: &str = "this program was built without the feature `image-formats`";

fn absent<T>(file: &Path) -> Result<T, FileError> {
    Err(FileError::content(file, reason!("no-image-formats", "{WHY}: pictures cannot be read")))
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

/// Encodes 8-bit levels as a PNG.
///
/// # Errors
/// Always.
pub fn encode_png8(_: &mut dyn Write, _: usize, _: usize, _: usize, _: &[u8]) -> io::Result<()> {
    Err(io::Error::new(io::ErrorKind::Unsupported, WHY))
}

/// Encodes 8-bit red, green, blue as a JPEG.
///
/// # Errors
/// Always.
pub fn encode_jpeg8(_: &mut dyn Write, _: usize, _: usize, _: &[u8], _: u8) -> io::Result<()> {
    Err(io::Error::new(io::ErrorKind::Unsupported, WHY))
}

/// Reads an 8-bit PNG: (height, width, channels, bytes).
///
/// # Errors
/// [`FileError::Content`], always.
pub fn read_png8(_: File, file: &Path) -> Result<(usize, usize, usize, Vec<u8>), FileError> {
    Err(FileError::content(file, Reason::new("no-image-formats", WHY)))
}
