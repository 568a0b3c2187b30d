//! Writes PNG pictures for people, from linear light to sRGB, and of gray levels for SLMs.

use super::{FileError, encode_png8, write_file};
use std::{
    io::{self, Write},
    path::Path,
};

/// Converts linear light in 0..1 to sRGB in 0..1, by the exact curve (IEC 61966-2-1). Values outside are clipped.
pub fn linear_to_srgb(v: f64) -> f64 {
    let v = v.clamp(0.0, 1.0);
    if v <= 0.003_130_8 { 12.92 * v } else { 1.055 * v.powf(1.0 / 2.4) - 0.055 }
}

/// Writes linear light as an 8-bit sRGB PNG.
///
/// `planes` has one (gray) or three (red, green, blue) planes of `height` x `width`. A NaN becomes black.
///
/// # Errors
/// Returns the errors of [`write_file`].
///
/// # Panics
/// Panics if there are not one or three planes, or if one has another size. This is a mistake of the caller.
pub fn write_png(file: &Path, height: usize, width: usize, planes: &[&[f32]]) -> Result<(), FileError> {
    write_file(file, |out| encode_png(out, height, width, planes))
}

/// Encodes linear light as an 8-bit sRGB PNG, with the arguments of [`write_png`].
///
/// # Errors
/// Returns the errors of `out`.
///
/// # Panics
/// Panics as [`write_png`] does.
pub fn encode_png(out: &mut dyn Write, height: usize, width: usize, planes: &[&[f32]]) -> io::Result<()> {
    assert!(matches!(planes.len(), 1 | 3), "a picture has one or three planes, not {}", planes.len());
    assert!(planes.iter().all(|p| p.len() == height * width), "every plane is {height} x {width}");
    let mut bytes = Vec::with_capacity(planes.len() * height * width);
    for i in 0..height * width {
        // A cast from float saturates, and turns NaN into 0.
        bytes.extend(planes.iter().map(|p| (linear_to_srgb(f64::from(p[i])) * 255.0).round() as u8));
    }
    encode_png8(out, height, width, planes.len(), &bytes)
}

#[cfg(all(test, feature = "image-formats"))]
mod tests {
    use super::super::{encode_jpeg8, read_png8};
    use super::*;

    fn grey8(file: &Path) -> Result<(usize, usize, Vec<u8>), FileError> {
        let opened = std::fs::File::open(file).map_err(|e| FileError::read(file, e))?;
        match read_png8(opened, file)? {
            (height, width, 1, levels) => Ok((height, width, levels)),
            _ => Err(FileError::content(file, crate::reason!("colors", "has colors"))),
        }
    }

    #[test]
    fn the_curve_has_its_published_values() {
        // 18 % gray is level 118. The ends and the knee are exact.
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
        assert!(matches!(grey8(&file), Err(FileError::Content { .. })));

        write_file(&file, |out| encode_png8(out, 2, 3, 1, &[0, 1, 2, 3, 4, 255])).unwrap();
        assert_eq!(grey8(&file).unwrap(), (2, 3, vec![0, 1, 2, 3, 4, 255]));

        let (mut png, mut jpeg) = (Vec::new(), Vec::new());
        let levels: Vec<u8> = [200, 40, 90].repeat(64);
        encode_png8(&mut png, 8, 8, 3, &levels).unwrap();
        encode_jpeg8(&mut jpeg, 8, 8, &levels, 90).unwrap();
        assert_eq!(image::load_from_memory(&png).unwrap().into_rgb8().into_raw(), levels);
        let near = image::load_from_memory(&jpeg).unwrap().into_rgb8().into_raw();
        assert!(near.iter().zip(&levels).all(|(a, b)| a.abs_diff(*b) < 6), "{near:?}");

        let whole = std::fs::read(&file).unwrap();
        std::fs::write(&file, &whole[..whole.len() - 20]).unwrap();
        assert!(matches!(grey8(&file), Err(FileError::Content { .. })));
        assert!(matches!(grey8(&here.path().join("none")), Err(FileError::Read { .. })));
    }
}
