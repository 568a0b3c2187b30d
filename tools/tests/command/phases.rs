//! Phases of other programs, in every command that takes a hologram.

use crate::common::{Printed, done, eyebox, folder, refused, text};
use eyebox::low_level::files::{Npy, read_npy};
use serde_json::Value;
use std::f32::consts::{PI, TAU};
use std::path::Path;

/// Rows and columns of the display `bench.toml`.
const SIZE: [usize; 2] = [12, 20];
const BENCH: &str = "resolution = [12, 20]\npitch_um = 8.0\nfocal_length_mm = 400.0\n\
                     wavelengths_nm = { red = 660, green = 520, blue = 440 }\n";

/// Type of an array's elements, with the function that writes one.
#[derive(Clone, Copy)]
struct Element {
    descr: &'static str,
    bytes: fn(f32) -> Vec<u8>,
}

const F4: Element = Element { descr: "<f4", bytes: |v| v.to_le_bytes().to_vec() };
const F4_BIG: Element = Element { descr: ">f4", bytes: |v| v.to_be_bytes().to_vec() };
const F8: Element = Element { descr: "<f8", bytes: |v| f64::from(v).to_le_bytes().to_vec() };
const U1: Element = Element { descr: "|u1", bytes: |v| vec![v as u8] };
const I8: Element = Element { descr: "<i8", bytes: |v| (v as i64).to_le_bytes().to_vec() };
const C8: Element = Element { descr: "<c8", bytes: |v| [v.cos(), v.sin()].map(f32::to_le_bytes).concat() };

/// Writes an `.npy` file as NumPy writes it.
fn npy(at: &Path, name: &str, shape: &[usize], element: Element, fortran: bool, values: &[f32]) {
    let count: usize = shape.iter().product();
    let place = |mut i: usize| {
        // This order gives the place in C order of the `i`-th element of the file.
        let order: Vec<usize> = if fortran { (0..shape.len()).collect() } else { (0..shape.len()).rev().collect() };
        let mut index = vec![0; shape.len()];
        for axis in order {
            (index[axis], i) = (i % shape[axis], i / shape[axis]);
        }
        index.iter().zip(shape).fold(0, |at, (i, n)| at * n + i)
    };
    let axes: String = shape.iter().map(|n| format!("{n},")).collect();
    let fortran = if fortran { "True" } else { "False" };
    let mut header = format!("{{'descr': '{}', 'fortran_order': {fortran}, 'shape': ({axes}), }}", element.descr);
    header.extend(std::iter::repeat_n(' ', 63 - (10 + header.len()) % 64));
    header.push('\n');
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((header.len() as u16).to_le_bytes());
    bytes.extend(header.as_bytes());
    (0..count).for_each(|i| bytes.extend((element.bytes)(values[place(i)])));
    std::fs::write(at.join(name), bytes).unwrap();
}

/// Returns `count` phases in radians that differ from pixel to pixel. Their range is `turns` turns.
fn radians(count: usize, turns: f32) -> Vec<f32> {
    (0..count).map(|i| ((i * 7919 % 10007) as f32 / 10007.0 - 0.5) * TAU * turns).collect()
}

fn wrapped(phase: f32) -> f32 {
    (phase + PI).rem_euclid(TAU) - PI
}

/// One form of an array with its expected result, which is a range of the phases or an error.
struct Way<'a> {
    shape: &'a [usize],
    element: Element,
    fortran: bool,
    /// Size of a turn in the unit of the file.
    turn: f32,
    turns: f32,
    more: &'a [&'a str],
    read: Result<[usize; 2], &'a str>,
}

#[test]
fn every_way_to_give_phases_is_read_right_or_refused() {
    let here = folder();
    let at = here.path();
    std::fs::write(at.join("bench.toml"), BENCH).unwrap();
    let [h, w] = SIZE;
    let one = h * w;
    let green: &[&str] = &["--display", "bench.toml", "--color", "green"];
    let all: &[&str] = &["--display", "bench.toml"];
    let plain = Way {
        shape: &[2, h, w],
        element: F4,
        fortran: false,
        turn: TAU,
        turns: 1.0,
        more: green,
        read: Ok([0, 2 * one]),
    };
    let with = |unit: &'static str| ["--display", "bench.toml", "--color", "green", "--phase-unit", unit];
    let (levels, turns, degrees, rad) = (with("256"), with("turns"), with("deg"), with("rad"));
    let ways = [
        // These arrays differ in their shape.
        Way { shape: &[h, w], read: Ok([0, one]), ..plain },
        Way { ..plain },
        Way { shape: &[3, 2, h, w], more: all, read: Ok([0, 6 * one]), ..plain },
        Way {
            shape: &[3, 2, h, w],
            more: &["--display", "bench.toml", "--color", "blue"],
            read: Ok([4 * one, 6 * one]),
            ..plain
        },
        Way { shape: &[1, 2, h, w], ..plain },
        Way { shape: &[2, 2, h, w], more: all, read: Err("hologram/doubtful/colors-not-named 'bench'"), ..plain },
        Way { shape: &[2 * one], read: Err("hologram/not-a-hologram/shape"), ..plain },
        Way { shape: &[64, 20, 2], read: Err("hologram/not-a-hologram/shape"), ..plain },
        Way { shape: &[w, h], read: Err("hologram/doubtful/across"), ..plain },
        // These calls lack the colors or the optics, or have an option that does not apply.
        Way { more: all, read: Err("hologram/doubtful/colors-not-named --color"), ..plain },
        Way { more: &[], read: Err("hologram/no-optics --display --color"), ..plain },
        Way { more: &["--pitch", "8"], read: Err("arguments/optics-together"), ..plain },
        Way {
            more: &["--display", "bench.toml", "--color", "green", "--at", "0"],
            read: Err("hologram/not-a-hologram/not-a-sequence --at"),
            ..plain
        },
        // These arrays differ in their element type and order.
        Way { element: F8, ..plain },
        Way { element: F4_BIG, ..plain },
        Way { fortran: true, ..plain },
        Way { element: C8, read: Err("file/content/npy-type numpy.angle"), ..plain },
        // These arrays differ in their unit.
        Way { turns: 6.0, ..plain },
        Way { element: U1, turn: 256.0, more: &levels, ..plain },
        Way { element: I8, turn: 256.0, more: &levels, ..plain },
        Way { turn: 1.0, more: &turns, ..plain },
        Way { turn: 360.0, more: &degrees, ..plain },
        Way { turns: 20.0, more: &rad, ..plain },
        Way { element: U1, turn: 256.0, read: Err("hologram/doubtful/whole-numbers 255"), ..plain },
        Way { turn: 1.0, read: Err("hologram/doubtful/turns"), ..plain },
        Way { turn: 360.0, read: Err("hologram/doubtful/not-radians"), ..plain },
        Way { turns: 20.0, read: Err("hologram/doubtful/not-radians --phase-unit"), ..plain },
    ];
    for (number, way) in ways.iter().enumerate() {
        let count: usize = way.shape.iter().product();
        let mut phases = radians(count, way.turns);
        let whole = matches!(way.element.descr, "|u1" | "<i8");
        if whole {
            phases.iter_mut().for_each(|p| *p = ((*p / TAU + 0.5) * 255.9).floor() / 256.0 * TAU);
        }
        let stored: Vec<f32> = match (way.turn == TAU, whole) {
            (true, _) => phases.clone(),
            (false, true) => phases.iter().map(|p| (p / TAU * way.turn).round()).collect(),
            (false, false) => phases.iter().map(|p| p / TAU * way.turn).collect(),
        };
        npy(at, "p.npy", way.shape, way.element, way.fortran, &stored);
        let args = [&["convert", "p.npy", "x.npy"], way.more].concat();
        match &way.read {
            Err(line) => refused(at, &args, "x.npy", line),
            Ok([from, to]) => {
                done(at, &args);
                let Npy { values, .. } = read_npy(&at.join("x.npy")).unwrap();
                assert_eq!(values.len(), to - from, "way {number}");
                let worst =
                    (values.iter().zip(&phases[*from..*to])).map(|(a, b)| wrapped(a - b).abs()).fold(0.0f32, f32::max);
                assert!(worst < 2e-4, "way {number}: {worst} rad");
                std::fs::remove_file(at.join("x.npy")).unwrap();
            }
        }
    }
}

/// Solves a small hologram as `h.zarr` and exports its phases as `p.npy`.
fn solved(at: &Path) {
    let solve =
        ["solve", "builtin:plane", "--display", "small", "--size", "36x48", "--color", "green", "--frames", "2"];
    done(at, &[&solve[..], &["--steps", "3", "--views", "3", "--engine", "cpu", "-o", "h.zarr"]].concat());
    done(at, &["convert", "h.zarr", "p.npy"]);
}

const GREEN: [&str; 4] = ["--display", "small", "--color", "green"];

#[test]
fn every_command_takes_phases_as_it_takes_their_hologram() {
    let here = folder();
    let at = here.path();
    solved(at);
    let both = |args: &[&str], more: &[&str]| {
        let (own, bare) =
            (args.iter().map(|a| a.replace("IN", "h.zarr")), args.iter().map(|a| a.replace("IN", "p.npy")));
        let (own, bare): (Vec<_>, Vec<_>) = (own.collect(), bare.collect());
        let words = |args: &[String], more: &[&str]| {
            let args: Vec<&str> = args.iter().map(String::as_str).chain(more.iter().copied()).collect();
            done(at, &args)
        };
        [words(&own, &[]), words(&bare, more)]
    };
    let read = |name: &str| std::fs::read(at.join(name)).unwrap();

    both(&["render", "IN", "--pupil=1,0,5,0", "--engine", "cpu", "-o", "IN.view.npy"], &GREEN);
    assert_eq!(read("h.zarr.view.npy"), read("p.npy.view.npy"));
    let scene = ["--views", "3", "--depth=-0.1..0.1", "--test-pupils", "random:3", "--engine", "cpu", "--json"];
    let [own, bare] = both(&[&["eval", "score", "IN", "builtin:plane"], &scene[..]].concat(), &GREEN);
    assert_eq!(own, bare);
    let encode = ["encode", "IN", "--display", "grey8", "--size", "36x48", "-o", "IN.frames"];
    both(&encode, &["--color", "green"]);
    assert_eq!(read("h.zarr.frames/frame-00001.png"), read("p.npy.frames/frame-00001.png"));
    let show = ["show", "IN", "--display", "grey8", "--size", "36x48", "--duration", "0.1", "--record", "IN.shown"];
    both(&show, &["--color", "green"]);
    assert_eq!(read("h.zarr.shown/set-000000-00.png"), read("p.npy.shown/set-000000-00.png"));
    refused(
        at,
        &["show", "p.npy", "--display", "grey8", "--size", "36x48", "--record", "x"],
        "x",
        "hologram/doubtful/colors-not-named --color",
    );

    // The exposures of bare phases are unknown, so that they are fitted to the scene.
    let refine =
        ["refine", "IN", "builtin:plane", "--views", "3", "--depth=-0.1..0.1", "--pupil=0,0,5,0", "--steps", "1"];
    let gains = both(&[&refine[..], &["--engine", "cpu", "--json"]].concat(), &GREEN);
    let gains = gains.map(|said| {
        let said: Value = serde_json::from_str(&said).unwrap();
        [0, 1].map(|row: usize| said["rows"][row]["eye_db"].as_f64().unwrap())
    });
    assert!((gains[0][0] - gains[1][0]).abs() < 0.01 && gains[1][1] > 10.0, "{gains:?} dB");
    let compare = [
        "eval",
        "compare",
        "builtin:plane",
        "--views",
        "3",
        "--set",
        "compare.speckle=false",
        "--hologram",
        "mine=p.npy",
    ];
    done(at, &[&compare[..], &GREEN, &["--size", "36x48", "--engine", "cpu", "-o", "report"]].concat());
    assert!(at.join("report/report.html").exists());
    let steer = ["show", "p.npy", "--tracker", "simulated", "--scene", "builtin:plane", "--display", "grey8"];
    let how = ["--size", "36x48", "--color", "green", "--engine", "cpu", "--duration", "0.1", "--stats", "stats.json"];
    done(at, &[&steer[..], &how].concat());
    assert!(at.join("stats.json").exists());
}

#[test]
fn phases_are_imported_with_what_is_known_of_them() {
    let here = folder();
    let at = here.path();
    solved(at);
    let import = |file: &str, out: &str, more: &[&str]| {
        let args = [&["convert", file, out], more, &["--engine", "cpu"]].concat();
        text(&eyebox(at, &args).stderr)
    };
    let attributes = |name: &str| -> Value {
        let document = std::fs::read(at.join(name).join("zarr.json")).unwrap();
        serde_json::from_slice::<Value>(&document).unwrap()["attributes"]["eyebox"].take()
    };
    // Pictures are imported in the same way as arrays. Their names state the colors.
    done(at, &["convert", "h.zarr", "frames"]);
    let said = import("frames", "f.zarr", &["--display", "small"]);
    let known = attributes("f.zarr");
    let exposure = |v: &Value| v["colors"][0]["exposure"].as_f64().unwrap();
    let rounded = |v: &Value| format!("{:.4}", exposure(v));
    assert!(said.has("f.zarr") && !said.contains(&rounded(&known)), "{said}");
    assert_eq!((&known["colors"][0]["color"], &known["display"]), (&"green".into(), &"small".into()));
    assert_eq!(known["settings"]["exposure_assumed"], true);
    // The exposure that is fitted to the scene is close to the exposure of the solve.
    let said = import("p.npy", "s.zarr", &[&["--scene", "builtin:plane"], &GREEN[..]].concat());
    let (own, fitted) = (attributes("h.zarr"), attributes("s.zarr"));
    assert!(said.has(&format!("s.zarr {}", rounded(&fitted))), "{said}");
    assert!((exposure(&own) / exposure(&fitted)).ln().abs() < 0.5, "{} {}", exposure(&own), exposure(&fitted));
    assert_eq!((&fitted["scene"], &fitted["settings"]["exposure_assumed"]), (&"builtin:plane".into(), &Value::Null));
    // `convert` replaces its own folder. It refuses a folder with a picture of the user, or with pictures of the user
    // only.
    done(at, &["convert", "h.zarr", "frames"]);
    let kept = std::fs::read(at.join("frames/green-01.png")).unwrap();
    std::fs::write(at.join("frames/green-01.png"), std::fs::read(at.join("frames/green-00.png")).unwrap()).unwrap();
    std::fs::create_dir(at.join("mine")).unwrap();
    for name in ["green-00.png", "green-01.png"] {
        std::fs::write(at.join("mine").join(name), &kept).unwrap();
    }
    for folder in ["frames", "mine"] {
        refused(at, &["convert", "h.zarr", folder], "x", "file/taken/holds-something-else");
        done(at, &["render", folder, "--display", "small", "--pupil=0,0,5,0", "--engine", "cpu", "-o", "seen.png"]);
    }
    assert_eq!(std::fs::read(at.join("mine/green-00.png")).unwrap(), kept);
    // The phases come back unchanged.
    done(at, &["convert", "s.zarr", "again.npy"]);
    assert_eq!(std::fs::read(at.join("again.npy")).unwrap(), std::fs::read(at.join("p.npy")).unwrap());
    refused(at, &["convert", "h.zarr", "x.zarr"], "x.zarr", "arguments/hologram-already");
    refused(at, &["convert", "p.npy", "x.zarr"], "x.zarr", "hologram/no-optics --display");
    refused(at, &["convert", "none.npy", "x.zarr", "--display", "small"], "x.zarr", "file/read none.npy");
    let one = ["render", "frames/green-00.png", "--display", "small", "--pupil=0,0,5,0", "-o", "x.png"];
    done(at, &[&one[..], &["--phase-unit", "256", "--engine", "cpu"]].concat());
    refused(at, &["convert", "p.npy", "x.txt", "--display", "small"], "x.txt", "arguments/ending");
}

#[test]
fn a_hologram_is_not_measured_against_another_scene() {
    let here = folder();
    let at = here.path();
    solved(at);
    let shows = "arguments/other-scene 'builtin:plane' 'builtin:points'";
    let score = ["eval", "score", "h.zarr", "builtin:points", "--test-pupils", "random:1", "--engine", "cpu"];
    refused(at, &score, "x", shows);
    done(at, &[&score[..], &["--force"]].concat());
    done(
        at,
        &["eval", "score", "h.zarr", "builtin:plane?brightness=1", "--test-pupils", "random:1", "--engine", "cpu"],
    );
    refused(at, &["refine", "h.zarr", "builtin:points", "--pupil=0,0,5,0", "-o", "x.zarr"], "x.zarr", shows);
    refused(
        at,
        &["eval", "compare", "builtin:points", "--hologram", "mine=h.zarr", "-o", "x"],
        "x",
        "quality/input/other-scene 'builtin:plane' 'builtin:points'",
    );
    let steer = ["show", "h.zarr", "--tracker", "simulated", "--scene", "builtin:points", "--display", "grey8"];
    refused(at, &[&steer[..], &["--duration", "0.1"]].concat(), "x", shows);
}

/// A program in Python needs only the description in docs/hologram-format.md.
#[test]
#[cfg(target_os = "linux")]
fn the_documents_python_writes_a_hologram() {
    let here = folder();
    let at = here.path();
    let document = include_str!("../../../docs/hologram-format.md");
    // One of the programs writes, and the others read.
    let mut programs = document.split("```python\n").skip(1).map(|p| p.split("```").next().expect("its end"));
    let program = programs.find(|program| program.contains("grating.zarr")).expect("the program");
    assert!(program.lines().filter(|l| !l.trim().is_empty()).count() <= 25, "short enough to be read");
    let run = |program: &str| {
        let ran = std::process::Command::new("python3").args(["-c", program]).current_dir(at).output();
        let ran = ran.expect("python3 is missing: install it (Debian, Ubuntu: apt-get install python3)");
        assert!(ran.status.success(), "{}", text(&ran.stderr));
    };
    run(program);
    // The log states that the hologram has no checksum.
    let said = |words: &[&str]| {
        let answer = eyebox(at, &[words, &["convert", "grating.zarr", "p.npy"]].concat());
        assert!(answer.status.success(), "{}", text(&answer.stderr));
        text(&answer.stderr)
    };
    assert_eq!([said(&[]), said(&["-v"])].map(|said| said.lines_with("grating.zarr")), [0, 1]);
    let Npy { shape, values, .. } = read_npy(&at.join("p.npy")).unwrap();
    assert_eq!(shape, [1, 48, 64]);
    assert!(values.iter().enumerate().all(|(i, v)| (v - wrapped(0.1 * (i % 64) as f32)).abs() < 1e-5));
    // The hologram is rendered, scored and encoded.
    done(at, &["render", "grating.zarr", "--pupil=0,0,5,0", "--engine", "cpu", "-o", "seen.png"]);
    done(at, &["eval", "score", "grating.zarr", "builtin:plane", "--test-pupils", "random:2", "--engine", "cpu"]);
    done(at, &["encode", "grating.zarr", "--display", "grey8", "--size", "48x64", "-o", "frames"]);

    // Each mistake in the file is reported.
    let wrong = |from: &str, to: &str, what: &str| {
        assert!(program.contains(from), "{from}");
        let _ = std::fs::remove_dir_all(at.join("grating.zarr"));
        run(&program.replace(from, to));
        refused(at, &["convert", "grating.zarr", "x.npy"], "x.npy", what);
    };
    wrong("\"format\": 1, ", "", "hologram/not-a-hologram/no-format");
    wrong("\"float32\"", "\"float64\"", "hologram/damaged/length");
    wrong("\"float32\"", "\"int32\"", "hologram/not-a-hologram/foreign-type int32");
    wrong("[1, 1, rows, columns]", "[1, 1, 1, columns]", "hologram/damaged/length");
    wrong("\"wavelength_nm\": nm", "\"wavelength\": nm", "hologram/not-a-hologram/attributes wavelength_nm");
    wrong("display=\"bench\"", "version=\"1.0\"", "hologram/damaged/no-checksum document_crc32c");
    wrong("0.1 * column", "float(column)", "hologram/not-a-hologram/no-radians");
    wrong("for row in frame)", "for row in frame[1:])", "hologram/damaged/length");
}
