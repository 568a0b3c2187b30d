//! A build without the feature `image-formats` reads no pictures, and says so.

use super::SceneError;
use super::light::Picture;
use super::near::Kind;
use super::tone::Reading;
use crate::optics::Color;
use std::path::Path;

fn absent<T>(path: &Path) -> Result<T, SceneError> {
    let reason = "this program was built without the feature `image-formats`: pictures cannot be read".into();
    Err(SceneError::Corrupt { file: path.display().to_string(), reason })
}

/// Rows and columns, from the header alone.
pub(super) fn size(path: &Path) -> Result<[usize; 2], SceneError> {
    absent(path)
}

/// The same of a picture that holds many views.
pub(super) fn size_of_many(path: &Path) -> Result<[usize; 2], SceneError> {
    absent(path)
}

/// The same of a picture that holds many views.
pub(super) fn read_of_many(path: &Path, _: &[Color], _: &Reading) -> Result<Picture, SceneError> {
    absent(path)
}

/// The EXIF orientation.
pub(super) fn orientation(path: &Path) -> Result<u8, SceneError> {
    absent(path)
}

/// Whether its values are light where nothing else is stated.
pub(super) fn is_linear(_: &Path) -> bool {
    false
}

/// Reads the planes of `colors`.
pub(super) fn read(path: &Path, _: &[Color], _: &Reading) -> Result<Picture, SceneError> {
    absent(path)
}

/// Reads the stored values of a picture's first channel, row by row; its rows and columns.
pub(super) fn stored(path: &Path) -> Result<(usize, usize, Kind, Vec<f32>), SceneError> {
    absent(path)
}
