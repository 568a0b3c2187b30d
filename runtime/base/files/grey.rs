//! Reads the gray levels of pictures, such as corrections, masks and pictures of a camera.

use super::{FileError, FileKind, Grey, Samples, Wanted, picture_size, read_pixels};
use crate::reason;
use std::path::Path;

/// Maximum number of pixels of a picture of levels, which covers the largest display or camera.
const MOST_PIXELS: u64 = 1 << 28;

/// Reads the gray levels of a picture of 8 or 16 bits (PNG, BMP, TIFF, PGM) as they are stored. If the picture does not
/// have this number of rows and columns, it returns the size that it has. A colored format is read if all its pixels
/// are gray.
///
/// # Errors
/// Returns [`FileError::Read`], [`FileError::Kind`] for another kind of file, and [`FileError::Content`] for colors,
/// floats and damage.
pub fn read_grey(file: &Path, size: [usize; 2]) -> Result<Result<Grey, [usize; 2]>, FileError> {
    let kind = FileKind::of(file).map_err(|e| FileError::read(file, e))?;
    if matches!(kind, FileKind::Jpeg | FileKind::Gif | FileKind::Exr) || !kind.is_picture() {
        return Err(FileError::of_kind(file, kind, Wanted::Levels));
    }
    // The size is checked before memory is allocated for it.
    let found = picture_size(file, Wanted::Levels, MOST_PIXELS)?;
    if found != size {
        return Ok(Err(found));
    }
    let pixels = read_pixels(file, Wanted::Levels, MOST_PIXELS)?;
    let gray = |values: Vec<u16>| -> Result<Vec<u16>, FileError> {
        let channels = pixels.channels;
        let colored = |p: &[u16]| channels > 2 && (p[0] != p[1] || p[1] != p[2]);
        match values.chunks_exact(channels).position(colored) {
            Some(at) => {
                let (row, column) = (at / size[1], at % size[1]);
                let reason = reason!("not-gray", "is colored at row {row}, column {column}: save it in gray");
                Err(FileError::content(file, reason))
            }
            None => Ok(values.into_iter().step_by(channels).collect()),
        }
    };
    match &pixels.samples {
        Samples::U8(v) => {
            let values = gray(v.iter().map(|v| u16::from(*v)).collect())?;
            Ok(Ok(Grey { levels: 256, values }))
        }
        Samples::U16(v) => Ok(Ok(Grey { levels: 65536, values: gray(v.clone())? })),
        Samples::F32(_) => {
            Err(FileError::content(file, reason!("floats", "holds floats: save 8 or 16 bits, or an .npy")))
        }
    }
}
