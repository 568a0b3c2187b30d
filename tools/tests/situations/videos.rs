//! Situations with videos, and with files that are no scene.

use crate::depths::{codes, photo};
use crate::frame::{Case, Chapter, Remedy, Situation, case, change, convert, mended};
use crate::ground::Ground;
use crate::judge::{Canon, Judge};
use crate::made::{EXACT, GRID, SIZE, save};
use crate::write::{file, npy, png, y4m, zip};
use image::{GrayImage, Rgb, RgbImage};
use std::path::Path;

const STATED: &str = "--depth-map depth.png --depth=-1..1 --views 5";
const BT601: [f64; 2] = [0.299, 0.114];
const BT709: [f64; 2] = [0.2126, 0.0722];

fn depth() -> GrayImage {
    GrayImage::from_raw(SIZE[1] as u32, SIZE[0] as u32, codes()).expect("all pixels")
}

/// Returns the picture of the clip, without colors that a video cannot store.
fn picture() -> RgbImage {
    let mut picture = photo();
    picture.pixels_mut().for_each(|p| p.0 = p.0.map(|v| 40 + (u16::from(v) * 2 / 3) as u8));
    picture
}

fn canon(at: &Path, picture: &RgbImage) -> String {
    file(&at.join("photo.png"), png(picture.clone()));
    file(&at.join("depth.png"), png(depth()));
    format!("photo.png {STATED}")
}

/// Returns the picture after coding by one matrix and decoding by the other.
fn exchanged([[red, blue], [of_red, of_blue]]: [[f64; 2]; 2]) -> RgbImage {
    let mut picture = picture();
    for p in picture.pixels_mut() {
        let [r, g, b] = p.0.map(f64::from);
        let luma = red * r + blue * b + (1.0 - red - blue) * g;
        let [cb, cr] = [(b - luma) / (1.0 - blue), (r - luma) / (1.0 - red)];
        let [r, b] = [luma + (1.0 - of_red) * cr, luma + (1.0 - of_blue) * cb];
        let g = (luma - of_red * r - of_blue * b) / (1.0 - of_red - of_blue);
        *p = Rgb([r, g, b].map(|v| v.round().clamp(0.0, 255.0) as u8));
    }
    picture
}

fn stretched(picture: &RgbImage, by: impl Fn(f32) -> f32) -> RgbImage {
    let mut picture = picture.clone();
    picture.pixels_mut().for_each(|p| p.0 = p.0.map(|v| by(f32::from(v)).clamp(0.0, 255.0) as u8));
    picture
}

static CLIP: Canon = Canon::new(
    |at| canon(at, &picture()),
    &[
        ("by BT.709 instead of BT.601", |at| canon(at, &exchanged([BT601, BT709]))),
        ("by BT.601 instead of BT.709", |at| canon(at, &exchanged([BT709, BT601]))),
        ("of full range taken as limited", |at| canon(at, &stretched(&picture(), |v| (v - 16.0) * 255.0 / 219.0))),
        ("of limited range taken as full", |at| canon(at, &stretched(&picture(), |v| 16.0 + v * 219.0 / 255.0))),
        ("upside down", |at| canon(at, &image::imageops::flip_vertical(&picture()))),
    ],
);

/// Allows the rounding of samples to 8 bits or more.
const RIGHT: Judge = Judge::Like(&CLIP, 0.005);

/// A situation with a clip of one frame and its depth map as a picture.
fn clip(have: &str, scene: &str, words: &'static str, bits: u32, full: bool, matrix: [f64; 2]) -> Case {
    case(have, format!("render {scene} {STATED}"), move |at| {
        file(&at.join("clip.y4m"), y4m(&picture(), words, bits, full, matrix));
        file(&at.join("depth.png"), png(depth()));
    })
}

fn again(at: &Path) {
    file(&at.join("clip.y4m"), y4m(&picture(), "C444", 8, false, BT601));
}

pub fn chapter() -> Chapter {
    let situations = vec![
        clip(
            "A video by BT.601 does not state its matrix, as is usual in the format.",
            "clip.y4m",
            "Ip A1:1 C444",
            8,
            false,
            BT601,
        )
        .right(RIGHT),
        clip(
            "A video of high definition is scaled down, and the command states its matrix.",
            "clip.y4m?matrix=bt709",
            "C444",
            8,
            false,
            BT709,
        )
        .right(RIGHT),
        clip("A video states its matrix by itself.", "clip.y4m", "C444 XCOLORMATRIX=BT709", 8, false, BT709)
            .right(RIGHT),
        clip("A video has full-range values and states it.", "clip.y4m", "C444 XCOLORRANGE=FULL", 8, true, BT601)
            .right(RIGHT),
        clip("A video has 10 bits.", "clip.y4m", "C444p10", 10, false, BT601).right(RIGHT),
        clip("The command requests the first frame of a video.", "clip.y4m?frame=0", "C444", 8, false, BT601)
            .right(RIGHT),
        clip(
            "ffmpeg made the video of a clip of high definition.",
            "clip.y4m",
            "Ip A1:1 C444 XYSCSS=444",
            8,
            false,
            BT709,
        )
        .refused("scene/matrix", Remedy::Replace("clip.y4m", "clip.y4m?matrix=bt709"), RIGHT),
        clip("A video is interlaced.", "clip.y4m", "It C444", 8, false, BT601).refused(
            "scene/corrupt/interlaced",
            change("-vf", again),
            RIGHT,
        ),
        clip("Pixels of a video are not square.", "clip.y4m", "A16:15 C444", 8, false, BT601).refused(
            "scene/corrupt/pixel-aspect 16:15",
            change("scale=iw*sar:ih", again),
            RIGHT,
        ),
        clip(
            "The command states a matrix that eyebox does not read.",
            "clip.y4m?matrix=bt2020",
            "C444",
            8,
            false,
            BT601,
        )
        .refused(
            "scene/options/option-of-another bt2020",
            Remedy::As("matrix=bt601", "bt2020", "bt601"),
            RIGHT,
        ),
        clip("The command requests a frame that a video does not have.", "clip.y4m?frame=1", "C444", 8, false, BT601)
            .refused("scene/corrupt/no-such-frame", Remedy::By("from 0 on", "frame=1", "frame=0"), RIGHT),
        case("A video is cut off.", format!("render clip.y4m {STATED}"), |at| {
            file(&at.join("clip.y4m"), &y4m(&picture(), "C444", 8, false, BT601)[..5000]);
            file(&at.join("depth.png"), png(depth()));
        })
        .refused("scene/corrupt/frame-cut-short", mended("copy it again", again), RIGHT),
        case("A video is an MP4 file, and ffmpeg is missing.", format!("render clip.mp4 {STATED}"), |at| {
            file(&at.join("clip.mp4"), b"\0\0\0\x18ftypisom");
            file(&at.join("depth.png"), png(depth()));
        })
        .refused(
            "scene/kind MP4",
            convert("ffmpeg -i clip.mp4", "clip.mp4", "clip.y4m?matrix=bt709", |at| {
                file(&at.join("clip.y4m"), y4m(&picture(), "C444", 8, false, BT709));
            }),
            RIGHT,
        )
        .on(Ground::Bare),
    ];
    Chapter { title: "Videos", about: "One frame of a video in the format YUV4MPEG2, with a depth map.", situations }
}

/// Situations with files that are no scene, or that must first be converted to one.
pub mod others {
    use super::*;

    fn array() -> Vec<u8> {
        let codes: Vec<u8> = crate::made::all().into_iter().flat_map(RgbImage::into_raw).collect();
        npy("|u1", false, &[GRID[0], GRID[1], SIZE[0], SIZE[1], 3], &codes)
    }

    fn usual(at: &Path) {
        save(&at.join("views"), |r, c| format!("view_{r}_{c}.png"));
    }

    /// A situation with a file that the user must convert to an array of the views.
    fn to_array(
        have: &str,
        name: &'static str,
        bytes: &'static [u8],
        cause: &'static str,
        line: &'static str,
    ) -> Situation {
        case(have, format!("render {name}"), move |at| file(&at.join(name), bytes)).refused(
            cause,
            convert(line, name, "lf.npy", |at| file(&at.join("lf.npy"), array())),
            EXACT,
        )
    }

    static PLANE: Canon = Canon::new(|_| "builtin:plane".into(), &[("another scene", |_| "builtin:still-life".into())]);
    const OF_PLANE: Judge = Judge::Like(&PLANE, 2e-6);

    pub fn chapter() -> Chapter {
        let situations = vec![
            to_array(
                "The light field is a file of MATLAB.",
                "lf.mat",
                b"MATLAB 5.0 MAT-file, Platform: GLNXA64",
                "scene/kind",
                "lf.mat lf.npy",
            ),
            to_array(
                "The light field is a file of MATLAB 7.3.",
                "lf.mat",
                b"MATLAB 7.3 MAT-file, Platform: GLNXA64",
                "scene/kind 7.3",
                "lf.mat lf.npy",
            ),
            to_array(
                "The light field is an HDF5 file.",
                "lf.h5",
                b"\x89HDF\r\n\x1a\n",
                "scene/kind HDF5",
                "lf.h5 lf.npy",
            ),
            to_array("The light field is a pickle.", "lf.pkl", b"\x80\x04\x95", "scene/kind", "lf.pkl lf.npy"),
            case("The views are in a ZIP archive.", "render views.zip", |at| {
                let views = crate::made::all().into_iter().map(png);
                let names: Vec<String> = (0..15).map(|i| format!("view_{}_{}.png", i / 5, i % 5)).collect();
                let entries: Vec<_> = names.iter().map(String::as_str).zip(views).collect();
                file(&at.join("views.zip"), zip(&entries));
            })
            .refused(
                "scene/kind",
                convert("python -m zipfile -e views.zip views", "views.zip", "views", usual),
                EXACT,
            ),
            case("The views are in an archive of tar and gzip.", "render views.tar.gz", |at| {
                file(&at.join("views.tar.gz"), b"\x1f\x8b\x08")
            })
            .refused("scene/kind", convert("unpack it", "views.tar.gz", "views", usual), EXACT),
            case("Each view is an array in a folder.", "render views", |at| {
                for (i, view) in crate::made::all().iter().enumerate() {
                    file(
                        &at.join(format!("views/v_{}_{}.npy", i / 5, i % 5)),
                        npy("|u1", false, &[48, 64, 3], view.as_raw()),
                    );
                }
            })
            .refused(
                "scene/kind",
                convert("views.npy?grid=ROWSxCOLUMNS", "views", "views.npy?grid=3x5", |at| {
                    file(&at.join("views.npy"), array())
                }),
                EXACT,
            ),
            case("The name of the folder is misspelled.", "render veiws", usual).refused(
                "scene/not-found",
                Remedy::Replace("veiws", "views"),
                EXACT,
            ),
            case("A folder has the light fields of several moments.", "render moments", |at| {
                save(&at.join("moments/t0"), |r, c| format!("view_{r}_{c}.png"));
                save(&at.join("moments/t1"), |r, c| format!("view_{c}_{r}.png"));
            })
            .refused("scene/deeper", Remedy::Replace("moments", "moments/t0"), EXACT),
            case("The scene is a text file.", "render plane", |at| file(&at.join("plane"), "a plane\n")).refused(
                "scene/kind",
                Remedy::As("builtin:NAME", "plane", "builtin:plane"),
                OF_PLANE,
            ),
            case("The scene is an empty file.", "render plane.png", |at| file(&at.join("plane.png"), "")).refused(
                "scene/kind",
                Remedy::As("builtin:NAME", "plane.png", "builtin:plane"),
                OF_PLANE,
            ),
            case("The name of a built-in scene is misspelled.", "render builtin:plain", |_| {}).refused(
                "scene/builtin/no-such-scene",
                Remedy::As("plane", "plain", "plane"),
                OF_PLANE,
            ),
            case("A built-in scene has no such setting.", "render builtin:plane?size=3", |_| {}).refused(
                "scene/builtin/parameter",
                Remedy::As("depth", "size=3", "depth=0"),
                OF_PLANE,
            ),
        ];
        Chapter {
            title: "Files that are no scene",
            about: "eyebox recognizes the kind of a file by its first bytes.",
            situations,
        }
    }
}
