//! Situations with phases of other programs.

use crate::common::done;
use crate::frame::{Case, Chapter, Outcome, Remedy, Situation, case, change, convert, mended};
use crate::judge::Judge;
use crate::write::{file, npy, png, zip};
use eyebox::low_level::files::{read_npy, write_npy};
use image::{ImageBuffer, Luma, Rgb};
use std::f32::consts::TAU;
use std::path::Path;

/// Numbers of sub-frames, rows and columns.
const SHAPE: [usize; 3] = [3, 24, 32];

/// Returns the phase of a pixel [radians].
fn phase([frame, row, column]: [usize; 3]) -> f32 {
    let [f, y, x] = [frame, row, column].map(|n| n as f32);
    let all = 0.7 * f + 0.31 * x + 0.17 * y + 0.01 * x * y;
    all - TAU * (all / TAU).round()
}

/// Returns all phases in the order of these axes.
fn phases([a, b, c]: [usize; 3]) -> Vec<f32> {
    let mut out = Vec::new();
    for i in 0..SHAPE[a] {
        for j in 0..SHAPE[b] {
            for k in 0..SHAPE[c] {
                let mut place = [0; 3];
                (place[a], place[b], place[c]) = (i, j, k);
                out.push(phase(place));
            }
        }
    }
    out
}

fn usual() -> Vec<f32> {
    phases([0, 1, 2])
}

/// Returns all phases in turns, from 0 to 1.
fn turns() -> Vec<f32> {
    usual().into_iter().map(|v| (v / TAU).rem_euclid(1.0)).collect()
}

/// Returns all phases in levels, with `count` levels per turn.
fn levels(count: u32) -> Vec<u32> {
    turns().into_iter().map(|v| (v * count as f32).round() as u32 % count).collect()
}

/// Checks that the hologram has the usual phases within an error [radians]. It may have only the first sub-frames.
fn has_phases(outcome: &Outcome, error: f32) -> Result<(), String> {
    done(outcome.folder, &["convert", "out.zarr", "back.npy"]);
    let found = read_npy(&outcome.folder.join("back.npy")).map_err(|e| e.to_string())?.values;
    let off = |(found, right): (&f32, &f32)| ((found - right + TAU / 2.0).rem_euclid(TAU) - TAU / 2.0).abs();
    let most = found.iter().zip(&usual()).map(off).fold(0.0, f32::max);
    let frames = found.len() / (SHAPE[1] * SHAPE[2]);
    match frames > 0 && found.len() % (SHAPE[1] * SHAPE[2]) == 0 && most <= error {
        true => Ok(()),
        false => Err(format!("{} phases are off by {most} radians", found.len())),
    }
}

const EXACT: Judge = Judge::By(|outcome| has_phases(outcome, 2e-5));
/// Allows half of a level at 256 levels per turn.
const EIGHT_BITS: Judge = Judge::By(|outcome| has_phases(outcome, 0.0125));

/// A situation that imports files for a small display.
fn import(have: &str, name: &'static str, files: impl Fn(&Path) + Send + Sync + 'static) -> Case {
    case(have, format!("convert {name} out.zarr --display small --size 24x32 --color green"), files)
}

fn floats(values: &[f32]) -> Vec<u8> {
    values.iter().flat_map(|v| v.to_le_bytes()).collect()
}

/// A situation with an array of this type and shape.
fn array(
    have: &str,
    descr: &'static str,
    shape: &'static [usize],
    bytes: impl Fn() -> Vec<u8> + Send + Sync + 'static,
) -> Case {
    import(have, "p.npy", move |at| file(&at.join("p.npy"), npy(descr, false, shape, &bytes())))
}

/// A situation with one picture per sub-frame.
fn pictures(have: &str, picture: impl Fn(usize) -> Vec<u8> + Send + Sync + 'static) -> Case {
    import(have, "slm", move |at| {
        (0..SHAPE[0]).for_each(|frame| file(&at.join(format!("slm/slm_{frame:02}.png")), picture(frame)));
    })
}

fn of_frame<T: Copy>(all: &[T], frame: usize) -> Vec<T> {
    let pixels = SHAPE[1] * SHAPE[2];
    all[frame * pixels..][..pixels].to_vec()
}

fn gray(frame: usize) -> Vec<u8> {
    let values = of_frame(&levels(256), frame).into_iter().map(|v| v as u8).collect();
    png(ImageBuffer::<Luma<u8>, _>::from_raw(32, 24, values).expect("a picture"))
}

/// Writes the usual array and replaces an existing file.
fn saved(at: &Path) {
    write_npy(&at.join("p.npy"), &SHAPE, &usual()).expect("an array");
}

pub fn chapter() -> Chapter {
    let mut situations = vec![
        array("Radians from -pi to pi as float32.", "<f4", &SHAPE, || floats(&usual())).right(EXACT),
        array("Radians from 0 to 2 pi as float64.", "<f8", &SHAPE, || {
            usual().iter().flat_map(|v| f64::from(v.rem_euclid(TAU)).to_le_bytes()).collect()
        })
        .right(EXACT),
        array("Radians as big-endian float32.", ">f4", &SHAPE, || {
            usual().iter().flat_map(|v| v.to_be_bytes()).collect()
        })
        .right(EXACT),
        import("Radians in MATLAB's order of axes, as numpy.asfortranarray saves them.", "p.npy", |at| {
            file(&at.join("p.npy"), npy("<f4", true, &SHAPE, &floats(&phases([2, 1, 0]))));
        })
        .right(EXACT),
        array("Phases after unwrapping.", "<f4", &SHAPE, || {
            let all = |i: usize| [i / 768, i / 32 % 24, i % 32].map(|n| n as f32);
            let value = |[f, y, x]: [f32; 3]| 0.7 * f + 0.31 * x + 0.17 * y + 0.01 * x * y;
            floats(&(0..usual().len()).map(|i| value(all(i))).collect::<Vec<_>>())
        })
        .right(EXACT),
        array("One sub-frame without an axis for it.", "<f4", &[24, 32], || floats(&usual()[..768])).right(EXACT),
        import("An archive of one array, as numpy.savez writes it.", "p.npz", |at| {
            file(&at.join("p.npz"), zip(&[("phases.npy", npy("<f4", false, &SHAPE, &floats(&usual())))]));
        })
        .right(EXACT),
        pictures("Gray pictures of 8 bits, numbered from 0.", gray).right(EIGHT_BITS),
        pictures("Gray pictures of 16 bits.", |frame| {
            let values = of_frame(&levels(65536), frame).into_iter().map(|v| v as u16).collect();
            png(ImageBuffer::<Luma<u16>, _>::from_raw(32, 24, values).expect("a picture"))
        })
        .right(Judge::By(|outcome| has_phases(outcome, 1e-4))),
        pictures("Gray pictures that were saved as RGB.", |frame| {
            let values = of_frame(&levels(256), frame).into_iter().flat_map(|v| [v as u8; 3]).collect();
            png(ImageBuffer::<Rgb<u8>, _>::from_raw(32, 24, values).expect("a picture"))
        })
        .right(EIGHT_BITS),
        import("One gray picture.", "one.png", |at| file(&at.join("one.png"), gray(0))).right(EIGHT_BITS),
        import("Gray pictures, with hidden files of macOS next to them.", "slm", |at| {
            (0..SHAPE[0]).for_each(|frame| file(&at.join(format!("slm/slm_{frame:02}.png")), gray(frame)));
            file(&at.join("slm/._slm_00.png"), [0u8; 64]);
            file(&at.join("slm/.DS_Store"), [0u8; 64]);
        })
        .right(EIGHT_BITS),
    ];
    situations.extend(units());
    situations.extend(axes());
    situations.extend(other_files());
    Chapter {
        title: "Phases of other programs",
        about: "Three sub-frames of 24 x 32 phases for one color of a small display.",
        situations,
    }
}

/// Returns situations with numbers that are not radians.
fn units() -> Vec<Situation> {
    let of_levels = |have, count: u32, unit: &'static str| {
        array(have, "<i8", &SHAPE, move || levels(count).iter().flat_map(|v| i64::from(*v).to_le_bytes()).collect())
            .refused("hologram/doubtful/whole-numbers", Remedy::As("--phase-unit", " out.zarr", unit), EIGHT_BITS)
    };
    vec![
        array("Degrees.", "<f4", &SHAPE, || floats(&turns().iter().map(|v| 360.0 * v).collect::<Vec<_>>())).refused(
            "hologram/doubtful/not-radians",
            Remedy::As("--phase-unit", " out.zarr", " out.zarr --phase-unit deg"),
            EXACT,
        ),
        array("Turns from 0 to 1.", "<f4", &SHAPE, || floats(&turns())).refused(
            "hologram/doubtful/turns",
            Remedy::As("--phase-unit turns", " out.zarr", " out.zarr --phase-unit turns"),
            EXACT,
        ),
        array("Gray levels as uint8.", "|u1", &SHAPE, || levels(256).iter().map(|v| *v as u8).collect()).refused(
            "hologram/doubtful/whole-numbers 255",
            Remedy::As("256", " out.zarr", " out.zarr --phase-unit 256"),
            EIGHT_BITS,
        ),
        of_levels("Gray levels as int64.", 256, " out.zarr --phase-unit 256"),
        of_levels("Levels of an SLM of 10 bits.", 1024, " out.zarr --phase-unit 1024"),
        array("Gray levels as float32.", "<f4", &SHAPE, || {
            floats(&levels(256).iter().map(|v| *v as f32).collect::<Vec<_>>())
        })
        .refused(
            "hologram/doubtful/whole-numbers p.npy",
            Remedy::By("how many levels are a turn", " out.zarr", " out.zarr --phase-unit 256"),
            EIGHT_BITS,
        ),
        array("Complex fields instead of phases.", "<c8", &SHAPE, || {
            usual().iter().flat_map(|v| [v.cos().to_le_bytes(), v.sin().to_le_bytes()]).flatten().collect()
        })
        .refused("file/content/npy-type '<c8'", change("numpy.angle", saved), EXACT),
        array("One phase is NaN.", "<f4", &SHAPE, || {
            let mut all = usual();
            all[777] = f32::NAN;
            floats(&all)
        })
        .refused("file/content/not-finite [1 9]", change("float32", saved), EXACT),
    ]
}

/// Returns situations with other axes, with part of the display, and without optics.
fn axes() -> Vec<Situation> {
    vec![
        array("Sub-frames are the last axis.", "<f4", &[24, 32, 3], || floats(&phases([1, 2, 0]))).refused(
            "hologram/not-a-hologram/shape",
            change("numpy.moveaxis(phases -1", saved),
            EXACT,
        ),
        array("Rows and columns are exchanged.", "<f4", &[3, 32, 24], || floats(&phases([0, 2, 1]))).refused(
            "hologram/doubtful/across",
            change("numpy.swapaxes(phases -1", saved),
            EXACT,
        ),
        array("An array without any sub-frame.", "<f4", &[0, 24, 32], Vec::new).refused(
            "hologram/not-a-hologram/shape [0 24 32]",
            change("sub-frame", saved),
            EXACT,
        ),
        case("Phases of a part of the display.", "convert p.npy out.zarr --display small --color green", saved)
            .right(EXACT),
        case("Phases without their optics.", "convert p.npy out.zarr", saved).refused(
            "hologram/no-optics",
            Remedy::As(
                "--display --color",
                "p.npy out.zarr",
                "p.npy out.zarr --display small --size 24x32 --color green",
            ),
            EXACT,
        ),
    ]
}

/// Returns situations with files of other programs and the lines that convert them.
fn other_files() -> Vec<Situation> {
    let foreign = |have, name: &'static str, bytes: &'static [u8], cause, named, from: &'static str| {
        import(have, name, move |at| {
            let mut all = bytes.to_vec();
            all.resize(200, 0);
            file(&at.join(name), all);
        })
        .refused(cause, convert(named, from, "p.npy", saved), EXACT)
    };
    vec![
        foreign(
            "A MATLAB file.",
            "p.mat",
            b"MATLAB 5.0 MAT-file, Platform: GLNXA64",
            "file/kind",
            "scipy.io.loadmat",
            "p.mat",
        ),
        foreign("An HDF5 file.", "p.h5", b"\x89HDF\r\n\x1a\n", "file/kind HDF5", "h5py.File", "p.h5"),
        import("A table of numbers.", "p.csv", |at| {
            let row = |y: usize| (0..32).map(|x| format!("{:.4}", phase([0, y, x]))).collect::<Vec<_>>().join(",");
            file(&at.join("p.csv"), (0..24).map(row).collect::<Vec<_>>().join("\n"));
        })
        .refused("file/kind", convert("numpy.genfromtxt", "p.csv", "p.npy", saved), EXACT),
        import("A file that does not exist.", "none.npy", saved).refused(
            "file/read",
            Remedy::As("none.npy", "none.npy", "p.npy"),
            EXACT,
        ),
        import("An array that was cut off.", "p.npy", |at| {
            let all = npy("<f4", false, &SHAPE, &floats(&usual()));
            file(&at.join("p.npy"), &all[..4000]);
        })
        .refused("file/content/npy-length p.npy", mended("bytes", saved), EXACT),
    ]
}
