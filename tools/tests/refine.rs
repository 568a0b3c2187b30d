//! `eyebox refine` as a user runs it.

mod common;

use common::{done, folder, refused};
use serde_json::Value;

#[test]
fn the_eye_sees_better_and_the_file_says_how() {
    let temp = folder();
    let at = temp.path();
    let solve =
        ["solve", "builtin:still-life", "--size", "96x96", "--steps", "20", "--color", "green", "--engine", "cpu"];
    done(at, &[&solve[..], &["-o", "h.zarr"]].concat());
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
    // What is kept is what was refined: begun there, refining gains little more.
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
    // The same seed, the same steps.
    let phases = |name: &str| std::fs::read_dir(at.join(name)).unwrap().count();
    assert_eq!(phases("there.zarr"), phases("h.zarr"));
    let adam = refine(&["--steps", "4", "--strategy", "adam"]);
    assert_eq!(adam["steering"]["strategy"]["kind"], "adam");
}

#[test]
fn mistakes_are_one_line() {
    let temp = folder();
    let at = temp.path();
    done(at, &["solve", "builtin:plane", "--size", "40x48", "--steps", "2", "--color", "green", "-o", "h.zarr"]);
    let refine = |more: &[&'static str]| [&["refine", "h.zarr", "builtin:plane", "-o", "x.zarr"][..], more].concat();
    let eye = "--pupil=0,0,4,0";
    refused(at, &refine(&[]), "x.zarr", "--pupil");
    refused(at, &refine(&["--pupil=0,0,0,0"]), "x.zarr", "diameter");
    refused(at, &refine(&[eye, "--pupils", "0"]), "x.zarr", "pupils a step");
    refused(at, &refine(&[eye, "--elsewhere", "1000"]), "x.zarr", "0 to 64");
    refused(at, &refine(&[eye, "--strategy", "none"]), "x.zarr", "projection, adam");
    refused(at, &["refine", "none.zarr", "builtin:plane", eye, "-o", "x.zarr"], "x.zarr", "none.zarr");
    refused(at, &["refine", "h.zarr", "builtin:plane", eye, "-o", "x.png"], "x.png", ".zarr");
}
