//! Situations with light fields in one NumPy array.

use crate::frame::{Case, Chapter, Remedy, Situation, case, change, convert, mended};
use crate::judge::Judge;
use crate::made::{EXACT, GRID, SIZE, VIEWS, all, light};
use crate::write::{file, npy, zip};

const SHAPE: [usize; 5] = [GRID[0], GRID[1], SIZE[0], SIZE[1], 3];

/// Returns all values of the views in C order.
fn codes() -> Vec<u8> {
    all().into_iter().flat_map(image::RgbImage::into_raw).collect()
}

/// Converts values to linear light in little-endian float32.
fn floats(codes: &[u8]) -> Vec<u8> {
    codes.iter().flat_map(|v| light(*v).to_le_bytes()).collect()
}

/// Returns the values with their axes in another order. `order` has the old axis for each new axis.
fn turned<T: Copy>(values: &[T], shape: &[usize], order: &[usize]) -> (Vec<T>, Vec<usize>) {
    let to: Vec<usize> = order.iter().map(|&i| shape[i]).collect();
    let from = |mut i: usize| {
        let mut index = vec![0; shape.len()];
        for (axis, n) in order.iter().zip(&to).rev() {
            (index[*axis], i) = (i % n, i / n);
        }
        index.iter().zip(shape).fold(0, |at, (i, n)| at * n + i)
    };
    ((0..values.len()).map(|i| values[from(i)]).collect(), to)
}

/// A situation with the views in `v.npy`. The type of its elements is `descr`, and `bytes` encodes them.
fn array(have: &str, descr: &'static str, bytes: impl Fn(&[u8]) -> Vec<u8> + Send + Sync + 'static) -> Case {
    case(have, "render v.npy", move |at| file(&at.join("v.npy"), npy(descr, false, &SHAPE, &bytes(&codes()))))
}

/// A situation with the views in `v.npy` of 8 bits, with its axes in this order.
fn axes(have: &str, order: &'static [usize]) -> Case {
    case(have, "render v.npy", move |at| {
        let (values, shape) = turned(&codes(), &SHAPE, order);
        file(&at.join("v.npy"), npy("|u1", false, &shape, &values));
    })
}

fn plain() -> Vec<u8> {
    npy("|u1", false, &SHAPE, &codes())
}

/// Returns the bits of a half float for a value from 0 to 1, rounded down.
fn half(v: f32) -> [u8; 2] {
    let bits = v.to_bits();
    let exponent = (bits >> 23) as i32 - 127 + 15;
    (if exponent <= 0 { 0 } else { ((exponent as u32) << 10 | (bits >> 13 & 0x3ff)) as u16 }).to_le_bytes()
}

/// Checks that the hologram has a score against the array from which it was solved.
const SCORED: Judge = Judge::By(|outcome| {
    let words = ["eval", "score", "h.zarr", "--jod", "none", "--engine", "cpu", "--json"];
    let said = crate::common::done(outcome.folder, &words);
    let score: serde_json::Value = serde_json::from_str(&said).map_err(|e| e.to_string())?;
    match score["psnr_db"]["mean"].as_f64() {
        // The score is low because the hologram has one step, and the scene is bright.
        Some(psnr) if psnr > 9.0 => Ok(()),
        found => Err(format!("{found:?} dB")),
    }
});

const SOLVED: &str =
    "--order as-named --depth=-1..1 --size 48x64 --color green --frames 1 --steps 1 --engine cpu -o h.zarr";

/// Returns situations that solve a hologram of an array and state its white.
fn solved() -> Vec<Situation> {
    let of = |have: &str, scene: &str, descr: &'static str, bytes: fn(u8) -> Vec<u8>| {
        case(have, format!("solve {scene} {SOLVED}"), move |at| {
            let values: Vec<u8> = all().iter().flat_map(|view| view.as_raw()).flat_map(|v| bytes(*v)).collect();
            let [rows, columns] = GRID;
            file(&at.join("a/v.npy"), npy(descr, false, &[rows, columns, SIZE[0], SIZE[1], 3], &values));
        })
    };
    vec![
        of("Floats from 0 to 255 are solved.", "a/v.npy", "<f4", |v| f32::from(v).to_le_bytes().into()).refused(
            "scene/full-scale",
            Remedy::As("?full_scale=255", "a/v.npy", "a/v.npy?full_scale=255"),
            SCORED,
        ),
        of("Values of 10 bits are solved.", "a/v.npy?full_scale=1020", "<u2", |v| {
            (4 * u16::from(v)).to_le_bytes().into()
        })
        .right(SCORED),
    ]
}

pub fn chapter() -> Chapter {
    let mut situations = vec![
        array("An array has 8 bits and the axes (3, 5, 48, 64, 3).", "|u1", <[u8]>::to_vec).right(EXACT),
        array("An array has 16 bits, made from 8.", "<u2", |v| {
            v.iter().flat_map(|v| (u16::from(*v) * 257).to_le_bytes()).collect()
        })
        .right(EXACT),
        array("An array has big-endian integers of 16 bits.", ">u2", |v| {
            v.iter().flat_map(|v| (u16::from(*v) * 257).to_be_bytes()).collect()
        })
        .right(EXACT),
        array("An array has floats from 0 to 1, which are linear light.", "<f4", floats).right(EXACT),
        array("An array has floats of 64 bits.", "<f8", |v| {
            v.iter().flat_map(|v| f64::from(light(*v)).to_le_bytes()).collect()
        })
        .right(EXACT),
        array("An array has big-endian floats.", ">f4", |v| v.iter().flat_map(|v| light(*v).to_be_bytes()).collect())
            .right(EXACT),
        array("An array has floats of 16 bits.", "<f2", |v| v.iter().flat_map(|v| half(light(*v))).collect())
            .right(Judge::Like(&VIEWS, 1e-3)),
        case("An array is in Fortran order.", "render v.npy", |at| {
            let (values, _) = turned(&codes(), &SHAPE, &[4, 3, 2, 1, 0]);
            file(&at.join("v.npy"), npy("|u1", true, &SHAPE, &values));
        })
        .right(EXACT),
        case(
            "An array has the views one after the other, and the command states the grid.",
            "render v.npy?grid=3x5",
            |at| {
                file(&at.join("v.npy"), npy("|u1", false, &[15, 48, 64, 3], &codes()));
            },
        )
        .right(EXACT),
        case(
            "An array has floats from 0 to 1 by the sRGB curve, and the command states it.",
            "render v.npy?srgb",
            |at| {
                let bytes: Vec<u8> = codes().iter().flat_map(|v| (f32::from(*v) / 255.0).to_le_bytes()).collect();
                file(&at.join("v.npy"), npy("<f4", false, &SHAPE, &bytes));
            },
        )
        .right(EXACT),
        case("An array has an opaque alpha channel.", "render v.npy", |at| {
            let values: Vec<u8> = codes().chunks(3).flat_map(|p| [p[0], p[1], p[2], 255]).collect();
            file(&at.join("v.npy"), npy("|u1", false, &[3, 5, 48, 64, 4], &values));
        })
        .right(EXACT),
        case("An array has a first axis of length 1.", "render v.npy", |at| {
            file(&at.join("v.npy"), npy("|u1", false, &[1, 3, 5, 48, 64, 3], &codes()));
        })
        .right(EXACT),
        case("An .npz holds the views and a table of camera positions.", "render scene.npz", |at| {
            let table = npy("<f8", false, &[15, 3], &[0; 360]);
            file(&at.join("scene.npz"), zip(&[("positions.npy", table), ("views.npy", plain())]));
        })
        .right(EXACT),
        case("An array has the ending .dat.", "render v.dat", |at| file(&at.join("v.dat"), plain())).right(EXACT),
    ];
    situations.extend(refused());
    situations.extend(solved());
    Chapter {
        title: "Arrays",
        about: "The same views in one file. The axes are rows and columns of views, rows and columns of pixels, and colors.",
        situations,
    }
}

fn rewrite(at: &std::path::Path) {
    file(&at.join("v.npy"), plain());
}

fn refused() -> Vec<Situation> {
    vec![
        case("An array has the views one after the other.", "render v.npy", |at| {
            file(&at.join("v.npy"), npy("|u1", false, &[15, 48, 64, 3], &codes()));
        })
        .refused("scene/corrupt/array-row-of-views 15", Remedy::Replace("v.npy", "v.npy?grid=3x5"), EXACT),
        axes("An array has colors before the pixels, as in PyTorch.", &[0, 1, 4, 2, 3]).refused(
            "scene/corrupt/array-shape",
            change("numpy.moveaxis(views", rewrite),
            EXACT,
        ),
        axes("An array has all axes reversed, as MATLAB files read by h5py.", &[4, 3, 2, 1, 0]).refused(
            "scene/corrupt/array-shape [3 64 48 3]",
            change("numpy.transpose(views)", rewrite),
            EXACT,
        ),
        axes("An array has the pixels before the views.", &[2, 3, 4, 0, 1]).refused(
            "scene/corrupt/array-shape [48 64 5]",
            change("numpy.moveaxis(views 3 0", rewrite),
            EXACT,
        ),
        axes("An array has the columns of views before the rows.", &[1, 0, 2, 3, 4]).refused(
            "scene/order/moves-otherwise",
            Remedy::Add("--order transpose"),
            EXACT,
        ),
        case("An array has the rows of views from the bottom to the top.", "render v.npy", |at| {
            let rows: Vec<u8> = codes().chunks(5 * 48 * 64 * 3).rev().flatten().copied().collect();
            file(&at.join("v.npy"), npy("|u1", false, &SHAPE, &rows));
        })
        .refused("scene/order/moves-otherwise", Remedy::Add("--order flip-rows"), EXACT),
        case("An .npz holds two light fields.", "render scene.npz", |at| {
            let other: Vec<u8> = codes().iter().map(|v| 255 - v).collect();
            file(
                &at.join("scene.npz"),
                zip(&[("views.npy", plain()), ("negative.npy", npy("|u1", false, &SHAPE, &other))]),
            );
        })
        .refused("scene/corrupt/no-such-shape", Remedy::Replace("scene.npz", "scene.npz?array=views"), EXACT),
        array("An array has integers of 32 bits.", "<i4", |v| {
            v.iter().flat_map(|v| i32::from(*v).to_le_bytes()).collect()
        })
        .refused("scene/corrupt/array-type 'i4'", change("views.astype('uint8')", rewrite), EXACT),
        array("An array has integers of 64 bits, as NumPy makes them.", "<i8", |v| {
            v.iter().flat_map(|v| i64::from(*v).to_le_bytes()).collect()
        })
        .refused("scene/corrupt/array-type 'i8'", change("views.astype('uint8')", rewrite), EXACT),
        array("An array has complex numbers.", "<c8", |v| {
            v.iter().flat_map(|v| [light(*v).to_le_bytes(), [0; 4]]).flatten().collect()
        })
        .refused("scene/corrupt/npy-type c8", change("numpy.abs(a) **", rewrite), EXACT),
        array("An array has floats from 0 to 255.", "<f4", |v| {
            v.iter().flat_map(|v| (255.0 * light(*v)).to_le_bytes()).collect()
        })
        .refused("scene/full-scale", Remedy::Replace("v.npy", "v.npy?full_scale=255"), EXACT),
        array("An array of 16 bits has values of 10 bits.", "<u2", |v| {
            v.iter().flat_map(|v| ((f32::from(*v) / 255.0 * 1023.0).round() as u16).to_le_bytes()).collect()
        })
        .refused(
            "scene/full-scale 10",
            Remedy::Replace("v.npy", "v.npy?full_scale=1023"),
            Judge::Like(&VIEWS, 1e-3),
        ),
        array("An array has one NaN.", "<f4", |v| {
            let mut bytes = floats(v);
            bytes[400_000..400_004].copy_from_slice(&f32::NAN.to_le_bytes());
            bytes
        })
        .refused("scene/value", mended("finite", rewrite), EXACT),
        case("An array is cut off.", "render v.npy", |at| file(&at.join("v.npy"), &plain()[..100_000])).refused(
            "scene/corrupt/npy-length v.npy",
            mended("copy it again", rewrite),
            EXACT,
        ),
        case("An array was pickled.", "render v.npy", |at| file(&at.join("v.npy"), b"\x80\x04\x95rest")).refused(
            "scene/kind",
            convert("v-converted.npy", "v.npy", "v-converted.npy", |at| {
                file(&at.join("v-converted.npy"), plain());
            }),
            EXACT,
        ),
        case("An array holds one picture.", "render v.npy", |at| {
            file(&at.join("v.npy"), npy("|u1", false, &[48, 64, 3], &codes()[..48 * 64 * 3]));
        })
        .refused("scene/corrupt/array-one-picture", mended("views", rewrite), EXACT),
    ]
}
