//! Replaces the picture formats in a build without the feature `image-formats` by errors that state this.

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

/// Always fails, instead of returning the size of a picture.
pub fn picture_size(file: &Path, _: Wanted, _: u64) -> Result<[usize; 2], FileError> {
    absent(file)
}

/// Always fails, instead of returning the layers of a picture.
pub fn picture_layers(file: &Path) -> Result<Vec<String>, FileError> {
    absent(file)
}

/// Always fails, instead of decoding the layers of a picture.
pub fn read_layers(file: &Path, _: &[u16], _: u64) -> Result<Vec<Pixels>, FileError> {
    absent(file)
}

/// Always fails, instead of returning the EXIF orientation of a picture.
pub fn picture_orientation(file: &Path, _: Wanted) -> Result<u8, FileError> {
    absent(file)
}

/// Always fails, instead of decoding a picture.
pub fn read_pixels(file: &Path, _: Wanted, _: u64) -> Result<Pixels, FileError> {
    absent(file)
}

/// Always fails, instead of looking for depths in a picture.
pub fn holds_depth(file: &Path) -> Result<bool, FileError> {
    absent(file)
}

/// Returns `None`, because no picture is read.
pub fn holds_light(_: &Path) -> Option<&'static str> {
    None
}

/// Returns `None`, because no picture is read.
pub fn color_space(_: &Pixels, _: f32) -> Result<Option<ColorSpace>, Reason> {
    Ok(None)
}

/// Always fails, instead of encoding 8-bit levels as a PNG.
///
/// # Errors
/// Returns [`io::ErrorKind::Unsupported`] in every case.
pub fn encode_png8(_: &mut dyn Write, _: usize, _: usize, _: usize, _: &[u8]) -> io::Result<()> {
    Err(io::Error::new(io::ErrorKind::Unsupported, WHY))
}

/// Always fails, instead of encoding 8-bit red, green and blue as a JPEG.
///
/// # Errors
/// Returns [`io::ErrorKind::Unsupported`] in every case.
pub fn encode_jpeg8(_: &mut dyn Write, _: usize, _: usize, _: &[u8], _: u8) -> io::Result<()> {
    Err(io::Error::new(io::ErrorKind::Unsupported, WHY))
}

/// Always fails, instead of reading an 8-bit PNG as (height, width, channels, bytes).
///
/// # Errors
/// Returns [`FileError::Content`] in every case.
pub fn read_png8(_: File, file: &Path) -> Result<(usize, usize, usize, Vec<u8>), FileError> {
    Err(FileError::content(file, Reason::new("no-image-formats", WHY)))
}
