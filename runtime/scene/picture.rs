//! Pictures from files, as planes of linear light.

use super::SceneError;
use super::light::{Picture, Transfer};
use super::near::Kind;
use super::png_tone;
use super::tone::{Reading, Stored};
use crate::files::{FileError, Pixels, Samples, Wanted, holds_light, picture_orientation, picture_size, read_pixels};
use crate::optics::Color;
use std::path::Path;

/// Pixels of the largest picture that is read: 8K, and 24 megapixels of a camera. It is in memory as a whole, and as light.
const MOST_PIXELS: u64 = 1 << 25;
/// The same of one that holds many views.
const MOST_OF_MANY: u64 = 1 << 27;

/// Rows and columns, from the header alone.
pub(super) fn size(path: &Path) -> Result<[usize; 2], SceneError> {
    size_within(path, MOST_PIXELS)
}

/// The same of a picture that holds many views.
pub(super) fn size_of_many(path: &Path) -> Result<[usize; 2], SceneError> {
    size_within(path, MOST_OF_MANY)
}

fn size_within(path: &Path, most: u64) -> Result<[usize; 2], SceneError> {
    picture_size(path, Wanted::Scene, most).map_err(SceneError::of_file)
}

/// The EXIF orientation that a picture is turned by, 1 to 8; 1 is as stored.
pub(super) fn orientation(path: &Path) -> Result<u8, SceneError> {
    picture_orientation(path, Wanted::Scene).map_err(SceneError::of_file)
}

/// Decodes a file and turns it as its metadata say; values are not converted yet.
fn decode(path: &Path, wanted: Wanted, most: u64) -> Result<Pixels, SceneError> {
    read_pixels(path, wanted, most).map_err(SceneError::of_file)
}

/// Reads the planes of `colors` from a picture. A gray picture gives the same plane for each color; transparency is laid
/// over black. `reading` says and counts how values become light.
pub(super) fn read(path: &Path, colors: &[Color], reading: &Reading) -> Result<Picture, SceneError> {
    planes(path, &decode(path, Wanted::Scene, MOST_PIXELS)?, colors, reading)
}

/// The same of a picture that holds many views.
pub(super) fn read_of_many(path: &Path, colors: &[Color], reading: &Reading) -> Result<Picture, SceneError> {
    planes(path, &decode(path, Wanted::Scene, MOST_OF_MANY)?, colors, reading)
}

/// The kind of a file whose values are light where nothing else is stated; none for others.
pub(super) fn linear(path: &Path) -> Option<&'static str> {
    holds_light(path)
}

fn planes(path: &Path, image: &Pixels, colors: &[Color], reading: &Reading) -> Result<Picture, SceneError> {
    let &Pixels { height, width, channels, premultiplied, orientation, .. } = image;
    let (stored, says) = match &image.samples {
        Samples::U8(v) => (Stored::Bytes(v), Transfer::Srgb),
        Samples::U16(v) => (Stored::Words(v), Transfer::Srgb),
        Samples::F32(v) => (Stored::Floats(v), Transfer::Linear),
    };
    let says = match png_tone::transfer(path) {
        Ok(stated) => stated.unwrap_or(says),
        // The caller knows better.
        Err(_) if reading.tone.transfer.is_some() => says,
        Err(found) => return Err(SceneError::Transfer { file: path.display().to_string(), found }),
    };
    let planes = reading.light(stored, channels, premultiplied, says, colors);
    let planes = planes.map_err(|(i, value)| SceneError::no_light(path.display(), [i / width, i % width], value))?;
    let turned = match orientation {
        1 => String::new(),
        n => format!(", turned by its EXIF orientation {n}"),
    };
    let read_as = format!("{}{turned}", reading.in_words(stored, says));
    Ok(Picture { height, width, planes, read_as })
}

/// Reads the stored values of a grey picture, row by row; its rows and columns. In floats, one channel in three may hold them.
pub(super) fn stored(path: &Path) -> Result<(usize, usize, Kind, Vec<f32>), SceneError> {
    let image = decode(path, Wanted::DepthMap, MOST_PIXELS)?;
    let (channels, has_color) = (image.channels, image.has_color());
    let (kind, values): (_, Vec<f32>) = match &image.samples {
        Samples::U8(v) => (Kind::Bytes, grey(v, channels, has_color, |a, b| a.abs_diff(b) <= 8)),
        Samples::U16(v) => (Kind::Words, grey(v, channels, has_color, |a, b| a.abs_diff(b) <= 8 * 257)),
        Samples::F32(v) => (Kind::Floats, grey(v, channels, has_color, |a, b| a.to_bits() == b.to_bits() || b == 0.0)),
    };
    if values.is_empty() {
        let reason = "its pixels have colors, and nothing says what depth a color means: save its values as a gray picture or as an array (.npy)";
        return Err(SceneError::of_file(FileError::content(path, reason)));
    }
    Ok((image.height, image.width, kind, values))
}

/// The first channel; nothing where another one is not `alike`.
fn grey<T: Copy + Into<f32>>(v: &[T], channels: usize, has_color: bool, alike: impl Fn(T, T) -> bool) -> Vec<f32> {
    let pixels = v.chunks_exact(channels);
    if has_color && !pixels.clone().all(|p| alike(p[0], p[1]) && alike(p[0], p[2])) {
        return Vec::new();
    }
    pixels.map(|p| p[0].into()).collect()
}
