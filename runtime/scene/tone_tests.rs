//! Tests pictures and arrays whose values have another full scale than their type. Each is read with the right light,
//! or refused until the value of white is stated.

use super::{GREEN, display};
use crate::*;
use std::fs;
use std::path::PathBuf;

const N: usize = 16;
/// Returns the linear light of the pattern, which is a ramp that reaches white.
fn pattern() -> Vec<f32> {
    (0..N * N).map(|i| (i % N) as f32 / (N - 1) as f32).collect()
}

/// Returns the pattern as sRGB values from 0 to 1.
fn encoded() -> Vec<f32> {
    pattern().into_iter().map(|v| eyebox_base::files::linear_to_srgb(f64::from(v)) as f32).collect()
}

fn npy(folder: &Path, kind: &str, values: &[f32]) -> PathBuf {
    let path = folder.join("views.npy");
    let bytes: Vec<u8> = match kind {
        "<u2" => values.iter().flat_map(|v| (v.round() as u16).to_le_bytes()).collect(),
        "|u1" => values.iter().map(|v| v.round() as u8).collect(),
        _ => values.iter().flat_map(|v| v.to_le_bytes()).collect(),
    };
    fs::write(&path, [eyebox_base::files::npy_header(kind, &[1, 1, N, N]), bytes].concat()).unwrap();
    path
}

fn green(source: &str) -> Result<Vec<f32>, SceneError> {
    let display = display(N, N);
    Ok(load(source, &Request::new(&display, &GREEN))?.planes.remove(0).remove(0))
}

fn largest_error(found: &[f32], wanted: &[f32]) -> f32 {
    found.iter().zip(wanted).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
}

/// Values of 10, 12 and 14 bits in 16, and floats of 0 to 255, 1023, 4095, 65535 or 100, need the value of white. The
/// remedy of the refusal gives the right light.
#[test]
fn unknown_full_scales_are_refused_and_stated_ones_are_right() {
    let folder = tempfile::tempdir().unwrap();
    let cases: [(&str, f32); 12] = [
        ("<u2", 255.0),
        ("<u2", 511.0),
        ("<u2", 1023.0),
        ("<u2", 4095.0),
        ("<u2", 10000.0),
        ("<u2", 16383.0),
        ("<f4", 255.0),
        ("<f4", 1023.0),
        ("<f4", 4095.0),
        ("<f4", 65535.0),
        ("<f4", 100.0),
        ("<f4", 30.0),
    ];
    for (kind, white) in cases {
        let stored = if kind == "<f4" { pattern() } else { encoded() };
        let file = npy(folder.path(), kind, &stored.iter().map(|v| v * white).collect::<Vec<_>>());
        let name = file.to_str().unwrap();
        let refused = green(name).unwrap_err();
        assert!(matches!(refused, SceneError::FullScale { .. }), "{kind} up to {white}: {refused}");
        let light = green(&format!("{name}?full_scale={white}")).unwrap();
        assert!(largest_error(&light, &pattern()) < 4.0 / white.max(100.0), "{kind} up to {white}");
        // A lightfield.toml in the same folder has the same effect.
        fs::write(folder.path().join("lightfield.toml"), format!("full_scale = {white}\n")).unwrap();
        assert_eq!(green(name).unwrap(), light);
        fs::remove_file(folder.path().join("lightfield.toml")).unwrap();
    }
}

/// Values that fill their type are read as before.
#[test]
fn known_full_scales_are_read_without_a_word() {
    let folder = tempfile::tempdir().unwrap();
    let scaled = |by: f32| encoded().into_iter().map(|v| v * by).collect::<Vec<_>>();
    let dark = |by: f32| encoded().into_iter().map(|v| (v * by).round() * 257.0).collect::<Vec<_>>();
    for (kind, values, wanted) in [
        ("|u1", scaled(255.0), pattern()),
        ("<u2", scaled(65535.0), pattern()),
        (
            "<u2",
            dark(60.0),
            pattern()
                .iter()
                .map(|v| {
                    srgb_to_linear((eyebox_base::files::linear_to_srgb(f64::from(*v)) * 60.0).round() / 255.0) as f32
                })
                .collect(),
        ),
        ("<f4", pattern(), pattern()),
        ("<f4", pattern().iter().map(|v| v * 0.2).collect(), pattern().iter().map(|v| v * 0.2).collect()),
    ] {
        let file = npy(folder.path(), kind, &values);
        let light = green(file.to_str().unwrap()).unwrap();
        assert!(largest_error(&light, &wanted) < 0.01, "{kind}");
    }
}

/// A few highlights above white become white, rounding errors below black become black, and clearly negative light is
/// refused.
#[test]
fn highlights_are_white_and_rounding_errors_black() {
    let folder = tempfile::tempdir().unwrap();
    let with = |place: usize, value: f32| {
        let mut values = pattern();
        values[place] = value;
        values
    };
    let of = |value: f32| green(npy(folder.path(), "<f4", &with(5 * N + 3, value)).to_str().unwrap());
    for (value, wanted) in [(30.0, 1.0), (1e6, 1.0), (1.0005, 1.0), (-1e-6, 0.0), (-0.009, 0.0)] {
        let light = of(value).unwrap();
        assert_eq!(light[5 * N + 3], wanted, "{value}");
        assert!(largest_error(&light, &with(5 * N + 3, wanted)) < 1e-6, "{value}");
    }
    for value in [-0.5, -30.0, f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        match of(value).unwrap_err() {
            SceneError::Value { row, column, value: found, .. } => {
                assert_eq!((row, column, found.to_bits()), (5, 3, value.to_bits()));
            }
            other => panic!("{value}: {other}"),
        }
    }
}

mod pictures {
    use super::*;
    use image::{ImageBuffer, Luma, Rgb, Rgba};

    fn side() -> u32 {
        N as u32
    }

    /// Writes a folder of 3 x 3 views, each the pattern with 16-bit values up to `white`.
    fn views(folder: &Path, white: f32) {
        let stored = encoded();
        let view = ImageBuffer::from_fn(side(), side(), |x, y| {
            Luma([(stored[y as usize * N + x as usize] * white).round() as u16])
        });
        for row in 0..3 {
            for column in 0..3 {
                view.save(folder.join(format!("v_{row}_{column}.png"))).unwrap();
            }
        }
    }

    #[test]
    fn folders_of_ten_to_fourteen_bits_state_their_white() {
        for white in [1023.0, 4095.0, 16383.0] {
            let folder = tempfile::tempdir().unwrap();
            views(folder.path(), white);
            let name = folder.path().to_str().unwrap();
            let refused = green(name).unwrap_err();
            assert!(matches!(refused, SceneError::FullScale { how: FullScale::Folder, .. }), "{refused}");
            fs::write(folder.path().join("lightfield.toml"), format!("full_scale = {white}\n")).unwrap();
            assert!(largest_error(&green(name).unwrap(), &pattern()) < 0.003, "{white}");
        }
        let folder = tempfile::tempdir().unwrap();
        views(folder.path(), 65535.0);
        assert!(largest_error(&green(folder.path().to_str().unwrap()).unwrap(), &pattern()) < 1e-3);
    }

    /// One picture of a scene may be dark, because all of them together decide.
    #[test]
    fn a_dark_view_among_others_is_no_other_full_scale() {
        let folder = tempfile::tempdir().unwrap();
        views(folder.path(), 65535.0);
        ImageBuffer::from_fn(side(), side(), |x, _| Luma([x as u16 * 100]))
            .save(folder.path().join("v_2_2.png"))
            .unwrap();
        green(folder.path().to_str().unwrap()).unwrap();
    }

    #[test]
    fn single_pictures_state_their_white_and_their_transfer() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        let map = at("map.png");
        ImageBuffer::from_fn(side(), side(), |x, _| Luma([x as u8 * 16])).save(&map).unwrap();
        let save = |name: &str, white: f32, values: &[f32]| {
            let pixel = |x: u32, y: u32| Rgb([(values[y as usize * N + x as usize] * white).round() as u16; 3]);
            ImageBuffer::from_fn(side(), side(), pixel).save(at(name)).unwrap();
            at(name).to_str().unwrap().to_owned()
        };
        let display = display(N, N);
        let read = |source: &str| {
            let request =
                Request { views: 1, depth_map: Some(&map), depth: Some([0.0, 0.0]), ..Request::new(&display, &GREEN) };
            load(source, &request).map(|field| field.planes[0][0].clone())
        };
        let ten = save("ten.png", 1023.0, &encoded());
        assert!(matches!(read(&ten), Err(SceneError::FullScale { how: FullScale::File, .. })));
        assert!(largest_error(&read(&format!("{ten}?full_scale=1023")).unwrap(), &pattern()) < 0.01);
        let linear = save("linear.png", 65535.0, &pattern());
        assert!(largest_error(&read(&format!("{linear}?linear")).unwrap(), &pattern()) < 0.01);
        let both = save("both.png", 4095.0, &pattern());
        assert!(largest_error(&read(&format!("{both}?linear&full_scale=4095")).unwrap(), &pattern()) < 0.01);
        for query in ["full_scale=0", "full_scale=-1", "full_scale=nan", "full_scale=x", "white=3"] {
            assert!(matches!(read(&format!("{ten}?{query}")), Err(SceneError::Options { .. })), "{query}");
        }
    }

    /// A PNG that states its transfer function is read by it, or refused until the caller states one.
    #[test]
    fn stated_transfer_functions_of_pngs_count() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("a.png");
        let name = file.to_str().unwrap().to_owned() + "?grid=1x1";
        let save = |values: &[f32], chunks: &[(&[u8; 4], &[u8])]| {
            let pixel = |x: u32, y: u32| Luma([(values[y as usize * N + x as usize] * 65535.0).round() as u16]);
            ImageBuffer::from_fn(side(), side(), pixel).save(&file).unwrap();
            let bytes = fs::read(&file).unwrap();
            let mut all = bytes[..33].to_vec();
            for (kind, value) in chunks {
                let chunk = [&kind[..], value].concat();
                let crc = !chunk.iter().fold(!0u32, |crc, byte| {
                    (0..8).fold(crc ^ u32::from(*byte), |c, _| if c & 1 == 1 { c >> 1 ^ 0xedb8_8320 } else { c >> 1 })
                });
                all.extend((value.len() as u32).to_be_bytes());
                all.extend(chunk);
                all.extend(crc.to_be_bytes());
            }
            all.extend(&bytes[33..]);
            fs::write(&file, all).unwrap();
        };
        let gamma = |value: f64| ((value * 1e5).round() as u32).to_be_bytes();
        let (linear, srgb) = (pattern(), encoded());
        let (one, usual, old, wide) = (gamma(1.0), gamma(0.45455), gamma(0.5556), gamma(0.3));
        type Chunks<'a> = &'a [(&'a [u8; 4], &'a [u8])];
        let read: [(&[f32], Chunks); 8] = [
            (&srgb, &[]),
            (&linear, &[(b"gAMA", &one)]),
            (&srgb, &[(b"gAMA", &usual)]),
            (&srgb, &[(b"sRGB", &[0])]),
            (&srgb, &[(b"sRGB", &[0]), (b"gAMA", &usual)]),
            (&linear, &[(b"cICP", &[1, 8, 0, 1])]),
            (&srgb, &[(b"cICP", &[1, 13, 0, 1])]),
            (&srgb, &[(b"cICP", &[1, 13, 0, 1]), (b"gAMA", &one)]),
        ];
        for (i, (values, chunks)) in read.into_iter().enumerate() {
            save(values, chunks);
            assert!(largest_error(&green(&name).unwrap(), &pattern()) < 1e-3, "{i}");
        }
        for (i, chunk) in [(b"gAMA", &old), (b"gAMA", &wide), (b"cICP", &[9, 16, 0, 1]), (b"cICP", &[9, 18, 0, 1])]
            .into_iter()
            .enumerate()
        {
            save(&linear, &[(chunk.0, chunk.1)]);
            assert!(matches!(green(&name), Err(SceneError::Transfer { .. })), "{i}");
            assert!(largest_error(&green(&(name.clone() + "&linear")).unwrap(), &pattern()) < 1e-3, "{i}");
        }
    }

    #[test]
    fn transparent_pictures_are_refused_and_partly_transparent_ones_lie_over_black() {
        let folder = tempfile::tempdir().unwrap();
        let name = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
        let save = |alpha: &dyn Fn(u32) -> u8| {
            let pixel = |x: u32, _| Rgba([255, 255, 255, alpha(x)]);
            ImageBuffer::from_fn(side(), side(), pixel).save(name("a.png")).unwrap();
            green(&(name("a.png") + "?grid=1x1"))
        };
        assert!(matches!(save(&|_| 0), Err(SceneError::Transparent { .. })));
        let half = save(&|x| if x < 8 { 0 } else { 255 }).unwrap();
        assert!(half[..8].iter().all(|v| *v == 0.0) && half[8..N].iter().all(|v| *v == 1.0));
        assert!(save(&|_| 255).unwrap().iter().all(|v| *v == 1.0));
    }
}

/// With views of 8 bits and views of 10 bits in 16, no full scale is right for both, whether it is stated or not.
#[test]
fn one_full_scale_is_not_taken_for_pictures_of_different_bits() {
    for (white, may_be) in [(1023.0, false), (4095.0, false), (65535.0, true)] {
        let folder = tempfile::tempdir().unwrap();
        let bytes = encoded().iter().map(|v| (v * 255.0).round() as u8).collect();
        let words: Vec<u16> = encoded().iter().map(|v| (v * white).round() as u16).collect();
        image::GrayImage::from_raw(N as u32, N as u32, bytes).unwrap().save(folder.path().join("v_0_0.png")).unwrap();
        let words: image::ImageBuffer<image::Luma<u16>, _> =
            image::ImageBuffer::from_raw(N as u32, N as u32, words).unwrap();
        words.save(folder.path().join("v_0_1.png")).unwrap();
        let source = folder.path().to_str().unwrap();
        let read = green(source);
        assert_eq!(read.is_ok(), may_be, "{white}: {read:?}");
        assert!(may_be || matches!(read, Err(SceneError::MixedScales { .. })), "{white}: {read:?}");
        fs::write(folder.path().join("lightfield.toml"), format!("full_scale = {white}\n")).unwrap();
        assert!(matches!(green(source), Err(SceneError::MixedScales { .. })), "{white}");
    }
}
