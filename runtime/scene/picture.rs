//! Pictures from files, as planes of linear light, by the crate `image`.

use super::SceneError;
use super::light::{Picture, Transfer, check, srgb_to_linear, table};
use super::near::Kind;
use crate::files::read;
use crate::optics::Color;
use image::{DynamicImage, ImageFormat, ImageReader, Limits};
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
    let (width, height) = open(path)?.into_dimensions().map_err(|e| corrupt(path, e))?;
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
    Ok([height as usize, width as usize])
}

/// Decodes a file; nothing is converted yet.
fn decode(path: &Path, most: u64) -> Result<DynamicImage, SceneError> {
    size_within(path, most)?;
    let reader = open(path)?;
    if reader.format() == Some(ImageFormat::Jpeg) && !jpeg_ends(path)? {
        return Err(corrupt(path, "the file is cut short: a JPEG must reach its end marker"));
    }
    reader.decode().map_err(|e| corrupt(path, e))
}

/// Whether a JPEG's last scan is closed: decoders fill what is missing with grey and say nothing.
fn jpeg_ends(path: &Path) -> Result<bool, SceneError> {
    let bytes = read::bytes(path, read::PICTURE).map_err(|e| SceneError::unreadable(path, &e))?;
    // Inside a scan, 0xff is never followed by these.
    let last_scan = bytes.windows(2).rposition(|b| b == [0xff, 0xda]).unwrap_or(0);
    Ok(bytes[last_scan..].windows(2).any(|b| b == [0xff, 0xd9]))
}

/// Reads the planes of `colors` from a PNG, JPEG or EXR file. A grey picture gives the same plane for each colour;
/// transparency is laid over black. `transfer` overrides what the format implies.
pub(super) fn read(path: &Path, colors: &[Color], transfer: Option<Transfer>) -> Result<Picture, SceneError> {
    planes(path, decode(path, MOST_PIXELS)?, colors, transfer)
}

/// The same of a picture that holds many views.
pub(super) fn read_of_many(path: &Path, colors: &[Color], transfer: Option<Transfer>) -> Result<Picture, SceneError> {
    planes(path, decode(path, MOST_OF_MANY)?, colors, transfer)
}

/// Whether its values are light where nothing else is stated.
pub(super) fn is_linear(path: &Path) -> bool {
    open(path).is_ok_and(|reader| reader.format() == Some(ImageFormat::OpenExr))
}

fn planes(
    path: &Path,
    image: DynamicImage,
    colors: &[Color],
    transfer: Option<Transfer>,
) -> Result<Picture, SceneError> {
    let (height, width) = (image.height() as usize, image.width() as usize);
    let channels = usize::from(image.color().channel_count());
    let (has_color, has_alpha) = (image.color().has_color(), image.color().has_alpha());
    let integer = transfer.unwrap_or(Transfer::Srgb);
    let planes = |light: &dyn Fn(usize) -> f32, alpha: &dyn Fn(usize) -> f32| -> Vec<Vec<f32>> {
        let plane = |color: &Color| {
            let channel = if has_color { color.channel() } else { 0 };
            let value = |i: usize| {
                let v = light(i * channels + channel);
                if has_alpha { v * alpha(i * channels + channels - 1) } else { v }
            };
            (0..height * width).map(value).collect()
        };
        colors.iter().map(plane).collect()
    };
    let planes = if let Some(v) = samples8(&image) {
        let table = table(u8::MAX.into(), integer);
        planes(&|i| table[usize::from(v[i])], &|i| f32::from(v[i]) / 255.0)
    } else if let Some(v) = samples16(&image) {
        let table = table(u16::MAX, integer);
        planes(&|i| table[usize::from(v[i])], &|i| f32::from(v[i]) / 65535.0)
    } else {
        let float = match &image {
            DynamicImage::ImageRgb32F(p) => p.as_raw(),
            DynamicImage::ImageRgba32F(p) => p.as_raw(),
            other => return Err(corrupt(path, format!("pixels of type {:?} are not supported", other.color()))),
        };
        // EXR keeps colour already multiplied by its transparency.
        let read = planes(&|i| float[i], &|_| 1.0);
        for plane in &read {
            check(path, plane, width, |v| v.is_finite() && v >= 0.0, "finite and not negative")?;
        }
        match transfer {
            Some(Transfer::Srgb) => {
                let decode = |v: f32| srgb_to_linear(f64::from(v)) as f32;
                read.into_iter().map(|p| p.into_iter().map(decode).collect()).collect()
            }
            _ => read,
        }
    };
    Ok(Picture { height, width, planes })
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
        let float = match &image {
            DynamicImage::ImageRgb32F(p) => p.as_raw(),
            DynamicImage::ImageRgba32F(p) => p.as_raw(),
            other => return Err(corrupt(path, format!("pixels of type {:?} are not supported", other.color()))),
        };
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
