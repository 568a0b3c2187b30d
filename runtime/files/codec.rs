//! Pictures to bytes and back, by the crate `image`.

use super::{FileError, Grey, read};
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

/// Reads an 8-bit grey PNG, `file`, that is open: (height, width, levels).
///
/// # Errors
/// [`FileError::Read`]; [`FileError::Content`] for anything but a whole 8-bit grey PNG.
pub(crate) fn read_grey8(opened: File, file: &Path) -> Result<(usize, usize, Vec<u8>), FileError> {
    let reader = ImageReader::with_format(BufReader::new(opened), image::ImageFormat::Png);
    match reader.decode() {
        Ok(image::DynamicImage::ImageLuma8(image)) => {
            Ok((image.height() as usize, image.width() as usize, image.into_raw()))
        }
        Ok(other) => Err(FileError::content(file, format!("holds {:?} pixels: 8-bit grey is wanted", other.color()))),
        Err(e) => Err(FileError::content(file, format!("is no whole PNG: {e}"))),
    }
}

/// Reads an 8-bit PNG, `file`, that is open, as it is stored, grey or coloured: (height, width, channels, bytes), 1 or 3 channels.
///
/// # Errors
/// [`FileError::Read`]; [`FileError::Content`] for what is no whole PNG, for 16 bits a channel, and for pixels that are
/// not opaque.
pub(crate) fn read_png8(opened: File, file: &Path) -> Result<(usize, usize, usize, Vec<u8>), FileError> {
    use image::DynamicImage as Image;
    let reader = ImageReader::with_format(BufReader::new(opened), image::ImageFormat::Png);
    let image = reader
        .decode()
        .map_err(|e| FileError::content(file, format!("is no whole PNG: {}", e.to_string().replace('\n', " "))))?;
    let (height, width) = (image.height() as usize, image.width() as usize);
    let opaque = match &image {
        Image::ImageLumaA8(i) => i.pixels().all(|p| p[1] == 255),
        Image::ImageRgba8(i) => i.pixels().all(|p| p[3] == 255),
        _ => true,
    };
    if !opaque {
        return Err(FileError::content(
            file,
            "has pixels that are not opaque: what a display shows of them is not known",
        ));
    }
    match image {
        Image::ImageLuma8(_) | Image::ImageLumaA8(_) => Ok((height, width, 1, image.into_luma8().into_raw())),
        Image::ImageRgb8(_) | Image::ImageRgba8(_) => Ok((height, width, 3, image.into_rgb8().into_raw())),
        other => {
            Err(FileError::content(file, format!("holds {:?} pixels: 8 bits a channel are wanted", other.color())))
        }
    }
}

/// Reads the grey levels of an 8- or 16-bit PNG or BMP as they are stored, if the picture has this many rows and
/// columns; else answers how many it has. A coloured format will do where all pixels are grey.
///
/// # Errors
/// [`FileError::Read`]; [`FileError::Content`] for what is no whole PNG or BMP, and for colours.
pub(crate) fn read_grey(file: &Path, size: [usize; 2]) -> Result<Result<Grey, [usize; 2]>, FileError> {
    let reader = || {
        let reader = read::open(file).and_then(|f| ImageReader::new(BufReader::new(f)).with_guessed_format());
        let reader = reader.map_err(|e| FileError::read(file, e))?;
        match reader.format() {
            Some(image::ImageFormat::Png | image::ImageFormat::Bmp) => Ok(reader),
            _ => Err(FileError::content(file, "is neither PNG nor BMP")),
        }
    };
    let damaged = |e: image::ImageError| {
        FileError::content(file, format!("is no whole picture: {}", e.to_string().replace('\n', " ")))
    };
    // The size is known before memory is taken for it.
    let (width, height) = reader()?.into_dimensions().map_err(damaged)?;
    let found = [height as usize, width as usize];
    if found != size {
        return Ok(Err(found));
    }
    let mut reader = reader()?;
    reader.no_limits();
    let image = reader.decode().map_err(damaged)?;
    let deep = image.color().bytes_per_pixel() / image.color().channel_count() > 1;
    let rgb = image.color().has_color();
    let levels = if deep { 65536 } else { 256 };
    if !rgb {
        let values = if deep {
            image.into_luma16().into_raw()
        } else {
            image.into_luma8().into_raw().into_iter().map(u16::from).collect()
        };
        return Ok(Ok(Grey { levels, values }));
    }
    let pixels = if deep {
        image.into_rgb16().into_raw()
    } else {
        image.into_rgb8().into_raw().into_iter().map(u16::from).collect()
    };
    if let Some(at) = pixels.chunks_exact(3).position(|p| p[0] != p[1] || p[1] != p[2]) {
        let (row, column) = (at / size[1], at % size[1]);
        return Err(FileError::content(file, format!("is coloured at row {row}, column {column}: grey is wanted")));
    }
    Ok(Ok(Grey { levels, values: pixels.into_iter().step_by(3).collect() }))
}
