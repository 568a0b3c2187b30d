//! PNG: pictures for people (linear light in, sRGB out) and grey levels for SLMs.

use super::{FileError, write_file};
use image::{ExtendedColorType, ImageEncoder, ImageReader, codecs::jpeg::JpegEncoder, codecs::png::PngEncoder};
use std::{
    fs::File,
    io::{self, BufReader, Write},
    path::Path,
};

/// Linear light in 0..1 to sRGB in 0..1, by the exact curve (IEC 61966-2-1); clips what lies outside.
pub fn linear_to_srgb(v: f64) -> f64 {
    let v = v.clamp(0.0, 1.0);
    if v <= 0.003_130_8 { 12.92 * v } else { 1.055 * v.powf(1.0 / 2.4) - 0.055 }
}

/// Writes linear light as an 8-bit sRGB PNG.
///
/// `planes`: one (grey) or three (red, green, blue) planes of `height` x `width`; a NaN shows as black.
///
/// # Errors
/// Those of [`write_file`].
///
/// # Panics
/// If there are not one or three planes, or one has another size: the caller's mistake.
pub fn write_png(file: &Path, height: usize, width: usize, planes: &[&[f32]]) -> Result<(), FileError> {
    let kind = match planes.len() {
        1 => ExtendedColorType::L8,
        3 => ExtendedColorType::Rgb8,
        n => panic!("a picture has one or three planes, not {n}"),
    };
    assert!(planes.iter().all(|p| p.len() == height * width), "every plane is {height} x {width}");
    let mut bytes = Vec::with_capacity(planes.len() * height * width);
    for i in 0..height * width {
        // A cast from float saturates, and takes NaN to 0.
        bytes.extend(planes.iter().map(|p| (linear_to_srgb(f64::from(p[i])) * 255.0).round() as u8));
    }
    write_file(file, |out| encode(out, height, width, kind, &bytes))
}

/// Encodes grey levels as they are, `height` x `width` of them, as an 8-bit PNG.
///
/// # Errors
/// Those of `out`.
pub fn encode_grey8(out: &mut dyn Write, height: usize, width: usize, levels: &[u8]) -> io::Result<()> {
    encode(out, height, width, ExtendedColorType::L8, levels)
}

/// Encodes 8-bit red, green, blue as they are, `height` x `width` of them, as a PNG.
///
/// # Errors
/// Those of `out`.
pub fn encode_rgb8(out: &mut dyn Write, height: usize, width: usize, levels: &[u8]) -> io::Result<()> {
    encode(out, height, width, ExtendedColorType::Rgb8, levels)
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

fn encode(out: &mut dyn Write, height: usize, width: usize, kind: ExtendedColorType, bytes: &[u8]) -> io::Result<()> {
    PngEncoder::new(out).write_image(bytes, width as u32, height as u32, kind).map_err(plain)
}

fn plain(error: image::ImageError) -> io::Error {
    match error {
        image::ImageError::IoError(e) => e,
        other => io::Error::other(other),
    }
}

/// Reads an 8-bit grey PNG: (height, width, levels).
///
/// # Errors
/// [`FileError::Read`]; [`FileError::Content`] for anything but a whole 8-bit grey PNG.
pub fn read_grey8(file: &Path) -> Result<(usize, usize, Vec<u8>), FileError> {
    let opened = File::open(file).map_err(|e| FileError::read(file, e))?;
    let reader = ImageReader::with_format(BufReader::new(opened), image::ImageFormat::Png);
    match reader.decode() {
        Ok(image::DynamicImage::ImageLuma8(image)) => {
            Ok((image.height() as usize, image.width() as usize, image.into_raw()))
        }
        Ok(other) => Err(FileError::content(file, format!("holds {:?} pixels: 8-bit grey is wanted", other.color()))),
        Err(e) => Err(FileError::content(file, format!("is no whole PNG: {e}"))),
    }
}

/// Grey levels of a picture.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Grey {
    /// 256 or 65536: what the picture's bits can tell apart.
    pub levels: u32,
    /// Row by row.
    pub values: Vec<u16>,
}

/// Reads the grey levels of an 8- or 16-bit PNG or BMP as they are stored, if the picture has this many rows and
/// columns; else answers how many it has. A coloured format will do where all pixels are grey.
///
/// # Errors
/// [`FileError::Read`]; [`FileError::Content`] for what is no whole PNG or BMP, and for colours.
pub fn read_grey(file: &Path, size: [usize; 2]) -> Result<Result<Grey, [usize; 2]>, FileError> {
    let reader = || {
        let reader = ImageReader::open(file).and_then(ImageReader::with_guessed_format);
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_curve_has_its_published_values() {
        // 18 % grey is level 118; the ends and the knee are exact.
        assert_eq!((linear_to_srgb(0.18) * 255.0).round(), 118.0);
        assert_eq!((linear_to_srgb(-1.0), linear_to_srgb(2.0)), (0.0, 1.055 - 0.055));
        assert!((linear_to_srgb(0.003_130_8) - linear_to_srgb(0.003_130_9)).abs() < 2e-6);
        // Every 8-bit level decodes and encodes to itself.
        for level in 0..=255u8 {
            let v = f64::from(level) / 255.0;
            let linear = if v <= 0.04045 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) };
            assert_eq!((linear_to_srgb(linear) * 255.0).round() as u8, level);
        }
    }

    #[test]
    fn pictures_come_out_in_their_colours() {
        let here = tempfile::tempdir().unwrap();
        let file = here.path().join("a.png");
        let (r, g, b) = ([1.0, 0.0], [0.18, f32::NAN], [0.0, 7.0]);
        write_png(&file, 1, 2, &[&r, &g, &b]).unwrap();
        let image = image::open(&file).unwrap().into_rgb8();
        assert_eq!(image.into_raw(), [255, 118, 0, 0, 0, 255]);
        assert!(matches!(read_grey8(&file), Err(FileError::Content { .. })));

        write_file(&file, |out| encode_grey8(out, 2, 3, &[0, 1, 2, 3, 4, 255])).unwrap();
        assert_eq!(read_grey8(&file).unwrap(), (2, 3, vec![0, 1, 2, 3, 4, 255]));

        let (mut png, mut jpeg) = (Vec::new(), Vec::new());
        let levels: Vec<u8> = [200, 40, 90].repeat(64);
        encode_rgb8(&mut png, 8, 8, &levels).unwrap();
        encode_jpeg8(&mut jpeg, 8, 8, &levels, 90).unwrap();
        assert_eq!(image::load_from_memory(&png).unwrap().into_rgb8().into_raw(), levels);
        let near = image::load_from_memory(&jpeg).unwrap().into_rgb8().into_raw();
        assert!(near.iter().zip(&levels).all(|(a, b)| a.abs_diff(*b) < 6), "{near:?}");

        let whole = std::fs::read(&file).unwrap();
        std::fs::write(&file, &whole[..whole.len() - 20]).unwrap();
        assert!(matches!(read_grey8(&file), Err(FileError::Content { .. })));
        assert!(matches!(read_grey8(&here.path().join("none")), Err(FileError::Read { .. })));
    }
}
