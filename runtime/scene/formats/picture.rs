//! Reads pictures from files as planes of linear light.

use crate::SceneError;
use crate::formats::halves::Half;
use crate::formats::png_tone;
use crate::formats::tone::{Reading, Stored};
use crate::light_field::light::{Picture, Transfer};
use crate::light_field::near::{GrayValues, Kind};
use eyebox_base::error::Reason;
use eyebox_base::files::{ColorSpace, FileError, Pixels, Samples, Wanted, color_space, picture_size, read_pixels};
use eyebox_base::reason;
use eyebox_optics::Color;
use rayon::prelude::*;
use std::path::{Path, PathBuf};

/// Pixels of the largest picture that is read, which is enough for 8K or 24 megapixels of a camera. It is completely in
/// memory, in stored values and as light.
pub(crate) const ONE: u64 = 1 << 25;
/// Pixels of the largest picture of many views.
pub(crate) const MANY: u64 = 1 << 27;

/// Returns rows and columns of a picture with at most `most` pixels, from the header alone.
pub(crate) fn size(path: &Path, most: u64) -> Result<[usize; 2], SceneError> {
    Ok(picture_size(path, Wanted::Scene, most)?)
}

/// Returns rows and columns of pictures that must have one size. `name` formats the name of the first one for errors.
pub(crate) fn size_of_all(paths: &[PathBuf], name: impl Fn(&Path) -> String) -> Result<[usize; 2], SceneError> {
    // The order is fixed, so that an error always names the same file.
    let sizes: Vec<_> = paths.par_iter().map(|path| size(path, ONE)).collect();
    let sizes = sizes.into_iter().collect::<Result<Vec<_>, _>>()?;
    match sizes.iter().position(|size| *size != sizes[0]) {
        None => Ok(sizes[0]),
        Some(i) => Err(SceneError::size(&paths[i], sizes[i], name(&paths[0]), sizes[0])),
    }
}

/// Reads the planes of `colors` from a picture of at most `most` pixels. A gray picture gives the same plane for each
/// color, and transparency is composited over black. `reading` converts values to light and counts them.
pub(crate) fn read(path: &Path, most: u64, colors: &[Color], reading: &Reading) -> Result<Picture, SceneError> {
    light(path, &read_pixels(path, Wanted::Scene, most)?, colors, reading)
}

/// Returns the planes of decoded pixels, like [`read`].
pub(crate) fn light(path: &Path, image: &Pixels, colors: &[Color], reading: &Reading) -> Result<Picture, SceneError> {
    let &Pixels { height, width, channels, premultiplied, orientation, .. } = image;
    let (stored, says) = match &image.samples {
        Samples::U8(v) => (Stored::Bytes(v), Transfer::Srgb),
        Samples::U16(v) => (Stored::Words(v), Transfer::Srgb),
        Samples::F32(v) => (Stored::Floats(v), Transfer::Linear),
    };
    let unknown = |found: Reason| SceneError::Transfer { file: path.display().to_string(), found };
    let mut primaries = None;
    let space = match reading.tone.transfer {
        // The statement of the caller takes precedence over the file.
        Some(_) => None,
        None => {
            let stated = png_tone::stated(path).map_err(unknown)?;
            primaries = image.primaries.or(stated.primaries);
            match stated.transfer {
                Some(Transfer::Srgb) => Some(ColorSpace::Srgb),
                Some(Transfer::Linear) => Some(ColorSpace::Linear),
                None => color_space(image, reading.tone.full_scale.unwrap_or(stored.most())).map_err(unknown)?,
            }
        }
    };
    // A profile has primaries of its own.
    let primaries = primaries.filter(|_| image.has_color() && image.profile.is_none());
    let mix = primaries.map(|stated| stated.to_srgb().map_err(unknown)).transpose()?.flatten();
    // All three colors of the file contribute to each color of the light.
    let read = if mix.is_some() { &[Color::Red, Color::Green, Color::Blue][..] } else { colors };
    let (says, converted) = match &space {
        None => (says, None),
        Some(ColorSpace::Srgb) => (Transfer::Srgb, None),
        Some(ColorSpace::Linear) => (Transfer::Linear, None),
        Some(ColorSpace::Other { name, values }) => (Transfer::Srgb, Some((name, values))),
    };
    let planes = match converted {
        None => reading.light(stored, channels, premultiplied, says, read),
        Some((_, values)) => {
            reading.count_words(stored, channels);
            reading.light(Stored::Shares(values), channels, premultiplied, says, read)
        }
    };
    let planes = planes.map_err(|(i, value)| SceneError::no_light(path.display(), [i / width, i % width], value))?;
    let planes = match &mix {
        Some(mix) => colors.iter().map(|color| mixed(&planes, mix[color.channel()])).collect(),
        None => planes,
    };
    let turned = match orientation {
        1 => String::new(),
        n => format!(", turned by its EXIF orientation {n}"),
    };
    let profile = converted.map_or(String::new(), |(name, _)| format!(", converted from its ICC profile {name}"));
    let from = primaries.filter(|_| mix.is_some());
    let from = from.map_or(String::new(), |from| format!(", converted from its color primaries ({})", from.in_words()));
    let read_as = format!("{}{profile}{from}{turned}", reading.in_words(stored, says));
    Ok(Picture { height, width, planes, read_as })
}

/// Returns one color of the light in sRGB's primaries. Colors outside of sRGB are clipped.
fn mixed(planes: &[Vec<f32>], shares: [f64; 3]) -> Vec<f32> {
    let [r, g, b] = shares.map(|v| v as f32);
    let pixels = planes[0].iter().zip(&planes[1]).zip(&planes[2]);
    pixels.map(|((red, green), blue)| (r * red + g * green + b * blue).max(0.0)).collect()
}

/// Reads the stored values of a gray picture, or of a gray half of a picture. In floats, one of three channels may have
/// them.
pub(crate) fn stored(path: &Path, half: Option<Half>) -> Result<GrayValues, SceneError> {
    let mut image = read_pixels(path, Wanted::DepthMap, ONE)?;
    if let Some(half) = half {
        let (size, channels) = ([image.height, image.width], image.channels);
        image.samples = match &image.samples {
            Samples::U8(v) => Samples::U8(half.cut(v, size, channels)),
            Samples::U16(v) => Samples::U16(half.cut(v, size, channels)),
            Samples::F32(v) => Samples::F32(half.cut(v, size, channels)),
        };
        [image.height, image.width] = half.size(size);
    }
    let (channels, has_color) = (image.channels, image.has_color());
    let (kind, values): (_, Vec<f32>) = match &image.samples {
        Samples::U8(v) => (Kind::Bytes, gray(v, channels, has_color, |a, b| a.abs_diff(b) <= 8)),
        Samples::U16(v) => (Kind::Words, gray(v, channels, has_color, |a, b| a.abs_diff(b) <= 8 * 257)),
        Samples::F32(v) => (Kind::Floats, gray(v, channels, has_color, |a, b| a.to_bits() == b.to_bits() || b == 0.0)),
    };
    if values.is_empty() {
        let reason = reason!(
            "map-colors",
            "its pixels have colors, and the depth of a color is unknown. Save its values as a gray picture or as an \
             array (.npy)"
        );
        return Err(FileError::content(path, reason).into());
    }
    Ok(GrayValues { height: image.height, width: image.width, kind, values, range: None })
}

/// Returns the first channel. It returns nothing if another channel is not `alike`.
fn gray<T: Copy + Into<f32>>(v: &[T], channels: usize, has_color: bool, alike: impl Fn(T, T) -> bool) -> Vec<f32> {
    let pixels = v.chunks_exact(channels);
    if has_color && !pixels.clone().all(|p| alike(p[0], p[1]) && alike(p[0], p[2])) {
        return Vec::new();
    }
    pixels.map(|p| p[0].into()).collect()
}
