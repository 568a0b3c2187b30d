//! Pictures to bytes and back, by the crate `image`.

use super::FileError;
use crate::reason;
use image::{ExtendedColorType, ImageEncoder, ImageReader, codecs::jpeg::JpegEncoder, codecs::png::PngEncoder};
use std::{
    fs::File,
    io::{self, BufReader, Write},
    path::Path,
};

/// Encodes 8-bit pictures of one channel (grey) or three as a PNG.
pub(super) fn encode_png(
    out: &mut dyn Write,
    height: usize,
    width: usize,
    channels: usize,
    bytes: &[u8],
) -> io::Result<()> {
    let kind = if channels == 1 { ExtendedColorType::L8 } else { ExtendedColorType::Rgb8 };
    PngEncoder::new(out).write_image(bytes, width as u32, height as u32, kind).map_err(plain)
}

/// Encodes 8-bit red, green, blue as a JPEG of `quality` 1 to 100, every channel at full resolution: a fifth of the
/// PNG for pictures with speckle, where many have to fit a page.
///
/// # Errors
/// Those of `out`.
pub fn encode_jpeg8(out: &mut dyn Write, height: usize, width: usize, levels: &[u8], quality: u8) -> io::Result<()> {
    let encoder = JpegEncoder::new_with_quality(out, quality);
    encoder.write_image(levels, width as u32, height as u32, ExtendedColorType::Rgb8).map_err(plain)
}

fn plain(error: image::ImageError) -> io::Error {
    match error {
        image::ImageError::IoError(e) => e,
        other => io::Error::other(other),
    }
}

/// Reads an 8-bit PNG, `file`, that is open, as it is stored, grey or coloured: (height, width, channels, bytes), 1 or 3 channels.
///
/// # Errors
/// [`FileError::Read`]; [`FileError::Content`] for what is no whole PNG, for 16 bits a channel, and for pixels that are
/// not opaque.
pub fn read_png8(opened: File, file: &Path) -> Result<(usize, usize, usize, Vec<u8>), FileError> {
    use image::DynamicImage as Image;
    let reader = ImageReader::with_format(BufReader::new(opened), image::ImageFormat::Png);
    let image = reader.decode().map_err(|e| {
        FileError::content(file, reason!("no-whole-png", "is no whole PNG: {}", e.to_string().replace('\n', " ")))
    })?;
    let (height, width) = (image.height() as usize, image.width() as usize);
    let opaque = match &image {
        Image::ImageLumaA8(i) => i.pixels().all(|p| p[1] == 255),
        Image::ImageRgba8(i) => i.pixels().all(|p| p[3] == 255),
        _ => true,
    };
    if !opaque {
        return Err(FileError::content(
            file,
            reason!("not-opaque", "has pixels that are not opaque: what a display shows of them is not known"),
        ));
    }
    match image {
        Image::ImageLuma8(_) | Image::ImageLumaA8(_) => Ok((height, width, 1, image.into_luma8().into_raw())),
        Image::ImageRgb8(_) | Image::ImageRgba8(_) => Ok((height, width, 3, image.into_rgb8().into_raw())),
        other => Err(FileError::content(
            file,
            reason!("bits", "holds {:?} pixels: 8 bits a channel are wanted", other.color()),
        )),
    }
}
