//! Odd numbers of rows, columns, views, sub-frames and pupils. They are on the command line, in display files, in the
//! documents of holograms and in the names of scenes.

use crate::case::{Case, Put};
use crate::ground::Ground;

const COUNTS: [&str; 16] = [
    "0",
    "1",
    "2",
    "3",
    "5",
    "17",
    "64",
    "255",
    "256",
    "1000",
    "4096",
    "65535",
    "65536",
    "1000000",
    "4294967296",
    "18446744073709551615",
];

/// Numbers of sub-frames. With more sub-frames, a step could take longer than the time limit after ctrl-C.
const FRAMES: [&str; 7] = ["0", "1", "2", "5", "17", "5000", "18446744073709551615"];

/// Sides for runs that make many holograms.
const SMALL: [&str; 8] = ["0", "1", "2", "3", "17", "64", "200000", "4294967296"];

fn count(rng: &mut fastrand::Rng) -> &'static str {
    COUNTS[rng.usize(..COUNTS.len())]
}

/// Runs that take a size, or a number of views, sub-frames or pupils.
const RUNS: [&str; 12] = [
    "solve builtin:plane --size {}x{} --steps 1 --frames 1 --color green --engine cpu -o out/x.zarr",
    "solve builtin:plane --size {}x{} --steps 1 --memory 200MiB --engine cpu -o out/x.zarr",
    "solve builtin:plane --size 16x16 --steps 1 --frames {f} --views {} --color green --engine cpu -o out/x.zarr",
    "solve base/photo.png --depth-map base/depth.png --size {}x16 --views {} --steps 1 --frames 1 --engine cpu -o out/x.zarr",
    "solve base/views --size 16x{} --steps 1 --frames 2 --engine cpu -o out/x.zarr",
    "render builtin:plane --size {}x{} --color green --pupil=0,0,1,0 --engine cpu -o out/x.png",
    "solve builtin:plane --dry-run --size {}x{} --color green --engine cpu",
    "eval compare builtin:plane --size {s}x{s} --color green --frames 1 --steps 1 --methods dpac --views 2 --set compare.speckle=false --engine cpu -o out/e",
    "eval tune builtin:plane --size {s}x{s} --color green --frames {f} --duration 0.01 --no-store --engine cpu -o out/t",
    "eval score base/h.zarr builtin:plane --test-pupils random:{} --engine cpu",
    "solve builtin:plane --display base/far.toml --size {}x{} --frames 1 --memory 300MiB --set tiles.picture={} --set tiles.passes=1 --steps 1 --engine cpu -o out/x.zarr",
    "demo --size {} --engine cpu --out out/demo",
];

/// Returns a run with odd sizes.
pub fn case(ground: &Ground, rng: &mut fastrand::Rng) -> Case {
    match rng.u8(..6) {
        0 => {
            // The display has any size, with other odd numbers.
            let text = crate::ground::BENCH
                .replace("[16, 16]", &format!("[{}, {}]", count(rng), count(rng)))
                .replace("levels = 256", &format!("levels = {}", count(rng)))
                .replace("period_px = 8.0", &format!("period_px = {}", count(rng)))
                .replace("[1, -2]", &format!("[{}, -{}]", count(rng), count(rng)));
            let runs = [
                "solve builtin:plane --display in/bench/x.toml --steps 1 --frames 1 --color green --engine cpu -o out/x.zarr",
                "encode base/h.zarr --display in/bench/x.toml --engine cpu -o out/frames",
                "show base/h.zarr --display in/bench/x.toml --output offscreen --clock simulated --duration 0.1 --engine cpu",
                "render builtin:plane --display in/bench/x.toml --color green --pupil=0,0,1,0 --engine cpu -o out/x.png",
                "info base/views --display in/bench/x.toml -o out/x.png",
            ];
            let args: Vec<&str> = runs[rng.usize(..runs.len())].split(' ').collect();
            let case = Case::of(&args).put("in/bench", Put::Copy("base/bench".into()));
            case.put("in/bench/x.toml", Put::Bytes(text.into_bytes()))
        }
        1 => shape(ground, rng),
        2 => {
            let names = ["still-life", "dense-grass", "points", "plane", "chart"];
            let keys = ["brightness", "span", "camera", "depth", "x", ""];
            let scene = format!("builtin:{}?{}={}", names[rng.usize(..5)], keys[rng.usize(..6)], count(rng));
            Case::of(&[
                "solve",
                &scene,
                "--size",
                "16x16",
                "--steps",
                "1",
                "--frames",
                "1",
                "--engine",
                "cpu",
                "-o",
                "out/x.zarr",
            ])
        }
        _ => {
            let mut run = RUNS[rng.usize(..RUNS.len())].to_string();
            run = run.replace("{f}", FRAMES[rng.usize(..FRAMES.len())]);
            while run.contains("{s}") {
                run = run.replacen("{s}", SMALL[rng.usize(..SMALL.len())], 1);
            }
            while run.contains("{}") {
                run = run.replacen("{}", count(rng), 1);
            }
            Case::of(&run.split(' ').collect::<Vec<_>>())
        }
    }
}

/// Returns a run on a hologram whose array states a wrong shape and wrong chunks, with a valid checksum.
fn shape(ground: &Ground, rng: &mut fastrand::Rng) -> Case {
    let whole = ["h.zarr", "rgb.zarr", "moving.zarr", "far.zarr"][rng.usize(..4)];
    let name = format!("base/{whole}/phases/zarr.json");
    let mut document: serde_json::Value = serde_json::from_slice(&ground.files[&name]).expect("JSON");
    for key in ["/shape", "/chunk_grid/configuration/chunk_shape"] {
        for length in document.pointer_mut(key).and_then(|v| v.as_array_mut()).into_iter().flatten() {
            if rng.u8(..3) == 0 {
                *length = count(rng).parse::<u64>().expect("a number").into();
            }
        }
    }
    let runs = crate::fields::HOLOGRAM;
    let args = runs[rng.usize(..runs.len())].replace("{}", &format!("in/{whole}"));
    let case = Case::of(&args.split(' ').filter(|w| !w.is_empty()).collect::<Vec<_>>());
    case.put(&format!("in/{whole}"), Put::Copy(format!("base/{whole}")))
        .put(&format!("in/{whole}/phases/zarr.json"), Put::Bytes(crate::fields::sealed(&document)))
}
