//! `eyebox refine` as a user runs it.

use crate::common::{done, folder, refused};
use serde_json::Value;

#[test]
fn the_eye_sees_better_and_the_file_says_how() {
    let temp = folder();
    let at = temp.path();
    let solve =
        ["solve", "builtin:still-life", "--size", "96x96", "--steps", "20", "--color", "green", "--engine", "cpu"];
    done(at, &[&solve[..], &["--set", "viewing.pixels_per_degree=20", "-o", "h.zarr"]].concat());
    let refine = |more: &[&str]| -> Value {
        let fixed = ["refine", "h.zarr", "builtin:still-life", "--pupil=4,-2,4,0.2", "--engine", "cpu", "--json"];
        serde_json::from_str(&done(at, &[&fixed[..], more].concat())).expect("one JSON object")
    };
    let said = refine(&["--steps", "9", "-o", "there.zarr"]);
    let rows = said["rows"].as_array().unwrap();
    let steps: Vec<u64> = rows.iter().map(|r| r["steps"].as_u64().unwrap()).collect();
    assert_eq!(steps, [0, 1, 2, 4, 8, 9]);
    let eye = |i: usize| rows[i]["eye_db"].as_f64().unwrap();
    assert!(eye(5) > eye(0) + 1.5, "{said}");
    // The file has the refined hologram, so that a refinement from there gains little more.
    let again = {
        let text = done(
            at,
            &[
                "refine",
                "there.zarr",
                "builtin:still-life",
                "--pupil=4,-2,4,0.2",
                "--steps",
                "1",
                "--engine",
                "cpu",
                "--json",
            ],
        );
        serde_json::from_str::<Value>(&text).unwrap()["rows"][0]["eye_db"].as_f64().unwrap()
    };
    assert!((again - eye(5)).abs() < 0.5, "{again} dB, {} dB before it was written", eye(5));
    // The file of the refinement has as many entries as the file of the solve.
    let phases = |name: &str| std::fs::read_dir(at.join(name)).unwrap().count();
    assert_eq!(phases("there.zarr"), phases("h.zarr"));
    let adam = refine(&["--steps", "4", "--set", "refine.strategy=adam"]);
    assert_eq!(adam["steering"]["strategy"]["kind"], "adam");
}

/// Only the tiles around the eye are read and refined. They go into a copy, and no other tile changes.
#[test]
fn a_hologram_in_tiles_is_refined_where_the_eye_is() {
    let temp = folder();
    let at = temp.path();
    let display = "name = \"far\"\nresolution = [320, 320]\npitch_um = 4.0\nfocal_length_mm = 400.0\n\
                   wavelengths_nm = { green = 520, blue = 440 }\ngeometry = \"far-field\"\n";
    std::fs::write(at.join("far.toml"), display).unwrap();
    let solve = ["solve", "builtin:still-life", "--display", "far.toml", "--frames", "2", "--memory", "600MiB"];
    let few = [
        "--pupil-diameter",
        "0.2..0.4",
        "--set",
        "tiles.picture=96",
        "--set",
        "tiles.passes=1",
        "--engine",
        "cpu",
        "-o",
        "h.zarr",
    ];
    done(at, &[&solve[..], &few].concat());
    let refine = |file: &str, more: &[&str]| -> Value {
        let place = ["--pupil=-0.3,0.25,0.3,0", "--spread", "0.02", "--pupil-diameter", "0.25..0.35"];
        let fixed = ["refine", file, "builtin:still-life", "--engine", "cpu", "--json"];
        serde_json::from_str(&done(at, &[&fixed[..], &place, more].concat())).expect("one JSON object")
    };
    let said = refine("h.zarr", &["--steps", "8", "-o", "there.zarr"]);
    let rows = said["rows"].as_array().unwrap();
    let eye = |i: usize| rows[i]["eye_db"].as_f64().unwrap();
    assert!(eye(rows.len() - 1) > eye(0) + 1.0 && rows[0]["piece_db"].as_f64().is_some(), "{said}");
    // The area is the place of the eye, three deviations and half a pupil. This is 0.235 mm to each side, in tiles of
    // 0.128 mm.
    let number = |key: &str, i: usize| said["piece"][key][i].as_u64().unwrap() as usize;
    assert_eq!([number("first", 0), number("first", 1)], [160, 0], "{said}");
    assert_eq!([number("size", 0), number("size", 1)], [128, 160], "{said}");
    let inside = |row: usize, column: usize| {
        let within =
            |i: usize, tile: usize| (number("first", i)..number("first", i) + number("size", i)).contains(&(32 * tile));
        within(0, row) && within(1, column)
    };
    let mut changed = 0;
    for (color, row, column) in (0..200).map(|i| (i / 100, i / 10 % 10, i % 10)) {
        let tile = |name: &str| std::fs::read(at.join(format!("{name}/phases/c/{color}/0/{row}/{column}"))).unwrap();
        let other = tile("h.zarr") != tile("there.zarr");
        assert!(inside(row, column) || !other, "{color} {row} {column}");
        changed += usize::from(other);
    }
    assert!((20..=40).contains(&changed), "{changed} tiles of two colors");
    // The file has the refined hologram, which can be rendered as any other.
    let again = refine("there.zarr", &["--steps", "1"]);
    let before = again["rows"][0]["eye_db"].as_f64().unwrap();
    assert!((before - eye(rows.len() - 1)).abs() < 0.3, "{before} dB, {} before it was written", eye(rows.len() - 1));
    done(at, &["render", "there.zarr", "--pupil=-0.3,0.25,0.3,0", "-o", "v.png", "--engine", "cpu"]);
    // A refinement can also replace its own input.
    refine("h.zarr", &["--steps", "8", "-o", "h.zarr"]);
    let tile = |name: &str| std::fs::read(at.join(format!("{name}/phases/c/1/0/7/2"))).unwrap();
    assert_eq!(tile("h.zarr"), tile("there.zarr"));
    let outside = ["refine", "h.zarr", "builtin:still-life", "--pupil=0.7,0,0.3,0", "-o", "x.zarr"];
    refused(at, &outside, "x.zarr", "arguments/outside-eyebox");
    // An unfinished hologram is not copied.
    std::fs::write(at.join("h.zarr/progress.json"), r#"{"done":1,"job":null,"pending":[]}"#).unwrap();
    let early = ["refine", "h.zarr", "builtin:still-life", "--pupil=0,0,0.3,0", "-o", "x.zarr"];
    refused(at, &early, "x.zarr", "arguments/unfinished");
}

#[test]
fn mistakes_are_one_line() {
    let temp = folder();
    let at = temp.path();
    done(at, &["solve", "builtin:plane", "--size", "40x48", "--steps", "2", "--color", "green", "-o", "h.zarr"]);
    let refine = |more: &[&'static str]| [&["refine", "h.zarr", "builtin:plane", "-o", "x.zarr"][..], more].concat();
    let eye = "--pupil=0,0,4,0";
    refused(at, &refine(&[]), "x.zarr", "usage/missing-required-argument --pupil");
    refused(at, &refine(&["--pupil=0,0,0,0"]), "x.zarr", "usage/value-validation diameter");
    refused(at, &refine(&[eye, "--set", "refine.pupils=0"]), "x.zarr", "solve/setting");
    refused(at, &refine(&[eye, "--set", "refine.elsewhere=1000"]), "x.zarr", "solve/setting 64");
    refused(at, &refine(&[eye, "--set", "refine.strategy=none"]), "x.zarr", "produce/job/value strategy");
    refused(at, &["refine", "none.zarr", "builtin:plane", eye, "-o", "x.zarr"], "x.zarr", "file/read none.zarr");
    refused(at, &["refine", "h.zarr", "builtin:plane", eye, "-o", "x.png"], "x.png", "arguments/ending");
}
