//! Pictures from files, as planes of linear light, by the crate `image`.

use super::SceneError;
use super::light::{Picture, Transfer};
use super::near::Kind;
use super::png_tone;
use super::tone::{Reading, Stored};
use crate::files::read;
use crate::optics::Color;
use image::{DynamicImage, ImageDecoder, ImageFormat, ImageReader, Limits, metadata::Orientation};
use std::{fs::File, io::BufReader, path::Path};

fn open(path: &Path) -> Result<ImageReader<BufReader<File>>, SceneError> {
    let unreadable = |e: std::io::Error| SceneError::unreadable(path, &e);
    let mut reader =
        read::open(path).and_then(|f| ImageReader::new(BufReader::new(f)).with_guessed_format()).map_err(unreadable)?;
    let mut limits = Limits::default();
    limits.max_image_width = Some(65536);
    limits.max_image_height = Some(65536);
    limits.max_alloc = Some(1 << 30);
    reader.limits(limits);
    Ok(reader)
}

fn corrupt(path: &Path, e: impl ToString) -> SceneError {
    SceneError::Corrupt { file: path.display().to_string(), reason: e.to_string().replace('\n', " ") }
}

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
    let mut decoder = open(path)?.into_decoder().map_err(|e| corrupt(path, e))?;
    let ((width, height), orientation) = (decoder.dimensions(), orientation_of(&mut decoder));
    let pixels = u64::from(height) * u64::from(width);
    if pixels > most {
        let most = most >> 20;
        return Err(corrupt(
            path,
            format!(
                "it has {height} x {width} pixels: at most {most} Mpx are read; scale it down to what the display shows"
            ),
        ));
    }
    let size = [height as usize, width as usize];
    // Orientations from 5 on exchange rows and columns.
    Ok(if orientation.to_exif() >= 5 { [size[1], size[0]] } else { size })
}

/// The orientation that the metadata state; none for metadata that cannot be read.
fn orientation_of(decoder: &mut impl ImageDecoder) -> Orientation {
    decoder.orientation().unwrap_or(Orientation::NoTransforms)
}

/// The EXIF orientation that a picture is turned by, 1 to 8; 1 is as stored.
pub(super) fn orientation(path: &Path) -> Result<u8, SceneError> {
    let mut decoder = open(path)?.into_decoder().map_err(|e| corrupt(path, e))?;
    Ok(orientation_of(&mut decoder).to_exif())
}

/// Decodes a file and turns it as its metadata say; values are not converted yet.
fn decode(path: &Path, most: u64) -> Result<DynamicImage, SceneError> {
    size_within(path, most)?;
    let reader = open(path)?;
    if reader.format() == Some(ImageFormat::Jpeg) && !jpeg_ends(path)? {
        return Err(corrupt(path, "the file is cut short: a JPEG must reach its end marker"));
    }
    let mut decoder = reader.into_decoder().map_err(|e| corrupt(path, e))?;
    let orientation = orientation_of(&mut decoder);
    let mut image = DynamicImage::from_decoder(decoder).map_err(|e| corrupt(path, e))?;
    image.apply_orientation(orientation);
    Ok(image)
}

/// Whether a JPEG's last scan is closed: decoders fill what is missing with grey and say nothing.
fn jpeg_ends(path: &Path) -> Result<bool, SceneError> {
    let bytes = read::bytes(path, read::PICTURE).map_err(|e| SceneError::unreadable(path, &e))?;
    // Inside a scan, 0xff is never followed by these.
    let last_scan = bytes.windows(2).rposition(|b| b == [0xff, 0xda]).unwrap_or(0);
    Ok(bytes[last_scan..].windows(2).any(|b| b == [0xff, 0xd9]))
}

/// Reads the planes of `colors` from a PNG, JPEG or EXR file. A gray picture gives the same plane for each color;
/// transparency is laid over black. `reading` says and counts how values become light.
pub(super) fn read(path: &Path, colors: &[Color], reading: &Reading) -> Result<Picture, SceneError> {
    planes(path, &decode(path, MOST_PIXELS)?, colors, reading)
}

/// The same of a picture that holds many views.
pub(super) fn read_of_many(path: &Path, colors: &[Color], reading: &Reading) -> Result<Picture, SceneError> {
    planes(path, &decode(path, MOST_OF_MANY)?, colors, reading)
}

/// Whether its values are light where nothing else is stated.
pub(super) fn is_linear(path: &Path) -> bool {
    open(path).is_ok_and(|reader| reader.format() == Some(ImageFormat::OpenExr))
}

fn planes(path: &Path, image: &DynamicImage, colors: &[Color], reading: &Reading) -> Result<Picture, SceneError> {
    let (height, width) = (image.height() as usize, image.width() as usize);
    let channels = usize::from(image.color().channel_count());
    let (stored, says) = if let Some(v) = samples8(image) {
        (Stored::Bytes(v), Transfer::Srgb)
    } else if let Some(v) = samples16(image) {
        (Stored::Words(v), Transfer::Srgb)
    } else {
        (Stored::Floats(floats(path, image)?), Transfer::Linear)
    };
    let says = match png_tone::transfer(path) {
        Ok(stated) => stated.unwrap_or(says),
        // The caller knows better.
        Err(_) if reading.tone.transfer.is_some() => says,
        Err(found) => return Err(SceneError::Transfer { file: path.display().to_string(), found }),
    };
    // EXR keeps color already multiplied by its transparency.
    let premultiplied = matches!(stored, Stored::Floats(_));
    let planes = reading.light(stored, channels, premultiplied, says, colors);
    let planes = planes.map_err(|(i, value)| SceneError::no_light(path.display(), [i / width, i % width], value))?;
    let turned = match orientation(path)? {
        1 => String::new(),
        n => format!(", turned by its EXIF orientation {n}"),
    };
    let read_as = format!("{}{turned}", reading.in_words(stored, says));
    Ok(Picture { height, width, planes, read_as })
}

fn floats<'a>(path: &Path, image: &'a DynamicImage) -> Result<&'a [f32], SceneError> {
    match image {
        DynamicImage::ImageRgb32F(p) => Ok(p.as_raw()),
        DynamicImage::ImageRgba32F(p) => Ok(p.as_raw()),
        other => Err(corrupt(path, format!("pixels of type {:?} are not supported", other.color()))),
    }
}

/// Reads the stored values of a grey picture, row by row; its rows and columns. In floats, one channel in three may hold them.
pub(super) fn stored(path: &Path) -> Result<(usize, usize, Kind, Vec<f32>), SceneError> {
    let image = decode(path, MOST_PIXELS)?;
    let channels = usize::from(image.color().channel_count());
    let has_color = image.color().has_color();
    let (kind, values): (_, Vec<f32>) = if let Some(v) = samples8(&image) {
        (Kind::Bytes, grey(v, channels, has_color, |a, b| a.abs_diff(b) <= 8))
    } else if let Some(v) = samples16(&image) {
        (Kind::Words, grey(v, channels, has_color, |a, b| a.abs_diff(b) <= 8 * 257))
    } else {
        let float = floats(path, &image)?;
        (Kind::Floats, grey(float, channels, has_color, |a, b| a.to_bits() == b.to_bits() || b == 0.0))
    };
    if values.is_empty() {
        return Err(corrupt(
            path,
            "its pixels have colours, and nothing says what depth a colour means: a map is grey",
        ));
    }
    Ok((image.height() as usize, image.width() as usize, kind, values))
}

/// The first channel; nothing where another one is not `alike`.
fn grey<T: Copy + Into<f32>>(v: &[T], channels: usize, has_color: bool, alike: impl Fn(T, T) -> bool) -> Vec<f32> {
    let pixels = v.chunks_exact(channels);
    if has_color && !pixels.clone().all(|p| alike(p[0], p[1]) && alike(p[0], p[2])) {
        return Vec::new();
    }
    pixels.map(|p| p[0].into()).collect()
}

/// The samples of an 8-bit image, interleaved.
fn samples8(image: &DynamicImage) -> Option<&[u8]> {
    Some(match image {
        DynamicImage::ImageLuma8(p) => p.as_raw(),
        DynamicImage::ImageLumaA8(p) => p.as_raw(),
        DynamicImage::ImageRgb8(p) => p.as_raw(),
        DynamicImage::ImageRgba8(p) => p.as_raw(),
        _ => return None,
    })
}

/// The samples of a 16-bit image, interleaved.
fn samples16(image: &DynamicImage) -> Option<&[u16]> {
    Some(match image {
        DynamicImage::ImageLuma16(p) => p.as_raw(),
        DynamicImage::ImageLumaA16(p) => p.as_raw(),
        DynamicImage::ImageRgb16(p) => p.as_raw(),
        DynamicImage::ImageRgba16(p) => p.as_raw(),
        _ => return None,
    })
}
