//! Situations with formats of views and with the meaning of their values.

use crate::common::made::tiff;
use crate::frame::{Case, Chapter, Remedy, Situation, case, change, mended};
use crate::judge::Judge;
use crate::made::{EXACT, GRID, SIZE, VIEWS, all, light};
use crate::write::{exr_in, exr_of, file, jpeg, png, with_chunk};
use image::buffer::ConvertBuffer;
use image::{DynamicImage, ImageBuffer, Rgb, RgbImage, Rgba, RgbaImage};
use std::path::Path;

/// Allows the error of JPEG files of the best quality.
const JPEG: Judge = Judge::Like(&VIEWS, 0.015);

/// Writes the usual views to files, which `bytes` encodes.
fn written(folder: &Path, ending: &str, bytes: impl Fn(&RgbImage) -> Vec<u8>) {
    for (i, view) in all().iter().enumerate() {
        file(&folder.join(format!("v_{}_{}.{ending}", i / GRID[1], i % GRID[1])), bytes(view));
    }
}

fn views(have: &str, ending: &'static str, bytes: impl Fn(&RgbImage) -> Vec<u8> + Send + Sync + 'static) -> Case {
    case(have, "render views", move |at| written(&at.join("views"), ending, &bytes))
}

/// Encodes a picture in a format of the `image` crate.
fn saved(picture: impl Into<DynamicImage>, format: image::ImageFormat) -> Vec<u8> {
    let mut bytes = std::io::Cursor::new(Vec::new());
    picture.into().write_to(&mut bytes, format).expect("a picture");
    bytes.into_inner()
}

fn tiff_of(channels_bits_format: [u16; 3], bytes: &[u8]) -> Vec<u8> {
    let temp = crate::common::folder();
    let path = temp.path().join("a.tif");
    tiff(&path, SIZE.map(|n| n as u32), channels_bits_format, bytes);
    std::fs::read(path).expect("a TIFF")
}

/// Returns a picture of 16 bits, whose values `value` makes.
fn words(view: &RgbImage, value: impl Fn(u8) -> u16) -> ImageBuffer<Rgb<u16>, Vec<u16>> {
    ImageBuffer::from_fn(view.width(), view.height(), |x, y| Rgb(view.get_pixel(x, y).0.map(&value)))
}

/// Returns a picture of 16 bits with white at the value `white`.
fn of_white(view: &RgbImage, white: f32) -> ImageBuffer<Rgb<u16>, Vec<u16>> {
    words(view, |v| (f32::from(v) / 255.0 * white).round() as u16)
}

/// Chromaticities of BT.2020, and the light of sRGB's red, green and blue in it, computed in float64.
const WIDE: ([f32; 8], [[f64; 3]; 3]) = (
    [0.708, 0.292, 0.170, 0.797, 0.131, 0.046, 0.3127, 0.3290],
    [
        [0.6274038959, 0.3292830384, 0.0433130657],
        [0.0690972894, 0.9195403951, 0.0113623156],
        [0.0163914389, 0.0880133079, 0.8955952532],
    ],
);
/// Chromaticities of ACES2065-1, and the light of sRGB's red, green and blue in it, computed in float64.
const ACES: ([f32; 8], [[f64; 3]; 3]) = (
    [0.7347, 0.2653, 0.0, 1.0, 0.0001, -0.077, 0.32168, 0.33767],
    [
        [0.4396329819, 0.3829886982, 0.1773783199],
        [0.089776443, 0.8134394287, 0.0967841283],
        [0.0175411704, 0.1115465533, 0.8709122763],
    ],
);

/// Returns the light of a pixel in other primaries.
fn light_in(mix: [[f64; 3]; 3], pixel: [u8; 3]) -> [f64; 3] {
    let [r, g, b] = pixel.map(|v| f64::from(light(v)));
    mix.map(|row| row[0] * r + row[1] * g + row[2] * b)
}

/// Returns a view as EXR in other primaries.
fn exr_of_primaries(view: &RgbImage, (at, mix): ([f32; 8], [[f64; 3]; 3])) -> Vec<u8> {
    let plane = |c: usize| view.pixels().map(|p| light_in(mix, p.0)[c] as f32).collect::<Vec<f32>>();
    exr_in(SIZE, Some(at), &[("B", plane(2)), ("G", plane(1)), ("R", plane(0))])
}

/// Returns a view as PNG in other primaries, with 16 bits of linear light.
fn words_of_primaries(view: &RgbImage, mix: [[f64; 3]; 3]) -> Vec<u8> {
    let words: ImageBuffer<Rgb<u16>, Vec<u16>> = ImageBuffer::from_fn(view.width(), view.height(), |x, y| {
        Rgb(light_in(mix, view.get_pixel(x, y).0).map(|v| (v * 65535.0).round() as u16))
    });
    png(words)
}

/// Returns the data of a chunk `cHRM`, which begins with white.
fn chrm(at: [f32; 8]) -> Vec<u8> {
    let steps = |v: &f32| ((v * 1e5).round() as u32).to_be_bytes();
    at[6..].iter().chain(&at[..6]).flat_map(steps).collect()
}

/// Allows the rounding of linear light to 16 bits.
const LINEAR: Judge = Judge::Like(&VIEWS, 1e-4);

/// Allows the rounding of values to 10, 12 or 14 bits.
const ROUNDED: Judge = Judge::Like(&VIEWS, 1e-3);

pub fn chapter() -> Chapter {
    let mut situations = vec![
        views("Views are JPEG files of the best quality.", "jpg", |v| jpeg(v, 1)).right(JPEG),
        views("Views are BMP files.", "bmp", |v| saved(v.clone(), image::ImageFormat::Bmp)).right(EXACT),
        views("Views are PPM files.", "ppm", |v| saved(v.clone(), image::ImageFormat::Pnm)).right(EXACT),
        views("Views are TIFF files of 8 bits.", "tif", |v| tiff_of([3, 8, 1], v.as_raw())).right(EXACT),
        views("Views are PNG files of 16 bits, made from 8 bits.", "png", |v| png(words(v, |v| u16::from(v) * 257)))
            .right(EXACT),
        views("Views are TIFF files of floats, which are linear light.", "tiff", |v| {
            tiff_of([3, 32, 3], &v.as_raw().iter().flat_map(|v| light(*v).to_le_bytes()).collect::<Vec<_>>())
        })
        .right(EXACT),
        views("Views are EXR files of a renderer.", "exr", |v| exr_of(v, light)).right(EXACT),
        views("EXR views have the primaries of BT.2020, and state them.", "exr", |v| exr_of_primaries(v, WIDE))
            .right(EXACT),
        views("EXR views are in ACES2065-1, and state it.", "exr", |v| exr_of_primaries(v, ACES)).right(EXACT),
        views("PNG views of linear light have the primaries of BT.2020 in `cICP`.", "png", |v| {
            with_chunk(&words_of_primaries(v, WIDE.1), b"cICP", &[9, 8, 0, 1])
        })
        .right(LINEAR),
        views("PNG views of linear light have the primaries of BT.2020 in `cHRM`.", "png", |v| {
            let stated = with_chunk(&words_of_primaries(v, WIDE.1), b"gAMA", &100_000u32.to_be_bytes());
            with_chunk(&stated, b"cHRM", &chrm(WIDE.0))
        })
        .right(LINEAR),
        views("Views are PNG files with an opaque alpha channel.", "png", |v| {
            let opaque: RgbaImage = v.convert();
            png(opaque)
        })
        .right(EXACT),
        views("Views are PNG files with the gamma value 0.45455 of old programs.", "png", |v| {
            with_chunk(&png(v.clone()), b"gAMA", &45455u32.to_be_bytes())
        })
        .right(EXACT),
        views("Views are PNG files of linear light, and a gamma of 1 states it.", "png", |v| {
            let linear = words(v, |v| (light(v) * 65535.0).round() as u16);
            with_chunk(&png(linear), b"gAMA", &100_000u32.to_be_bytes())
        })
        .right(Judge::Like(&VIEWS, 1e-4)),
        views("A phone took the views upright and stores them sideways, with an EXIF orientation.", "jpg", |v| {
            jpeg(&image::imageops::rotate270(v), 6)
        })
        .right(JPEG),
        views("EXR views have values slightly below zero, as denoisers leave them.", "exr", |v| {
            exr_of(v, |v| if light(v) < 0.002 { -1e-6 } else { light(v) })
        })
        .right(Judge::Like(&VIEWS, 1e-3)),
        views("PNG files have the ending .jpg.", "jpg", |v| png(v.clone())).right(EXACT),
        views("Names end in .png, and the files are JPEG.", "png", |v| jpeg(v, 1)).right(JPEG),
    ];
    situations.extend(refused());
    Chapter { title: "Formats and values of views", about: "The same views in other formats.", situations }
}

fn refused() -> Vec<Situation> {
    vec![
        views("A camera of 10 bits stores its values in PNG files of 16 bits.", "png", |v| png(of_white(v, 1023.0)))
            .refused("scene/full-scale 10", Remedy::State("views/lightfield.toml", "full_scale = 1023"), ROUNDED),
        views("A camera of 12 bits stores its values in PNG files of 16 bits.", "png", |v| png(of_white(v, 4095.0)))
            .refused("scene/full-scale 12", Remedy::State("views/lightfield.toml", "full_scale = 4095"), ROUNDED),
        views("A camera of 14 bits stores its values in TIFF files of 16 bits.", "tif", |v| {
            tiff_of([3, 16, 1], &of_white(v, 16383.0).iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<_>>())
        })
        .refused("scene/full-scale 14", Remedy::State("views/lightfield.toml", "full_scale = 16383"), ROUNDED),
        views("EXR views hold 0 to 255 instead of 0 to 1.", "exr", |v| exr_of(v, |v| 255.0 * light(v))).refused(
            "scene/full-scale",
            Remedy::State("views/lightfield.toml", "full_scale = 255"),
            Judge::Like(&VIEWS, 1e-5),
        ),
        views("Views are transparent everywhere.", "png", |v| {
            png(ImageBuffer::from_fn(v.width(), v.height(), |x, y| {
                let [r, g, b] = v.get_pixel(x, y).0;
                Rgba([r, g, b, 0])
            }))
        })
        .refused(
            "scene/transparent",
            mended("without its alpha channel", |at| written(&at.join("views"), "png", |v| png(v.clone()))),
            EXACT,
        ),
        views("One pixel of an EXR view is NaN.", "exr", |v| exr_of(v, |v| if v == 77 { f32::NAN } else { light(v) }))
            .refused(
                "scene/value",
                mended("finite", |at| written(&at.join("views"), "exr", |v| exr_of(v, light))),
                EXACT,
            ),
        views("EXR views have values far below zero.", "exr", |v| exr_of(v, |v| if v == 77 { -0.5 } else { light(v) }))
            .refused(
                "scene/value -0.5",
                mended("not negative", |at| written(&at.join("views"), "exr", |v| exr_of(v, light))),
                EXACT,
            ),
        views("Views are PNG files with a gamma of 1.8.", "png", |v| {
            with_chunk(&png(v.clone()), b"gAMA", &55556u32.to_be_bytes())
        })
        .refused(
            "scene/transfer/gamma",
            mended("convert it to sRGB", |at| written(&at.join("views"), "png", |v| png(v.clone()))),
            EXACT,
        ),
        views("EXR views state primaries that enclose no colors.", "exr", |v| {
            exr_of_primaries(
                v,
                ([0.2, 0.2, 0.3, 0.3, 0.4, 0.4, 0.3127, 0.3290], [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]),
            )
        })
        .refused(
            "scene/transfer/primaries",
            change("lightfield.toml", |at| file(&at.join("views/lightfield.toml"), "transfer = \"linear\"\n")),
            EXACT,
        ),
        views("PNG views state color primaries with an undefined code.", "png", |v| {
            with_chunk(&png(v.clone()), b"cICP", &[77, 13, 0, 1])
        })
        .refused(
            "scene/transfer/primaries 77",
            mended("convert it to sRGB", |at| written(&at.join("views"), "png", |v| png(v.clone()))),
            EXACT,
        ),
        views("Views are HDR pictures with the PQ curve.", "png", |v| {
            with_chunk(&png(v.clone()), b"cICP", &[9, 16, 0, 1])
        })
        .refused(
            "scene/transfer/pq",
            mended("convert it to sRGB", |at| written(&at.join("views"), "png", |v| png(v.clone()))),
            EXACT,
        ),
        views("Views are WebP files.", "webp", |_| b"RIFF\x20\0\0\0WEBPVP8 ".to_vec()).refused(
            "scene/kind",
            change("-format views/*.webp", |at| written(&at.join("views"), "png", |v| png(v.clone()))),
            EXACT,
        ),
        views("Views are raw pictures of a camera.", "dng", |_| b"II*\0\x08\0\0\0".to_vec()).refused(
            "scene/kind",
            change("darktable-cli", |at| {
                written(&at.join("views"), "tif", |v| tiff_of([3, 8, 1], v.as_raw()));
            }),
            EXACT,
        ),
    ]
}
