//! Writes files as other programs write them.

use image::RgbImage;
use image::codecs::jpeg::JpegEncoder;
use std::fs;
use std::path::Path;

/// Writes a file and makes the folders around it.
pub fn file(path: &Path, bytes: impl AsRef<[u8]>) {
    fs::create_dir_all(path.parent().expect("a folder")).expect("a folder");
    fs::write(path, bytes).expect("a file");
}

/// Returns a NumPy array of any type. `descr` is NumPy's name of the type.
pub fn npy(descr: &str, fortran: bool, shape: &[usize], bytes: &[u8]) -> Vec<u8> {
    let order = if fortran { "True" } else { "False" };
    let axes: String = shape.iter().map(|n| format!("{n}, ")).collect();
    let header =
        format!("{{'descr': '{descr}', 'fortran_order': {order}, 'shape': ({axes}), }}").replace(", ), }", ",), }");
    let header = format!("{header:<117}\n");
    [b"\x93NUMPY\x01\x00", &(header.len() as u16).to_le_bytes()[..], header.as_bytes(), bytes].concat()
}

fn crc32(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(!0u32, |crc, byte| {
        (0..8).fold(crc ^ u32::from(*byte), |crc, _| if crc & 1 == 1 { crc >> 1 ^ 0xedb8_8320 } else { crc >> 1 })
    })
}

/// Returns a ZIP archive without compression, as `numpy.savez` and file managers write it.
pub fn zip(entries: &[(&str, Vec<u8>)]) -> Vec<u8> {
    let (mut out, mut list) = (Vec::new(), Vec::new());
    for (name, bytes) in entries {
        let (at, size) = ((out.len() as u32).to_le_bytes(), (bytes.len() as u32).to_le_bytes());
        let common = [
            &[0u8; 6][..],
            &[0; 2],
            &crc32(bytes).to_le_bytes(),
            &size,
            &size,
            &(name.len() as u16).to_le_bytes(),
            &[0; 2],
        ]
        .concat();
        out.extend([b"PK\x03\x04\x14\0", &common[..], name.as_bytes(), bytes].concat());
        list.extend([b"PK\x01\x02\x14\0\x14\0", &common[..], &[0; 10], &at, name.as_bytes()].concat());
    }
    let [count, length, start] = [entries.len(), list.len(), out.len()];
    let count = (count as u16).to_le_bytes();
    out.extend(&list);
    out.extend([b"PK\x05\x06\0\0\0\0", &count[..], &count].concat());
    out.extend([&(length as u32).to_le_bytes()[..], &(start as u32).to_le_bytes(), &[0; 2]].concat());
    out
}

/// Returns a map of floats as PFM, which begins with the bottom row.
pub fn pfm([height, width]: [usize; 2], values: &[f32], big: bool) -> Vec<u8> {
    let mut out = format!("Pf\n{width} {height}\n{}\n", if big { "1.0" } else { "-1.0" }).into_bytes();
    let bytes = |v: &f32| if big { v.to_be_bytes() } else { v.to_le_bytes() };
    values.chunks_exact(width).rev().flatten().for_each(|v| out.extend(bytes(v)));
    out
}

/// Returns an EXR of floats without compression. `channels` has the names in alphabetic order, with their values.
pub fn exr(size: [usize; 2], channels: &[(&str, Vec<f32>)]) -> Vec<u8> {
    exr_in(size, None, channels)
}

/// Returns such an EXR with chromaticities, which are x and y of red, green, blue and white.
pub fn exr_in([height, width]: [usize; 2], primaries: Option<[f32; 8]>, channels: &[(&str, Vec<f32>)]) -> Vec<u8> {
    let int = |v: usize| (v as u32).to_le_bytes();
    let attribute = |name: &str, kind: &str, value: &[u8]| {
        [name.as_bytes(), b"\0", kind.as_bytes(), b"\0", &int(value.len()), value].concat()
    };
    let one = |(name, _): &(&str, Vec<f32>)| [name.as_bytes(), b"\0", &int(2), &[0; 4], &int(1), &int(1)].concat();
    let list = [channels.iter().flat_map(one).collect(), vec![0]].concat();
    let window = [int(0), int(0), int(width - 1), int(height - 1)].concat();
    let float = 1f32.to_le_bytes();
    let mut out = [
        &b"v/1\x01\x02\0\0\0"[..],
        &attribute("channels", "chlist", &list),
        &primaries
            .map(|at| attribute("chromaticities", "chromaticities", &at.map(f32::to_le_bytes).concat()))
            .unwrap_or_default(),
        &attribute("compression", "compression", &[0]),
        &attribute("dataWindow", "box2i", &window),
        &attribute("displayWindow", "box2i", &window),
        &attribute("lineOrder", "lineOrder", &[0]),
        &attribute("pixelAspectRatio", "float", &float),
        &attribute("screenWindowCenter", "v2f", &[0; 8]),
        &attribute("screenWindowWidth", "float", &float),
        &[0],
    ]
    .concat();
    let (line, start) = (8 + 4 * width * channels.len(), out.len() + 8 * height);
    (0..height).for_each(|y| out.extend(((start + y * line) as u64).to_le_bytes()));
    for y in 0..height {
        out.extend([int(y), int(line - 8)].concat());
        channels.iter().for_each(|(_, v)| v[y * width..][..width].iter().for_each(|v| out.extend(v.to_le_bytes())));
    }
    out
}

/// Returns an EXR with the red, green and blue of a picture as channels.
pub fn exr_of(picture: &RgbImage, value: impl Fn(u8) -> f32) -> Vec<u8> {
    let plane = |c: usize| picture.pixels().map(|p| value(p.0[c])).collect::<Vec<f32>>();
    exr([picture.height() as usize, picture.width() as usize], &[("B", plane(2)), ("G", plane(1)), ("R", plane(0))])
}

/// Returns a JPEG that a viewer rotates by an EXIF orientation.
pub fn jpeg(picture: &RgbImage, orientation: u8) -> Vec<u8> {
    let mut bytes = Vec::new();
    JpegEncoder::new_with_quality(&mut bytes, 100).encode_image(picture).expect("a JPEG");
    let tags =
        [&b"Exif\0\0II*\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0"[..], &[orientation, 0, 0, 0], &[0; 4]].concat();
    [&bytes[..2], &[0xff, 0xe1], &(tags.len() as u16 + 2).to_be_bytes(), &tags, &bytes[2..]].concat()
}

/// Returns a PNG with one more chunk before its pixels.
pub fn with_chunk(png: &[u8], kind: &[u8; 4], data: &[u8]) -> Vec<u8> {
    let chunk = [kind, data].concat();
    [&png[..33], &(data.len() as u32).to_be_bytes(), &chunk, &crc32(&chunk).to_be_bytes(), &png[33..]].concat()
}

/// Returns a picture as PNG.
pub fn png(picture: impl Into<image::DynamicImage>) -> Vec<u8> {
    let mut bytes = std::io::Cursor::new(Vec::new());
    picture.into().write_to(&mut bytes, image::ImageFormat::Png).expect("a PNG");
    bytes.into_inner()
}

/// Returns a video of one frame with 4:4:4 samples. In its first line, `words` follow the size. `red` and `blue` are
/// the weights of these colors in luma.
pub fn y4m(picture: &RgbImage, words: &str, bits: u32, full: bool, [red, blue]: [f64; 2]) -> Vec<u8> {
    let head = format!("YUV4MPEG2 W{} H{} F25:1 {words}\nFRAME\n", picture.width(), picture.height());
    let scale = f64::from(1u32 << (bits - 8));
    let sample = |v: f64| {
        let v = (v * scale).round().clamp(0.0, 256.0 * scale - 1.0) as u16;
        if bits > 8 { v.to_le_bytes().to_vec() } else { vec![v as u8] }
    };
    let [of_luma, of_chroma, black] = if full { [255.0, 255.0, 0.0] } else { [219.0, 224.0, 16.0] };
    let plane = |which: usize| {
        picture.pixels().flat_map(move |p| {
            let [r, g, b] = p.0.map(|v| f64::from(v) / 255.0);
            let luma = red * r + blue * b + (1.0 - red - blue) * g;
            sample(match which {
                0 => black + of_luma * luma,
                1 => 128.0 + of_chroma * (b - luma) / (2.0 * (1.0 - blue)),
                _ => 128.0 + of_chroma * (r - luma) / (2.0 * (1.0 - red)),
            })
        })
    };
    [head.into_bytes(), (0..3).flat_map(plane).collect()].concat()
}
