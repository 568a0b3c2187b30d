//! A hologram finds its scene from any folder, reads it as it was solved, and uses no other scene instead.

use crate::common::{Printed, Refusal, command, done, folder, made, refusal, refused, text, with_json_errors, written};
use serde_json::Value;
use std::fs;
use std::path::Path;

const SMALL: [&str; 10] = ["--size", "40x40", "--steps", "3", "--frames", "1", "--color", "green", "--engine", "cpu"];
const PUPILS: [&str; 7] = ["--test-pupils", "random:3", "--jod", "none", "--engine", "cpu", "--json"];

/// Solves `scene` into `out`, both in the folder `at`.
fn solve(at: &Path, scene: &str, out: &str, more: &[&str]) {
    done(at, &[&["solve", scene, "-o", out][..], &SMALL, more].concat());
}

/// Returns the mean PSNR of `eval score`, in dB.
fn psnr(at: &Path, words: &[&str]) -> f64 {
    let said = done(at, &[&["eval", "score"][..], words, &PUPILS].concat());
    serde_json::from_str::<Value>(&said).expect("JSON")["psnr_db"]["mean"].as_f64().expect("a number")
}

/// Asserts that a score is refused in one line with the remedy `--force`, and that the remedy works.
#[track_caller]
fn refused_unless_asked(at: &Path, words: &[&str], what: &str) {
    refused(at, &[&["eval", "score"][..], words, &PUPILS].concat(), "nothing", &format!("{what} --force"));
    psnr(at, &[words, &["--force"]].concat());
}

/// Makes a folder `a` with the light field `views` and its hologram `h.zarr`, and a folder `b` with another light field
/// of the same name. Also returns the PSNR of the hologram, in dB.
fn two_folders() -> (tempfile::TempDir, f64) {
    let temp = folder();
    let [a, b] = ["a", "b"].map(|name| temp.path().join(name));
    made::views(&a.join("views"), "builtin:still-life", |r, c| [r, c]);
    made::views(&b.join("views"), "builtin:dense-grass", |r, c| [r, c]);
    solve(&a, "views", "h.zarr", &[]);
    let right = psnr(&a, &["h.zarr", "views"]);
    (temp, right)
}

#[test]
fn its_scene_is_found_wherever_it_is_opened() {
    let (temp, right) = two_folders();
    let [a, b, c] = ["a", "b", "c"].map(|name| temp.path().join(name));
    let is = |at: &Path, words: &[&str]| {
        let found = psnr(at, words);
        assert!((found - right).abs() < 1e-9, "{words:?} in {}: {found} dB, not {right}", at.display());
    };
    // The scene is found from its own folder, from another one, and from one that has another scene of the same name.
    is(&a, &["h.zarr"]);
    is(temp.path(), &["a/h.zarr"]);
    is(&b, &["../a/h.zarr"]);
    // A copy of the hologram next to another scene of the same name still finds its own scene.
    fs::create_dir_all(&c).unwrap();
    assert!(std::process::Command::new("cp").arg("-r").args([a.join("h.zarr"), b.clone()]).status().unwrap().success());
    is(&b, &["h.zarr"]);
    is(&c, &["../b/h.zarr"]);
    // A refined copy in another folder finds the scene as well.
    let refine = ["refine", "../a/h.zarr", "--pupil=4,0,4,0", "--steps", "1", "--engine", "cpu", "-o", "refined.zarr"];
    done(&c, &refine);
    psnr(&b, &["../c/refined.zarr"]);
    // The hologram and the scene move together.
    let moved = temp.path().join("moved/deep");
    fs::create_dir_all(moved.parent().unwrap()).unwrap();
    fs::rename(&a, &moved).unwrap();
    is(&moved, &["h.zarr"]);
    is(&b, &[&moved.join("h.zarr").display().to_string()]);
    // The scene gets a new name, and the call states it.
    fs::rename(moved.join("views"), moved.join("still life")).unwrap();
    is(&moved, &["h.zarr", "still life"]);
    refused(&moved, &[&["eval", "score", "h.zarr"][..], &PUPILS].concat(), "nothing", "arguments/scene-not-found");
}

#[test]
fn another_scene_and_one_that_changed_are_refused_unless_asked_for() {
    let (temp, right) = two_folders();
    let [a, b] = ["a", "b"].map(|name| temp.path().join(name));
    refused_unless_asked(&b, &["../a/h.zarr", "views"], "arguments/other-scene");
    refused_unless_asked(&a, &["h.zarr", "builtin:still-life"], "arguments/other-scene");
    assert!(right - psnr(&b, &["../a/h.zarr", "views", "--force"]) > 1.0);
    for named in [
        &["refine", "../a/h.zarr", "views", "--pupil=4,0,4,0"][..],
        &["eval", "gaze", "../a/h.zarr", "--scene", "views"],
    ] {
        refused(&b, &[named, &["--engine", "cpu", "-o", "out.zarr"]].concat(), "out.zarr", "arguments/other-scene");
    }
    // One of the nine views changes.
    fs::copy(a.join("views/view_0_1.png"), a.join("views/view_0_0.png")).unwrap();
    refused_unless_asked(&b, &["../a/h.zarr"], "arguments/changed-scene");
    refused_unless_asked(&a, &["h.zarr", "views"], "arguments/other-scene");
    refused(&b, &["eval", "gaze", "../a/h.zarr", "--engine", "cpu", "-o", "out"], "out", "arguments/changed-scene");
    // One view is missing.
    fs::remove_file(a.join("views/view_0_0.png")).unwrap();
    refused(&a, &[&["eval", "score", "h.zarr"][..], &PUPILS].concat(), "nothing", "arguments/changed-scene");
}

#[cfg(unix)]
#[test]
fn a_link_may_come_to_lead_elsewhere() {
    let (temp, right) = two_folders();
    let at = temp.path();
    let link = |to: &str| {
        let _ = fs::remove_file(at.join("link"));
        std::os::unix::fs::symlink(to, at.join("link")).unwrap();
    };
    link("a/views");
    solve(at, "link", "linked.zarr", &[]);
    assert!((psnr(&at.join("b"), &["../linked.zarr"]) - right).abs() < 1e-9);
    // The folder behind the link moves, and the link follows it.
    fs::rename(at.join("a/views"), at.join("a/kept")).unwrap();
    link("a/kept");
    assert!((psnr(&at.join("b"), &["../linked.zarr"]) - right).abs() < 1e-9);
    link("b/views");
    refused_unless_asked(at, &["linked.zarr"], "arguments/changed-scene");
}

#[test]
fn arrays_pictures_and_tiles_are_found_as_they_were_read() {
    let temp = folder();
    let [at, away] = ["at", "away"].map(|name| temp.path().join(name));
    fs::create_dir_all(&away).unwrap();
    made::views(&at.join("views"), "builtin:still-life", |r, c| [r, c]);
    // The views of the array are in one list and need a grid. Their pitch is not the default.
    let light: Vec<f32> = (0..6 * 64).map(|i| (i % 64 * 37 % 97) as f32 / 97.0).collect();
    eyebox::low_level::files::write_npy(&at.join("array.npy"), &[6, 8, 8], &light).unwrap();
    solve(&at, "array.npy?grid=2x3", "array.zarr", &["--view-pitch", "2", "--depth", "0..0"]);
    let render = ["render", "builtin:still-life", "--size", "40x40", "--views", "3", "--pupil=0,0,2,0"];
    done(&at, &[&render[..], &["-o", "photo.png"]].concat());
    done(&at, &[&render[..], &["--color", "green", "-o", "depth.png"]].concat());
    let with_map = ["--depth-map", "depth.png", "--near", "dark", "--depth=-1..1", "--views", "4"];
    solve(&at, "photo.png", "photo.zarr", &with_map);
    solve(&at, "builtin:plane?depth=0.5", "plane.zarr", &["--views", "3"]);
    solve(&at, "views", "order.zarr", &["--order", "flip-rows,flip-columns", "--depth=-1..1"]);
    fs::write(at.join("far.toml"), FAR).unwrap();
    let tiled = "--display far.toml --frames 1 --memory 200MiB --pupil-diameter 0.2..0.4 --set tiles.picture=32 --set tiles.passes=1 --steps 1";
    let words: Vec<&str> = tiled.split_whitespace().collect();
    done(&at, &[&["solve", "views", "-o", "tiles.zarr", "--engine", "cpu", "--depth=-1..1"][..], &words].concat());
    for (hologram, named) in [
        ("array.zarr", &["array.npy?grid=2x3"][..]),
        ("array.zarr", &["array.npy"]),
        ("photo.zarr", &["photo.png", "--depth-map", "depth.png"]),
        ("photo.zarr", &["photo.png"]),
        ("plane.zarr", &["builtin:plane?depth=0.5"]),
        ("order.zarr", &["views"]),
        ("tiles.zarr", &["views"]),
    ] {
        let right = psnr(&at, &[&[hologram][..], named].concat());
        let found = psnr(&away, &[&format!("../at/{hologram}")]);
        assert!((found - right).abs() < 1e-9, "{hologram}: {found} dB, not {right}");
    }
    // Another map makes another scene, and so does other content of the same array.
    let other = ["render", "builtin:plane", "--size", "40x40", "--views", "3", "--pupil=0,0,2,0", "--color", "green"];
    done(&at, &[&other[..], &["-o", "other.png"]].concat());
    refused_unless_asked(&at, &["photo.zarr", "--depth-map", "other.png"], "arguments/other-scene");
    refused_unless_asked(&at, &["photo.zarr", "photo.png", "--depth-map", "other.png"], "arguments/other-scene");
    fs::copy(at.join("other.png"), at.join("depth.png")).unwrap();
    refused_unless_asked(&away, &["../at/photo.zarr"], "arguments/changed-scene");
    let light: Vec<f32> = light.iter().map(|v| 1.0 - v).collect();
    eyebox::low_level::files::write_npy(&at.join("array.npy"), &[6, 8, 8], &light).unwrap();
    refused_unless_asked(&at, &["array.zarr"], "arguments/changed-scene");
    refused_unless_asked(&at, &["plane.zarr", "builtin:plane?depth=0.6"], "arguments/other-scene");
    // A job in tiles is another job after its views have changed.
    fs::copy(at.join("views/view_0_1.png"), at.join("views/view_0_0.png")).unwrap();
    refused_unless_asked(&at, &["tiles.zarr"], "arguments/changed-scene");
}

const FAR: &str = "name = \"far\"\nresolution = [192, 192]\npitch_um = 4.0\nfocal_length_mm = 400.0\n\
                   wavelengths_nm = { green = 520 }\ngeometry = \"far-field\"\n";

/// Each hologram of a sequence has its own scene. An unfinished sequence continues only with the same scenes.
#[test]
fn a_sequence_knows_the_scene_of_each_hologram() {
    let temp = folder();
    let [at, away] = ["at", "away"].map(|name| temp.path().join(name));
    fs::create_dir_all(&away).unwrap();
    for (name, scene) in [("one, two", "builtin:still-life"), ("three", "builtin:dense-grass")] {
        made::views(&at.join(name), scene, |r, c| [r, c]);
    }
    made::views(&away.join("three"), "builtin:chart", |r, c| [r, c]);
    let solve = ["solve", "one, two", "three", "-o", "s.zarr", "--depth=-1..1"];
    let solve = [&solve[..], &SMALL].concat();
    done(&at, &solve);
    let show = |from: &Path, what: &str| {
        let words = "--tracker simulated --output offscreen --clock simulated --set show.step_time=2 --duration 0.2 --engine cpu";
        let words: Vec<&str> = words.split_whitespace().collect();
        with_json_errors(&mut command(from, &[&["show", what][..], &words].concat())).output().expect("it starts")
    };
    let answer = show(&away, "../at/s.zarr");
    assert!(answer.status.success(), "{}", text(&answer.stderr));
    // Complete holograms are not solved again.
    let solved = || [0, 1].map(|i| written(&at.join(format!("s.zarr/phases/c/{i}/0/0/0/0"))));
    let before = solved();
    assert!(done(&at, &solve).has("s.zarr 2") && solved() == before);
    fs::copy(at.join("three/view_0_1.png"), at.join("three/view_0_0.png")).unwrap();
    refusal(&at, &solve).is("hologram/other-sequence/scene-changed three");
    fs::copy(at.join("one, two/view_0_1.png"), at.join("one, two/view_0_0.png")).unwrap();
    let answer = show(&away, "../at/s.zarr");
    assert!(!answer.status.success());
    Refusal::of(&answer).is("session/setting ../at/s.zarr --force");
}

/// `refine` writes the best state and not the last. More steps never lower the result of `eval score` at the pupil.
#[test]
fn refine_writes_the_best_state() {
    let temp = folder();
    let at = temp.path();
    let solve = "solve builtin:still-life --size 128x128 --color green --frames 2 --steps 6 --engine cpu -o h.zarr";
    done(at, &solve.split_whitespace().collect::<Vec<_>>());
    fs::write(at.join("pupil.json"), "[[4, 0, 4, 1]]").unwrap();
    let json = |words: &[&str]| -> Value { serde_json::from_str(&done(at, words)).expect("JSON") };
    let score = |file: &str| {
        let said = json(&["eval", "score", file, "--test-pupils", "pupil.json", "--engine", "cpu", "--json"]);
        said["psnr_db"]["mean"].as_f64().unwrap()
    };
    let (mut before, mut fell) = (score("h.zarr"), 0.0f64);
    for steps in ["8", "16", "20", "32"] {
        let said = json(&[
            "refine",
            "h.zarr",
            "--pupil=4,0,4,1",
            "--steps",
            steps,
            "--engine",
            "cpu",
            "--json",
            "-o",
            "r.zarr",
        ]);
        let eye = said["rows"].as_array().unwrap().iter().map(|row| row["eye_db"].as_f64().unwrap());
        let eye: Vec<f64> = eye.collect();
        let (best, written) = (said["best_db"][0].as_f64().unwrap(), score("r.zarr"));
        assert!((written - best).abs() < 0.01, "{steps} steps: {written} dB by score, {best} dB by refine");
        assert!(eye.iter().all(|db| *db <= best + 1e-9) && written >= before - 0.01, "{steps} steps: {said}");
        // The file has the state after exactly the number of steps that the best state took.
        let at_best = said["best_steps"][0].to_string();
        json(&[
            "refine",
            "h.zarr",
            "--pupil=4,0,4,1",
            "--steps",
            &at_best,
            "--engine",
            "cpu",
            "--json",
            "-o",
            "b.zarr",
        ]);
        let phases = |name: &str| fs::read(at.join(name).join("phases/c/0/0/0/0")).unwrap();
        assert!(phases("r.zarr") == phases("b.zarr") && phases("r.zarr") != phases("h.zarr"));
        fell = fell.max(written - eye[eye.len() - 1]);
        before = written;
    }
    assert!(fell > 0.1, "the last state was always the best, within {fell} dB");
}
