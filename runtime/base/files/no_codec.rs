//! A build without the feature `image-formats` neither reads nor writes pictures, and says so.

use super::FileError;
use crate::error::Reason;
use std::{
    fs::File,
    io::{self, Write},
    path::Path,
};

const WHY: &str = "this program was built without the feature `image-formats`";

/// Encodes 8-bit pictures of one channel (grey) or three as a PNG.
pub(super) fn encode_png(_: &mut dyn Write, _: usize, _: usize, _: usize, _: &[u8]) -> io::Result<()> {
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
