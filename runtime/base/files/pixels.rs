//! Decodes pictures as their files store them, and encodes PNG and JPEG.

use super::{FileError, FileKind, Pixels, Samples, Wanted, exr_pixels, read, tiff_pixels};
use crate::error::Reason;
use crate::reason;
use image::codecs::{gif::GifDecoder, jpeg::JpegEncoder, png::PngEncoder};
use image::metadata::Orientation;
use image::{
    AnimationDecoder, DynamicImage, ExtendedColorType, ImageDecoder, ImageEncoder, ImageError, ImageFormat,
    ImageReader, Limits,
};
use std::fs::File;
use std::io::{self, BufReader, Write};
use std::path::Path;

/// Longest side of a picture in pixels.
const LONGEST_SIDE: u32 = 65536;

/// Determines the kind of a picture from its first bytes, and refuses other files.
fn kind(file: &Path, wanted: Wanted) -> Result<FileKind, FileError> {
    let kind = FileKind::of(file).map_err(|e| FileError::read(file, e))?;
    let is_still = kind.is_picture() && !(kind == FileKind::Gif && is_animated(file)?);
    if is_still { Ok(kind) } else { Err(FileError::of_kind(file, kind, wanted)) }
}

/// Returns true if a GIF has more than one frame.
fn is_animated(file: &Path) -> Result<bool, FileError> {
    let mut decoder = GifDecoder::new(read::buffered(file)?).map_err(|e| FileError::damaged(file, e))?;
    decoder.set_limits(limits()).map_err(|e| FileError::damaged(file, e))?;
    Ok(decoder.into_frames().take(2).filter(Result::is_ok).count() > 1)
}

/// Returns rows and columns of a picture of at most `most` pixels, turned as its metadata state, from the header alone.
///
/// # Errors
/// Returns [`FileError::Read`], [`FileError::Kind`] for a file that is not a picture, or [`FileError::Content`], also
/// for more pixels.
pub fn picture_size(file: &Path, wanted: Wanted, most: u64) -> Result<[usize; 2], FileError> {
    let kind = kind(file, wanted)?;
    let size = match kind {
        FileKind::Exr => exr_pixels::size(file)?,
        FileKind::Tiff => tiff_pixels::size(file)?,
        _ => {
            let (width, height) = open(file, kind)?.into_dimensions().map_err(|e| FileError::damaged(file, e))?;
            [height as usize, width as usize]
        }
    };
    check_size(file, size, most)?;
    // Orientations from 5 on exchange rows and columns.
    Ok(if orientation(file, kind)? >= 5 { [size[1], size[0]] } else { size })
}

/// Returns the names of the layers with colors in an EXR file, in lower case and in the order of the file. Pictures of
/// other formats have none.
///
/// # Errors
/// Returns the errors of [`picture_size`].
pub fn picture_layers(file: &Path) -> Result<Vec<String>, FileError> {
    match kind(file, Wanted::Scene)? {
        FileKind::Exr => exr_pixels::layers(file),
        _ => Ok(Vec::new()),
    }
}

/// Decodes the layers of an EXR file that have these indices among [`picture_layers`]. The file is decompressed once for
/// all of them. Each layer is a picture of at most `most` pixels.
///
/// # Errors
/// Returns the errors of [`read_pixels`], and [`FileError::Content`] for a layer that the file does not have.
pub fn read_layers(file: &Path, indices: &[u16], most: u64) -> Result<Vec<Pixels>, FileError> {
    picture_size(file, Wanted::Scene, most)?;
    exr_pixels::read_layers(file, indices)
}

/// Returns true if a picture has colors and a channel for depths, as EXR files may.
///
/// # Errors
/// Returns the errors of [`picture_size`].
pub fn holds_depth(file: &Path) -> Result<bool, FileError> {
    Ok(kind(file, Wanted::Scene)? == FileKind::Exr && exr_pixels::holds_depth(file)?)
}

/// Returns the EXIF orientation by which a picture is turned, 1 to 8. 1 is as stored.
///
/// # Errors
/// Returns the errors of [`picture_size`].
pub fn picture_orientation(file: &Path, wanted: Wanted) -> Result<u8, FileError> {
    orientation(file, kind(file, wanted)?)
}

/// Returns the orientation of a picture of a known kind. It is 1 if the metadata cannot be read.
fn orientation(file: &Path, kind: FileKind) -> Result<u8, FileError> {
    match kind {
        FileKind::Exr => Ok(1),
        FileKind::Tiff => tiff_pixels::orientation(file),
        _ => {
            let mut decoder = open(file, kind)?.into_decoder().map_err(|e| FileError::damaged(file, e))?;
            Ok(decoder.orientation().unwrap_or(Orientation::NoTransforms).to_exif())
        }
    }
}

/// Decodes a picture of at most `most` pixels, and turns it as its metadata state. In an EXR file with many channels,
/// it reads the channels for `wanted`. The crate `image` reads all formats but EXR and TIFF.
///
/// # Errors
/// Returns the errors of [`picture_size`], and [`FileError::Content`] for values that are neither 8 nor 16 bits nor
/// floats.
pub fn read_pixels(file: &Path, wanted: Wanted, most: u64) -> Result<Pixels, FileError> {
    picture_size(file, wanted, most)?;
    let kind = kind(file, wanted)?;
    let pixels = match kind {
        FileKind::Exr => exr_pixels::read(file, wanted)?,
        FileKind::Tiff => tiff_pixels::read(file)?,
        _ => {
            if kind == FileKind::Jpeg && !jpeg_ends(file)? {
                let reason = reason!("cut-short", "the file is cut short: a JPEG must reach its end marker");
                return Err(FileError::content(file, reason));
            }
            let image = open(file, kind)?.decode().map_err(|e| FileError::damaged(file, e))?;
            let profile = if kind == FileKind::Pnm { None } else { profile(file, kind)? };
            Pixels { profile, ..of_image(file, image)? }
        }
    };
    Ok(pixels.turned(orientation(file, kind)?))
}

/// Returns the name of the kind of a file whose stored values are light unless the file states otherwise. These are
/// EXR, and TIFF of floats.
pub fn holds_light(file: &Path) -> Option<&'static str> {
    match FileKind::of(file) {
        Ok(FileKind::Exr) => Some("EXR"),
        Ok(FileKind::Tiff) if tiff_pixels::is_float(file) => Some("TIFF floats"),
        _ => None,
    }
}

/// Refuses a picture of more than `most` pixels.
fn check_size(file: &Path, [height, width]: [usize; 2], most: u64) -> Result<(), FileError> {
    if (height as u64).saturating_mul(width as u64) <= most {
        return Ok(());
    }
    let most = most >> 20;
    let reason = reason!(
        "too-many-pixels",
        "it has {height} x {width} pixels, but at most {most} Mpx are read: scale it down to the size of the display"
    );
    Err(FileError::content(file, reason))
}

fn limits() -> Limits {
    let mut limits = Limits::default();
    limits.max_image_width = Some(LONGEST_SIDE);
    limits.max_image_height = Some(LONGEST_SIDE);
    limits.max_alloc = Some(1 << 30);
    limits
}

/// Opens a picture that is neither EXR nor TIFF.
fn open(file: &Path, kind: FileKind) -> Result<ImageReader<BufReader<File>>, FileError> {
    let format = match kind {
        FileKind::Png => ImageFormat::Png,
        FileKind::Jpeg => ImageFormat::Jpeg,
        FileKind::Bmp => ImageFormat::Bmp,
        FileKind::Pnm => ImageFormat::Pnm,
        _ => ImageFormat::Gif,
    };
    let mut reader = ImageReader::with_format(read::buffered(file)?, format);
    reader.limits(limits());
    Ok(reader)
}

/// Returns the ICC profile in a picture's metadata.
fn profile(file: &Path, kind: FileKind) -> Result<Option<Vec<u8>>, FileError> {
    let mut decoder = open(file, kind)?.into_decoder().map_err(|e| FileError::damaged(file, e))?;
    // A profile that is cut short becomes an empty one, which `color_space` refuses.
    Ok(decoder.icc_profile().unwrap_or(Some(Vec::new())))
}

fn of_image(file: &Path, image: DynamicImage) -> Result<Pixels, FileError> {
    let size = [image.height() as usize, image.width() as usize];
    let channels = usize::from(image.color().channel_count());
    let samples = match image {
        DynamicImage::ImageLuma8(p) => Samples::U8(p.into_raw()),
        DynamicImage::ImageLumaA8(p) => Samples::U8(p.into_raw()),
        DynamicImage::ImageRgb8(p) => Samples::U8(p.into_raw()),
        DynamicImage::ImageRgba8(p) => Samples::U8(p.into_raw()),
        DynamicImage::ImageLuma16(p) => Samples::U16(p.into_raw()),
        DynamicImage::ImageLumaA16(p) => Samples::U16(p.into_raw()),
        DynamicImage::ImageRgb16(p) => Samples::U16(p.into_raw()),
        DynamicImage::ImageRgba16(p) => Samples::U16(p.into_raw()),
        other => {
            let reason = reason!("pixel-type", "pixels of type {:?} are not supported", other.color());
            return Err(FileError::content(file, reason));
        }
    };
    Ok(Pixels::new(size, channels, samples))
}

/// Returns true if the last scan of a JPEG is closed. Decoders fill missing data with gray and report nothing.
fn jpeg_ends(file: &Path) -> Result<bool, FileError> {
    let bytes = read::bytes(file, read::PICTURE).map_err(|e| FileError::read(file, e))?;
    // Inside a scan, these bytes never follow 0xff.
    let last_scan = bytes.windows(2).rposition(|b| b == [0xff, 0xda]).unwrap_or(0);
    Ok(bytes[last_scan..].windows(2).any(|b| b == [0xff, 0xd9]))
}

/// Encodes 8-bit levels (row, column, channel) unchanged as a PNG, with one channel (gray) or three.
///
/// # Errors
/// Returns the errors of `out`.
pub fn encode_png8(out: &mut dyn Write, height: usize, width: usize, channels: usize, bytes: &[u8]) -> io::Result<()> {
    let kind = if channels == 1 { ExtendedColorType::L8 } else { ExtendedColorType::Rgb8 };
    PngEncoder::new(out).write_image(bytes, width as u32, height as u32, kind).map_err(plain)
}

/// Encodes 8-bit red, green and blue as a JPEG of `quality` 1 to 100, with every channel at full resolution. For
/// pictures with speckle it has a fifth of the size of a PNG, so that many fit on one page.
///
/// # Errors
/// Returns the errors of `out`.
pub fn encode_jpeg8(out: &mut dyn Write, height: usize, width: usize, levels: &[u8], quality: u8) -> io::Result<()> {
    let encoder = JpegEncoder::new_with_quality(out, quality);
    encoder.write_image(levels, width as u32, height as u32, ExtendedColorType::Rgb8).map_err(plain)
}

fn plain(error: ImageError) -> io::Error {
    match error {
        ImageError::IoError(e) => e,
        other => io::Error::other(other),
    }
}

/// Reads an 8-bit PNG, gray or colored, as it is stored. `opened` is the open file at the path `file`. Returns (height,
/// width, channels, bytes) with 1 or 3 channels.
///
/// # Errors
/// Returns [`FileError::Read`], or [`FileError::Content`] for a file that is not a complete PNG, for 16 bits per
/// channel, and for pixels that are not opaque.
pub fn read_png8(opened: File, file: &Path) -> Result<(usize, usize, usize, Vec<u8>), FileError> {
    let wrong = |reason: Reason| FileError::content(file, reason);
    let reader = ImageReader::with_format(BufReader::new(opened), ImageFormat::Png);
    let no_png =
        |e: ImageError| wrong(reason!("no-whole-png", "is not a complete PNG: {}", e.to_string().replace('\n', " ")));
    let image = reader.decode().map_err(no_png)?;
    let kind = image.color();
    let Pixels { height, width, channels, samples: Samples::U8(mut levels), .. } = of_image(file, image)? else {
        return Err(wrong(reason!("bits", "holds {kind:?} pixels: 8 bits per channel are required")));
    };
    let colors = channels - usize::from(kind.has_alpha());
    if colors < channels {
        if levels.chunks_exact(channels).any(|pixel| pixel[colors] != 255) {
            let unknown = "has pixels that are not opaque: save it without transparency";
            return Err(wrong(Reason::new("not-opaque", unknown)));
        }
        levels = levels.chunks_exact(channels).flat_map(|pixel| &pixel[..colors]).copied().collect();
    }
    Ok((height, width, colors, levels))
}
