//! `eyebox encode` as a user runs it.

use crate::common::{self, Printed, done, eyebox, folder, json, notes, refusal, text};
use std::path::Path;

#[track_caller]
fn refused(folder: &Path, args: &[&str], what: &str) {
    common::refused(folder, args, "x", what);
}

fn phases(folder: &Path, name: &str, shape: &[usize]) -> Vec<f32> {
    let values: Vec<f32> = (0..shape.iter().product()).map(|i: usize| (i * 131 % 1009) as f32 * 0.02 - 10.0).collect();
    ::eyebox::low_level::files::write_npy(&folder.join(name), shape, &values).unwrap();
    values
}

/// Returns the level of a phase by plain arithmetic.
fn level(phase: f32, levels: f64) -> u8 {
    let exact = (f64::from(phase) / std::f64::consts::TAU).rem_euclid(1.0) * levels;
    (exact + 0.5).floor().rem_euclid(levels) as u8
}

fn picture(folder: &Path, name: &str) -> image::DynamicImage {
    image::open(folder.join(name)).unwrap_or_else(|e| panic!("{name}: {e}"))
}

/// Returns the number of pictures in a folder.
fn pictures(folder: &Path, name: &str) -> usize {
    let is_picture = |e: std::io::Result<std::fs::DirEntry>| e.unwrap().path().extension().is_some_and(|e| e == "png");
    std::fs::read_dir(folder.join(name)).unwrap().map(is_picture).filter(|is| *is).count()
}

#[test]
fn grey_frames_hold_every_level_in_order() {
    let temp = folder();
    let at = temp.path();
    phases(at, "p.npy", &[2, 3, 5, 7]);
    let colored = phases(at, "c.npy", &[3, 2, 5, 7]);
    done(at, &["encode", "c.npy", "--display", "grey8", "--size", "5x7", "-o", "x"]);
    for f in 0..2 {
        for c in 0..3 {
            let frame = picture(at, &format!("x/frame-{:05}.png", 3 * f + c)).into_luma8();
            let wanted: Vec<u8> = colored[(c * 2 + f) * 35..][..35].iter().map(|p| level(*p, 256.0)).collect();
            assert_eq!(frame.into_raw(), wanted);
        }
    }
    assert_eq!(pictures(at, "x"), 6);
    // The array has two colors, and the display has three.
    refused_at(
        at,
        &["encode", "p.npy", "--display", "grey8", "--size", "5x7", "-o", "y"],
        "hologram/doubtful/colors-not-named --color",
    );
}

#[track_caller]
fn refused_at(folder: &Path, args: &[&str], what: &str) {
    refusal(folder, args).is(what);
}

#[test]
fn a_report_says_what_each_frame_holds() {
    let temp = folder();
    let at = temp.path();
    let values = phases(at, "p.npy", &[3, 8, 4, 6]);
    let out = done(at, &["encode", "p.npy", "--display", "planes24", "--size", "4x6", "-o", "x", "--json"]);
    let report: serde_json::Value = serde_json::from_str(&out).expect("JSON");
    assert_eq!((report["height"].as_u64(), report["width"].as_u64()), (Some(4), Some(6)));
    let frames = report["frames"].as_array().expect("frames");
    assert_eq!(frames.len(), 1);
    let holds = frames[0]["holds"].as_array().expect("what it holds");
    assert_eq!(holds.len(), 24);
    // The report alone is enough to find every level again.
    let frame = picture(at, &format!("x/{}", frames[0]["file"].as_str().unwrap())).into_rgb8().into_raw();
    let index = |names: [&str; 3], v: &serde_json::Value| names.iter().position(|n| v == n).expect("a name");
    for slot in holds {
        let c = index(["red", "green", "blue"], &slot["color"]);
        let channel = index(["red", "green", "blue"], &slot["channel"]);
        let f = slot["sub_frame"].as_u64().unwrap() as usize;
        let bit = slot["bits"][0].as_u64().unwrap();
        for i in 0..24 {
            assert_eq!(frame[3 * i + channel] >> bit & 1, level(values[(c * 8 + f) * 24 + i], 2.0), "{slot}");
        }
    }
}

#[test]
fn a_hologram_is_encoded_on_both_engines_for_a_display_of_ones_own() {
    let temp = folder();
    let at = temp.path();
    let solve = ["solve", "builtin:plane", "-o", "h.zarr", "--size", "20x26", "--steps", "1", "--engine", "cpu"];
    done(at, &solve);
    done(at, &["convert", "h.zarr", "h.npy"]);
    let display = "resolution = [20, 26]\npitch_um = 8.0\nfocal_length_mm = 400.0\n\
                   wavelengths_nm = { red = 660, green = 532, blue = 440 }\n[encoding]\npacking = \"fields\"\n\
                   two_pi_level = { red = 250, green = 218, blue = 200.5 }\nflip = \"horizontal\"\n\
                   look_up = {}\n[[encoding.grating]]\nperiod_px = 6\ndirection_deg = 90\n";
    std::fs::write(at.join("bench.toml"), display).unwrap();
    for (engine, out) in [("cpu", "a"), ("vulkan", "b")] {
        let args = ["encode", "h.zarr", "--display", "bench.toml", "--engine", engine, "-o", out];
        let report = json(at, &[&args[..], &["--json"]].concat());
        assert_eq!(report["frames"].as_array().map(Vec::len), Some(8), "{report}");
        let shape = ["height", "width", "channels"].map(|side| report[side].as_u64());
        assert_eq!(shape, [20, 26, 3].map(Some), "{report}");
        // The hologram and the display have different wavelengths. The text and the report have a note.
        assert!(notes(&report["notes"], "520 532"), "{report}");
        assert_eq!(text(&eyebox(at, &args).stderr).lines_with("520 532"), 1);
    }
    done(at, &["encode", "h.npy", "--display", "bench.toml", "-o", "c"]);
    for f in 0..8 {
        let name = |folder| format!("{folder}/frame-{f:05}.png");
        let bytes = picture(at, &name("a")).into_rgb8();
        assert_eq!(bytes, picture(at, &name("b")).into_rgb8());
        assert_eq!(bytes, picture(at, &name("c")).into_rgb8());
        assert!(bytes.pixels().all(|p| p[0] < 250 && p[1] < 218 && p[2] <= 200));
    }
    // With one color of the hologram, the channels of the other colors are black.
    done(at, &["encode", "h.zarr", "--display", "bench.toml", "--color", "green", "-o", "g"]);
    let (all, green) = (picture(at, "a/frame-00003.png").into_rgb8(), picture(at, "g/frame-00003.png").into_rgb8());
    assert!(all.pixels().zip(green.pixels()).all(|(a, g)| g[1] == a[1] && g[0] == 0 && g[2] == 0));
}

#[test]
fn a_folder_of_frames_is_replaced_and_any_other_left_alone() {
    let temp = folder();
    let at = temp.path();
    phases(at, "p.npy", &[3, 4, 6]);
    phases(at, "q.npy", &[1, 4, 6]);
    let args = |input| ["encode", input, "--display", "grey8", "--color", "green", "--size", "4x6", "-o", "f"];
    done(at, &args("p.npy"));
    done(at, &args("q.npy"));
    assert_eq!(pictures(at, "f"), 1, "nothing of the longer one is left");
    std::fs::write(at.join("f/notes.txt"), "mine").unwrap();
    refused_at(at, &args("p.npy"), "file/taken/holds-something-else");
    assert_eq!(std::fs::read_to_string(at.join("f/notes.txt")).unwrap(), "mine");
    assert_eq!(pictures(at, "f"), 1);
}

#[test]
fn mistakes_are_one_line() {
    let temp = folder();
    let at = temp.path();
    phases(at, "p.npy", &[8, 4, 6]);
    phases(at, "three.npy", &[3, 8, 4, 6]);
    phases(at, "flat.npy", &[24]);
    let encode =
        |input, display, size| ["encode", input, "--display", display, "--color", "green", "--size", size, "-o", "x"];
    refused(at, &["encode", "p.npy", "--display", "grey8", "--color", "green", "-o", "x"], "arguments/size --size 4x6");
    refused(at, &encode("p.npy", "grey8", "4x5"), "arguments/size 4x5");
    refused(at, &encode("p.npy", "planes24", "4x6"), "encode/mismatch/sub-frames 24");
    refused(
        at,
        &["encode", "p.npy", "--display", "fields", "--size", "4x6", "-o", "x"],
        "hologram/doubtful/colors-not-named --color",
    );
    refused(at, &encode("flat.npy", "grey8", "4x6"), "hologram/not-a-hologram/shape");
    refused(at, &encode("none.npy", "grey8", "4x6"), "file/read none.npy");
    refused(at, &encode("p.npy", "none", "4x6"), "optics/unknown-display planes24");
    let mut values = vec![0.0f32; 24];
    values[7] = f32::NAN;
    ::eyebox::low_level::files::write_npy(&at.join("nan.npy"), &[1, 4, 6], &values).unwrap();
    refused(at, &encode("nan.npy", "grey8", "4x6"), "file/content/not-finite [0 1]");

    let head = "resolution = [4, 6]\npitch_um = 8.0\nfocal_length_mm = 400.0\nwavelengths_nm = { red = 660, green = 520, blue = 440 }\n";
    std::fs::write(at.join("bad.csv"), "level,phase\n0,0\n1,two\n").unwrap();
    std::fs::write(at.join("text.png"), "text").unwrap();
    for (encoding, what) in [
        ("packing = \"grey9\"", "optics/display-file/toml grey9"),
        ("pakcing = \"grey8\"", "optics/display-file/toml"),
        ("rotation_deg = 45", "optics/display-file/rotation 90 180 270"),
        ("packing = \"map\"", "optics/display-file/map-without-packing"),
        ("two_pi_level = 0", "optics/display-file/two-pi-level 65536"),
        ("two_pi_level = { red = 200 }", "encode/display/no-table"),
        ("look_up = { red = \"none.csv\", green = \"none.csv\", blue = \"none.csv\" }", "file/read none.csv"),
        ("look_up = { red = \"bad.csv\" }", "encode/table/phase bad.csv"),
        ("codes = [1, 2]", "optics/display-file/table-length 256"),
        ("phases_turns = [0.0]", "optics/display-file/table-length 256"),
        ("cells = [[0, 1], [2]]", "optics/display-file/cells"),
        ("[[encoding.correction]]\nfile = \"text.png\"", "optics/display-file/toml sign"),
        ("[[encoding.correction]]\nfile = \"text.png\"\nsign = 2", "optics/display-file/correction-sign"),
        ("[[encoding.correction]]\nfile = \"text.png\"\nsign = 1", "file/kind text.png"),
        ("[[encoding.correction]]\nfile = \"none.png\"\nsign = 1", "file/read none.png"),
        ("[[encoding.grating]]\nperiod_px = 0\ndirection_deg = 0", "optics/display-file/grating"),
    ] {
        std::fs::write(at.join("bench.toml"), format!("{head}[encoding]\n{encoding}\n")).unwrap();
        refused(at, &["encode", "three.npy", "--display", "bench.toml", "-o", "x"], what);
    }
    std::fs::write(at.join("file"), "").unwrap();
    refused_at(
        at,
        &["encode", "p.npy", "--display", "grey8", "--color", "red", "--size", "4x6", "-o", "file"],
        "file/taken/is-a-file",
    );
}
