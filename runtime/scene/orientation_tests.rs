//! Tests pictures that their metadata rotate. They are read upright, so that a depth map of the upright picture fits.

use super::{GREEN, display};
use crate::*;
use image::{DynamicImage, ImageBuffer, ImageFormat, Rgb, metadata::Orientation};
use std::fs;
use std::io::Cursor;

const SIZE: [u32; 2] = [24, 32];

/// Returns a picture without any symmetry.
fn upright() -> DynamicImage {
    let pixel = |x: u32, y: u32| Rgb([(x * 7) as u8, (y * 9 + x) as u8, if x < 9 && y < 6 { 255 } else { 20 }]);
    ImageBuffer::from_fn(SIZE[1], SIZE[0], pixel).into()
}

/// Returns the picture as a camera stores it if the viewer must rotate it by `orientation`.
fn stored(orientation: u8) -> DynamicImage {
    // The inverse of a rotation by 90 degrees is one by 270 degrees, and all others are their own inverses.
    let inverse = match orientation {
        6 => 8,
        8 => 6,
        other => other,
    };
    let mut image = upright();
    image.apply_orientation(Orientation::from_exif(inverse).unwrap());
    image
}

/// Returns a TIFF structure that states the orientation.
fn exif(orientation: u8) -> Vec<u8> {
    [&b"II*\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0"[..], &[orientation, 0, 0, 0], &[0; 4]].concat()
}

fn encoded(image: &DynamicImage, format: ImageFormat) -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    image.write_to(&mut bytes, format).unwrap();
    bytes.into_inner()
}

fn jpeg(image: &DynamicImage, orientation: u8) -> Vec<u8> {
    let (bytes, exif) = (encoded(image, ImageFormat::Jpeg), [b"Exif\0\0", &exif(orientation)[..]].concat());
    let length = (exif.len() as u16 + 2).to_be_bytes();
    [&bytes[..2], &[0xff, 0xe1], &length, &exif, &bytes[2..]].concat()
}

fn png(image: &DynamicImage, orientation: u8) -> Vec<u8> {
    let bytes = encoded(image, ImageFormat::Png);
    let chunk = [b"eXIf", &exif(orientation)[..]].concat();
    let crc = !chunk.iter().fold(!0u32, |crc, byte| {
        (0..8).fold(crc ^ u32::from(*byte), |crc, _| if crc & 1 == 1 { crc >> 1 ^ 0xedb8_8320 } else { crc >> 1 })
    });
    let length = (chunk.len() as u32 - 4).to_be_bytes();
    [&bytes[..33], &length, &chunk, &crc.to_be_bytes(), &bytes[33..]].concat()
}

fn green_of(path: &Path, map: &Path) -> Result<Vec<f32>, SceneError> {
    let display = display(SIZE[0] as usize, SIZE[1] as usize);
    let depth = Some([0.0, 0.0]);
    let request = Request { views: 1, depth_map: Some(map), depth, ..Request::new(&display, &GREEN) };
    Ok(load(path.to_str().unwrap(), &request)?.planes.remove(0).remove(0))
}

fn largest_error(a: &[f32], b: &[f32]) -> f32 {
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
}

#[test]
fn every_orientation_is_read_upright() {
    let here = tempfile::tempdir().unwrap();
    let at = |name: &str| here.path().join(name);
    let map = |image: &DynamicImage| image.to_luma8();
    map(&upright()).save(at("map.png")).unwrap();
    fs::write(at("plain.png"), encoded(&upright(), ImageFormat::Png)).unwrap();
    let wanted = green_of(&at("plain.png"), &at("map.png")).unwrap();
    for orientation in 1..=8 {
        fs::write(at("turned.png"), png(&stored(orientation), orientation)).unwrap();
        fs::write(at("turned.jpg"), jpeg(&stored(orientation), orientation)).unwrap();
        for (name, most) in [("turned.png", 1e-6), ("turned.jpg", 0.2)] {
            assert_eq!(native_size(at(name).to_str().unwrap()).unwrap(), Some([24, 32]), "{name} {orientation}");
            let error = largest_error(&green_of(&at(name), &at("map.png")).unwrap(), &wanted);
            assert!(error < most, "{name} {orientation}: {error}");
            // A map that its metadata rotate is rotated too.
            fs::write(at("map-turned.png"), png(&map(&stored(orientation)).into(), orientation)).unwrap();
            assert!(largest_error(&green_of(&at(name), &at("map-turned.png")).unwrap(), &wanted) < most);
        }
    }
}

/// A map of the pixels as they are stored does not fit. The line names the cause, and its remedy works.
#[test]
fn a_map_of_the_stored_pixels_is_refused_with_the_cause() {
    let here = tempfile::tempdir().unwrap();
    let at = |name: &str| here.path().join(name);
    for orientation in 5..=8 {
        fs::write(at("photo.jpg"), jpeg(&stored(orientation), orientation)).unwrap();
        let map = DynamicImage::from(stored(orientation).to_luma8());
        map.save(at("map.png")).unwrap();
        match green_of(&at("photo.jpg"), &at("map.png")).unwrap_err() {
            SceneError::Turned { height: 32, width: 24, orientation: found, .. } => assert_eq!(found, orientation),
            other => panic!("{orientation}: {other}"),
        }
        let mut likewise = map;
        likewise.apply_orientation(Orientation::from_exif(orientation).unwrap());
        likewise.save(at("map.png")).unwrap();
        green_of(&at("photo.jpg"), &at("map.png")).unwrap();
    }
    // A map of another size has no such cause.
    fs::write(at("photo.jpg"), jpeg(&stored(6), 6)).unwrap();
    DynamicImage::new_luma8(7, 9).save(at("map.png")).unwrap();
    assert!(matches!(green_of(&at("photo.jpg"), &at("map.png")), Err(SceneError::Size { .. })));
}

/// Views of a folder are rotated too.
#[test]
fn views_are_read_upright() {
    let here = tempfile::tempdir().unwrap();
    let display = display(SIZE[0] as usize, SIZE[1] as usize);
    let read = |orientation: u8| {
        for view in 0..3 {
            let file = here.path().join(format!("v_0_{view}.png"));
            fs::write(file, png(&stored(orientation), orientation)).unwrap();
        }
        load(here.path().to_str().unwrap(), &Request::new(&display, &GREEN)).unwrap().planes
    };
    let upright = read(1);
    for orientation in 2..=8 {
        assert_eq!(read(orientation), upright, "{orientation}");
    }
}
