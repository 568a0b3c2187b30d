//! Situations with a picture and its depth map.

use crate::common::made::tiff;
use crate::frame::{Case, Chapter, Remedy, Situation, case, change, convert, mended};
use crate::judge::{Canon, Judge};
use crate::made::{SIZE, view};
use crate::write::{exr, file, jpeg, npy, pfm, png};
use image::{GrayImage, ImageBuffer, Luma, Rgb, RgbImage, Rgba, imageops};
use std::path::Path;
use std::sync::LazyLock;

const H: usize = SIZE[0];
const W: usize = SIZE[1];

/// Returns the nearness of each pixel, from 20 to 240. A disc and a bar are in front of a floor that comes nearer
/// towards the bottom.
pub fn codes() -> Vec<u8> {
    let one = |i: usize| {
        let (x, y) = ((i % W) as f32, (i / W) as f32);
        match () {
            () if (x - 23.0).hypot(y - 21.0) < 12.0 => 240,
            () if (x - 47.0).abs() < 8.0 && (y - 33.0).abs() < 7.0 => 160,
            () => 20 + (i / W) as u8,
        }
    };
    (0..H * W).map(one).collect()
}

/// Returns whether a pixel is in the part of the floor next to the disc that a depth camera cannot measure.
fn is_hole(i: usize) -> bool {
    (37..41).contains(&(i % W)) && (12..20).contains(&(i / W))
}

pub fn photo() -> RgbImage {
    static PHOTO: LazyLock<RgbImage> = LazyLock::new(|| view([0.0, 0.0]));
    PHOTO.clone()
}

/// Words at the end of the command, which state the depths of the map.
const STATED: &str = "--depth=-1..1 --views 5";

/// Returns a value for each pixel, which `of` makes from the nearness and the index of the pixel.
fn map<T>(of: impl Fn(u8, usize) -> T) -> Vec<T> {
    codes().into_iter().enumerate().map(|(i, v)| of(v, i)).collect()
}

fn floats(values: &[f32]) -> Vec<u8> {
    npy("<f4", false, &SIZE, &values.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<_>>())
}

fn canon(at: &Path, values: &[f32]) -> String {
    file(&at.join("photo.png"), png(photo()));
    file(&at.join("map.npy"), floats(values));
    // With `dark`, every stored value counts.
    format!("photo.png --depth-map map.npy --near dark {STATED}")
}

fn distance(code: u8) -> f32 {
    1000.0 - 3.0 * f32::from(code)
}

pub static DEPTHS: Canon = Canon::new(
    |at| canon(at, &map(|v, _| distance(v))),
    &[
        ("inside out", |at| canon(at, &map(|v, _| f32::from(v)))),
        ("upside down", |at| {
            canon(at, &map(|v, _| distance(v)).chunks(W).rev().flatten().copied().collect::<Vec<_>>())
        }),
        ("mirrored", |at| {
            canon(at, &map(|v, _| distance(v)).chunks(W).flat_map(|r| r.iter().rev().copied()).collect::<Vec<_>>())
        }),
        ("with holes that are near", |at| canon(at, &map(|v, i| if is_hole(i) { 280.0 } else { distance(v) }))),
        ("with holes at zero", |at| canon(at, &map(|v, i| if is_hole(i) { 0.0 } else { distance(v) }))),
        ("with holes at 65535", |at| canon(at, &map(|v, i| if is_hole(i) { 65535.0 } else { distance(v) }))),
        ("flat", |at| canon(at, &map(|_, _| 500.0))),
        ("by 1 / distance", |at| canon(at, &map(|v, _| -1e5 / distance(v)))),
    ],
);

const EXACT: Judge = Judge::Like(&DEPTHS, 1e-4);

fn of_words(value: impl Fn(u8, usize) -> u16) -> Vec<u8> {
    let values = map(value);
    png(ImageBuffer::from_fn(W as u32, H as u32, |x, y| Luma([values[y as usize * W + x as usize]])))
}

fn of_bytes(value: impl Fn(u8, usize) -> u8) -> GrayImage {
    GrayImage::from_raw(W as u32, H as u32, map(value)).expect("all pixels")
}

fn tiff_of(bits_format: [u16; 2], bytes: &[u8]) -> Vec<u8> {
    let temp = crate::common::folder();
    let path = temp.path().join("a.tif");
    tiff(&path, SIZE.map(|n| n as u32), [1, bits_format[0], bits_format[1]], bytes);
    std::fs::read(path).expect("a TIFF")
}

/// A situation with `photo.png` and a map. The words `more` follow both in the command.
fn with(have: &str, name: &'static str, more: &str, bytes: impl Fn() -> Vec<u8> + Send + Sync + 'static) -> Case {
    let words = format!("render photo.png --depth-map {name}{more} {STATED}");
    case(have, words, move |at| {
        file(&at.join("photo.png"), png(photo()));
        file(&at.join(name), bytes());
    })
}

/// Returns the disparity of neighboring views [pixels]. The range of all codes is -1 to 1 mm with 5 views on the usual
/// display.
fn disparity(code: u8) -> f32 {
    (f32::from(code) - 130.0) / 110.0 * 1.375
}

pub fn chapter() -> Chapter {
    let mut situations = vec![
        with("The map has 8 bits, as from MiDaS, Depth Anything or a phone's portrait.", "depth.png", "", || {
            png(of_bytes(|v, _| v))
        })
        .right(EXACT),
        with("The map of 8 bits is an RGB picture with three equal channels.", "depth.png", "", || {
            png(image::DynamicImage::from(of_bytes(|v, _| v)).to_rgb8())
        })
        .right(EXACT),
        with("The map of 8 bits has an alpha channel.", "depth.png", "", || {
            png(image::DynamicImage::from(of_bytes(|v, _| v)).to_rgba8())
        })
        .right(EXACT),
        with("The map is a JPEG file.", "depth.jpg", "", || {
            jpeg(&image::DynamicImage::from(of_bytes(|v, _| v)).to_rgb8(), 1)
        })
        .right(Judge::Like(&DEPTHS, 0.01)),
        with("The map of 8 bits is dark where it is near.", "depth.png", " --near dark", || {
            png(of_bytes(|v, _| 255 - v))
        })
        .right(EXACT),
        with(
            "Distances of TUM RGB-D, 5000 per meter, have zeros where nothing was measured.",
            "depth.png",
            " --near small",
            || of_words(|v, i| if is_hole(i) { 0 } else { 40000 - 100 * u16::from(v) }),
        )
        .right(EXACT),
        with(
            "Distances of a RealSense camera have 65535 where nothing was measured.",
            "depth.png",
            " --near small",
            || of_words(|v, i| if is_hole(i) { 65535 } else { 4000 - 10 * u16::from(v) }),
        )
        .right(EXACT),
        with("Distances of a Kinect in millimeters are an array of 16 bits.", "kinect_depth.npy", "", || {
            npy(
                "<u2",
                false,
                &SIZE,
                &map(|v, i| if is_hole(i) { 0 } else { 2000 - 5 * u16::from(v) })
                    .iter()
                    .flat_map(|v| v.to_le_bytes())
                    .collect::<Vec<_>>(),
            )
        })
        .right(EXACT),
        with("Distances of a network are an array of shape (1, 48, 64).", "depth.npy", "", || {
            npy("<f4", false, &[1, H, W], &map(|v, _| distance(v).to_le_bytes()).concat())
        })
        .right(EXACT),
        with("Distances in meters have NaN where nothing was measured.", "depth.npy", "", || {
            floats(&map(|v, i| if is_hole(i) { f32::NAN } else { distance(v) / 1000.0 }))
        })
        .right(EXACT),
    ];
    situations.extend(read());
    situations.extend(ambiguous());
    situations.extend(refused());
    situations.extend(refused_files());
    Chapter {
        title: "Pictures with a depth map",
        about: "One picture, and a map of its distances, disparities or nearness.",
        situations,
    }
}

/// Returns situations with maps whose names or commands state the meaning of their values.
fn read() -> Vec<Situation> {
    vec![
        with("Disparities of Middlebury are a PFM file with infinity at unknown pixels.", "disp0.pfm", "", || {
            pfm(SIZE, &map(|v, i| if is_hole(i) { f32::INFINITY } else { 10.0 + f32::from(v) / 4.0 }), false)
        })
        .right(EXACT),
        with("Disparities are a big-endian PFM file.", "disp1.pfm", "", || {
            pfm(SIZE, &map(|v, _| 10.0 + f32::from(v) / 4.0), true)
        })
        .right(EXACT),
        case(
            "Disparities are pixels between neighboring views, and no depths are stated.",
            "render photo.png --depth-map disp.pfm --views 5",
            |at| {
                file(&at.join("photo.png"), png(photo()));
                file(&at.join("disp.pfm"), pfm(SIZE, &map(|v, _| disparity(v)), false));
            },
        )
        .right(EXACT),
        with("The depth pass of Blender is an EXR file with 1e10 for the sky.", "depth.exr", "", || {
            exr(SIZE, &[("Z", map(|v, i| if is_hole(i) { 1e10 } else { distance(v) }))])
        })
        .right(EXACT),
        case(
            "Blender's colors and depth are channels of one EXR file.",
            format!("render render_depth.exr --depth-map render_depth.exr {STATED}"),
            |at| {
                let plane = |c: usize| photo().pixels().map(|p| crate::made::light(p.0[c])).collect::<Vec<f32>>();
                file(
                    &at.join("render_depth.exr"),
                    exr(SIZE, &[("B", plane(2)), ("G", plane(1)), ("R", plane(0)), ("Z", map(|v, _| distance(v)))]),
                );
            },
        )
        .right(EXACT),
        with("Distances are a TIFF file of floats.", "distance.tif", "", || {
            tiff_of([32, 3], &map(|v, _| distance(v).to_le_bytes()).concat())
        })
        .right(EXACT),
        with(
            "Distances are a TIFF file of 16 bits, and the command states which are near.",
            "depth.tif",
            " --near small",
            || tiff_of([16, 1], &map(|v, _| (distance(v) as u16).to_le_bytes()).concat()),
        )
        .right(EXACT),
        with("A map of Marigold has 16 bits and is dark where it is near.", "marigold.png", " --near dark", || {
            of_words(|v, _| 65535 - 257 * u16::from(v))
        })
        .right(EXACT),
        case(
            "A phone stores its picture sideways, and its map is upright.",
            format!("render photo.jpg --depth-map depth.png {STATED}"),
            |at| {
                file(&at.join("photo.jpg"), jpeg(&imageops::rotate270(&photo()), 6));
                file(&at.join("depth.png"), png(of_bytes(|v, _| v)));
            },
        )
        .right(Judge::Like(&DEPTHS, 0.015)),
        case(
            "The nearer end of the depths comes first.",
            "render photo.png --depth-map depth.png --views 5 --depth=1..-1",
            |at| {
                file(&at.join("photo.png"), png(photo()));
                file(&at.join("depth.png"), png(of_bytes(|v, _| 255 - v)));
            },
        )
        .right(EXACT),
        with("A network's map of 8 bits is an array with the name depth.", "depth.npy", "", || {
            npy("|u1", false, &SIZE, &codes())
        })
        .refused("scene/ambiguous/values", Remedy::Add("--near bright"), EXACT),
        with("Disparities of Middlebury 2003 have 8 bits and zeros at unknown pixels.", "disp2.png", "", || {
            png(of_bytes(|v, i| if is_hole(i) { 0 } else { v }))
        })
        .right(EXACT),
    ]
}

/// Returns situations with maps that do not show which values are near.
fn ambiguous() -> Vec<Situation> {
    let asks = "scene/ambiguous/values";
    vec![
        with("Distances of TUM RGB-D do not show which values are near.", "depth.png", "", || {
            of_words(|v, i| if is_hole(i) { 0 } else { 40000 - 100 * u16::from(v) })
        })
        .refused(asks, Remedy::Add("--near small"), EXACT),
        with(
            "Distances of RGBD Scenes, 10000 per meter, do not show which values are near.",
            "1_depth.png",
            "",
            || of_words(|v, i| if is_hole(i) { 0 } else { 60000 - 200 * u16::from(v) }),
        )
        .refused(asks, Remedy::Add("--near small"), EXACT),
        with("Distances of ZoeDepth, 256 per meter, do not show which values are near.", "zoe.png", "", || {
            of_words(|v, _| 3000 - 10 * u16::from(v))
        })
        .refused(asks, Remedy::Add("--near small"), EXACT),
        with("Disparities of KITTI, 256 per pixel, do not show which values are near.", "000000_10.png", "", || {
            of_words(|v, i| if is_hole(i) { 0 } else { 3000 + 64 * u16::from(v) })
        })
        .refused(asks, Remedy::Add("--near large"), EXACT),
        with("A map of MiDaS has 16 bits.", "midas.png", "", || of_words(|v, _| 257 * u16::from(v))).refused(
            asks,
            Remedy::Add("--near bright"),
            EXACT,
        ),
        with("An array with another name has distances.", "scan.npy", "", || floats(&map(|v, _| distance(v)))).refused(
            asks,
            Remedy::Add("--near small"),
            EXACT,
        ),
        with("The name of an array shows that it has inverse depths.", "inv_depth.npy", "", || {
            floats(&map(|v, _| f32::from(v)))
        })
        .refused(asks, Remedy::Add("--near large"), EXACT),
        with("An array with the name depth is normalized to 0 to 1, and near is 1.", "depth.npy", "", || {
            floats(&map(|v, _| (f32::from(v) - 20.0) / 220.0))
        })
        .refused("scene/ambiguous/normalized-distances", Remedy::Add("--near bright"), EXACT),
        with("Depths of OpenGL are negative in front of the camera.", "z.npy", "", || {
            floats(&map(|v, _| -distance(v)))
        })
        .refused("scene/ambiguous/negative-distances", Remedy::Add("--near large"), EXACT),
        with("The command states that near disparities are small.", "disp.npy", " --near small", || {
            floats(&map(|v, _| f32::from(v)))
        })
        .refused("scene/ambiguous/disparities", Remedy::As("large", "--near small", "--near large"), EXACT),
    ]
}

fn refused() -> Vec<Situation> {
    let right = |name: &'static str| move |at: &Path| file(&at.join(name), png(of_bytes(|v, _| v)));
    vec![
        case("A picture has no depth map.", format!("render photo.png {STATED}"), |at| {
            file(&at.join("photo.png"), png(photo()));
            file(&at.join("depth.png"), png(of_bytes(|v, _| v)));
        })
        .refused(
            "scene/no-depth-map",
            Remedy::As("--depth-map", "photo.png", "photo.png --depth-map depth.png"),
            EXACT,
        ),
        case("A folder has pictures with their maps.", format!("render shots --depth-map shots {STATED}"), |at| {
            for i in 0..3 {
                file(&at.join(format!("shots/shot-{i}.png")), png(photo()));
                file(&at.join(format!("shots/shot_depth-{i}.png")), png(of_bytes(|v, _| v)));
            }
        })
        .refused(
            "scene/request",
            Remedy::By("one picture of it", "render shots", "render shots/shot-1.png"),
            EXACT,
        ),
        with("The map has half of the picture's size.", "depth.png", "", || {
            png(imageops::resize(&of_bytes(|v, _| v), 32, 24, imageops::FilterType::Nearest))
        })
        .refused("scene/size 24 32 photo.png 48 64", mended("give both one size", right("depth.png")), EXACT),
        with("The map has rows and columns exchanged.", "depth.png", "", || {
            png(imageops::rotate90(&of_bytes(|v, _| v)))
        })
        .refused(
            "scene/size 64 48 photo.png",
            mended("exchange its rows and columns", right("depth.png")),
            EXACT,
        ),
        case(
            "A phone's picture is turned by its EXIF orientation, and the map is not.",
            format!("render photo.jpg --depth-map depth.png {STATED}"),
            |at| {
                file(&at.join("photo.jpg"), jpeg(&imageops::rotate270(&photo()), 6));
                file(&at.join("depth.png"), png(imageops::rotate270(&of_bytes(|v, _| v))));
            },
        )
        .refused(
            "scene/turned",
            mended("turn the map likewise", right("depth.png")),
            Judge::Like(&DEPTHS, 0.015),
        ),
        with("The map is in false colors.", "depth.png", "", || {
            let codes = codes();
            png(RgbImage::from_fn(W as u32, H as u32, |x, y| {
                let v = codes[y as usize * W + x as usize];
                Rgb([v, 255 - v.abs_diff(128) * 2, 255 - v])
            }))
        })
        .refused("scene/corrupt/map-colors", mended("gray picture", right("depth.png")), EXACT),
        with("A sparse map of KITTI has no value in most pixels.", "depth.png", " --near small", || {
            of_words(|v, i| if i % 3 == 0 { 20000 - 64 * u16::from(v) } else { 0 })
        })
        .refused(
            "scene/corrupt/map-holes",
            mended("complete the map", |at| {
                file(&at.join("depth.png"), of_words(|v, _| 20000 - 64 * u16::from(v)));
            }),
            EXACT,
        ),
    ]
}

/// Returns situations with maps in files of other kinds, and with files of more than one map.
fn refused_files() -> Vec<Situation> {
    vec![
        with("The map is a table of comma-separated values.", "depth.csv", "", || {
            codes()
                .chunks(W)
                .map(|row| row.iter().map(|v| distance(*v).to_string()).collect::<Vec<_>>().join(",") + "\n")
                .collect::<String>()
                .into_bytes()
        })
        .refused(
            "scene/kind",
            convert("depth.csv depth.npy", "depth.csv", "depth.npy", |at| {
                file(&at.join("depth.npy"), floats(&map(|v, _| distance(v))));
            }),
            EXACT,
        ),
        with("The map is a file of MATLAB.", "depth.mat", "", || b"MATLAB 5.0 MAT-file, Platform: GLNXA64".to_vec())
            .refused(
                "scene/kind",
                convert("depth.mat depth.npy", "depth.mat", "depth.npy", |at| {
                    file(&at.join("depth.npy"), floats(&map(|v, _| distance(v))))
                }),
                EXACT,
            ),
        with("A portrait of an iPhone is a HEIC file.", "portrait.heic", "", || {
            b"\0\0\0\x18ftypheic\0\0\0\0heic".to_vec()
        })
        .refused(
            "scene/kind",
            convert("magick portrait.heic portrait.png", "portrait.heic", "portrait.png", |at| {
                file(&at.join("portrait.png"), png(of_bytes(|v, _| v)));
            }),
            EXACT,
        ),
        with("The map is an array of several maps.", "depth.npy", "", || {
            npy(
                "<f4",
                false,
                &[2, H, W],
                &[map(|v, _| distance(v).to_le_bytes()).concat(), map(|v, _| distance(v).to_le_bytes()).concat()]
                    .concat(),
            )
        })
        .refused(
            "scene/corrupt/map-shape",
            change("maps[0]", |at| file(&at.join("depth.npy"), floats(&map(|v, _| distance(v))))),
            EXACT,
        ),
        case("The name of the map is misspelled.", format!("render photo.png --depth-map depht.png {STATED}"), |at| {
            file(&at.join("photo.png"), png(photo()));
            file(&at.join("depth.png"), png(of_bytes(|v, _| v)));
        })
        .refused("scene/not-found depht.png", Remedy::Replace("depht.png", "depth.png"), EXACT),
        case(
            "An EXR picture has two layers of depth.",
            format!("render photo.png --depth-map depth.exr {STATED}"),
            |at| {
                file(&at.join("photo.png"), png(photo()));
                let values = map(|v, _| distance(v));
                file(&at.join("depth.exr"), exr(SIZE, &[("left.Z", values.clone()), ("right.Z", values)]));
            },
        )
        .refused(
            "scene/corrupt/several-depths left.Z",
            change("right.Z", |at| file(&at.join("depth.exr"), exr(SIZE, &[("Z", map(|v, _| distance(v)))]))),
            EXACT,
        ),
        case(
            "The picture is transparent everywhere, as some programs save color and depth.",
            format!("render photo.png --depth-map depth.png {STATED}"),
            |at| {
                let photo = photo();
                let clear = |p: &Rgb<u8>| Rgba([p.0[0], p.0[1], p.0[2], 0]);
                file(
                    &at.join("photo.png"),
                    png(ImageBuffer::from_fn(W as u32, H as u32, |x, y| clear(photo.get_pixel(x, y)))),
                );
                file(&at.join("depth.png"), png(of_bytes(|v, _| v)));
            },
        )
        .refused(
            "scene/transparent",
            mended("without its alpha channel", |at| file(&at.join("photo.png"), png(photo()))),
            EXACT,
        ),
    ]
}
