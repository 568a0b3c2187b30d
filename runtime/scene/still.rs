//! One picture: a file of its own, or a frame of a video.

use super::light::{Picture, Transfer};
use super::near::Kind;
use super::{SceneError, picture, video};
use crate::optics::Color;
use std::path::Path;

/// Rows and columns, from the header alone.
pub(super) fn size(path: &Path) -> Result<[usize; 2], SceneError> {
    video::named(path).map_or_else(|| picture::size(path), |(file, _)| video::size(&file))
}

/// The planes of `colors`, linear light.
pub(super) fn read(path: &Path, colors: &[Color], transfer: Option<Transfer>) -> Result<Picture, SceneError> {
    match video::named(path) {
        Some((file, frame)) => video::read(&file, frame.unwrap_or(0), colors),
        None => picture::read(path, colors, transfer),
    }
}

/// Values of a grey picture: rows, columns and values, row by row; and the range that they have by their kind, where it is not theirs to
/// tell, for it is the same in every frame.
pub(super) fn stored(path: &Path) -> Result<Stored, SceneError> {
    let (found, range) = match video::named(path) {
        Some((file, frame)) => {
            let found = video::stored(&file, frame.unwrap_or(0))?;
            let range = video::range(found.2);
            (found, Some(range))
        }
        None => (picture::stored(path)?, None),
    };
    let (height, width, kind, values) = found;
    Ok(Stored { height, width, kind, values, range })
}

/// Values as they are kept.
pub(super) struct Stored {
    pub height: usize,
    pub width: usize,
    pub kind: Kind,
    pub values: Vec<f32>,
    pub range: Option<[f32; 2]>,
}
