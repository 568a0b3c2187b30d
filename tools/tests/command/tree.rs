//! `render`, `info` and `convert`, which replace several former commands, and the names of those commands.

use crate::common::{done, folder, json, refusal};
use eyebox::low_level::files::read_npy;
use std::path::Path;

const SMALL: [&str; 8] = ["--size", "24x32", "--color", "green", "--views", "3", "--engine", "cpu"];

/// Reads the shape and the values of an array.
fn array(file: &Path) -> (Vec<usize>, Vec<f32>) {
    let array = read_npy(file).expect("an array");
    (array.shape, array.values)
}

fn solve(at: &Path, more: &[&str]) {
    done(at, &[&["solve", "builtin:still-life", "--steps", "3", "--frames", "2"][..], &SMALL, more].concat());
}

/// `--what both` has the image at its exposure on the left and the target image on the right.
#[test]
fn both_are_the_image_beside_the_target() {
    let temp = folder();
    let at = temp.path();
    solve(at, &["-o", "h.zarr"]);
    let render = |what: &str, more: &[&str]| {
        let file = format!("{}.npy", more.first().map_or("x", |_| "y"));
        let words = ["render", what, "--pupil=1,0,4,0", "-o", &file, "--engine", "cpu"];
        let report = json(at, &[&words[..], more, &["--json"]].concat());
        (array(&at.join(&file)), report["exposure"][0].as_f64().unwrap())
    };
    let ((shape, image), exposure) = render("h.zarr", &[]);
    assert_eq!(shape, [24, 32]);
    let ((shape, both), _) = render("h.zarr", &["--what", "both"]);
    assert_eq!(shape, [24, 64]);
    let ((_, target), _) = render("builtin:still-life", &SMALL[..6]);
    let ((_, own), _) = render("h.zarr", &["--what", "target"]);
    for row in 0..24 {
        let (left, right) = both[64 * row..64 * (row + 1)].split_at(32);
        for column in 0..32 {
            let (seen, wanted) = (image[32 * row + column] * exposure as f32, target[32 * row + column]);
            // `both` fits the exposure to the scene. The solve fitted the exposure of the file.
            assert!((left[column] - seen).abs() <= 0.05 * seen.abs() + 0.02, "{row} {column}");
            assert!((right[column] - wanted).abs() < 1e-5 && (own[32 * row + column] - wanted).abs() < 1e-5);
        }
    }
    // The image of a scene needs a solve.
    let set = ["--what", "image", "--set", "steps=1", "--set", "frames=1"];
    let ((shape, solved), _) = render("builtin:still-life", &[&SMALL[..6], &set].concat());
    assert!(shape == [24, 32] && solved.iter().zip(&target).any(|(a, b)| (a - b).abs() > 0.01));
    let code = refusal(at, &["render", "h.zarr", "-o", "x.png"]).code;
    assert_eq!(code, "usage/missing-required-argument", "neither a pupil nor a path");
}

#[test]
fn info_names_the_kind_of_a_file() {
    let temp = folder();
    let at = temp.path();
    solve(at, &["-o", "h.zarr"]);
    solve(at, &["builtin:plane", "-o", "s.zarr"]);
    done(at, &["encode", "h.zarr", "-o", "frames"]);
    done(at, &["convert", "h.zarr", "phases.npy"]);
    done(at, &["tracker", "record", "simulated:3", "--duration", "0.5", "-o", "eye.jsonl"]);
    let display = ["--display", "paper", "--size", "24x32", "--color", "green"];
    for (words, kind) in [
        (&["h.zarr"][..], "a hologram"),
        (&["s.zarr"], "a sequence"),
        (&["frames"], "video frames"),
        (&[&["phases.npy"][..], &display].concat(), "phases"),
        (&["eye.jsonl"], "recording"),
        (&["headset"], "display"),
    ] {
        let report = json(at, &[&["info"][..], words, &["--json"]].concat());
        assert_eq!(report["kind"], kind, "{words:?}: {report}");
        assert!(!done(at, &[&["info"][..], words].concat()).is_empty());
        if kind == "recording" {
            let [samples, rate] = ["samples", "rate_hz"].map(|key| report[key].as_f64().unwrap());
            assert!((50.0..70.0).contains(&samples) && (rate - 120.0).abs() < 2.0, "{report}");
        } else if kind != "display" {
            assert_eq!(report["size"], serde_json::json!([24, 32]), "{words:?}");
        }
    }
    assert_eq!(json(at, &["info", "s.zarr", "--json"])["holograms"], 2);
    // Without a display, phases have a size and no optics.
    let bare = json(at, &["info", "phases.npy", "--color", "green", "--json"]);
    assert!(bare["size"] == serde_json::json!([24, 32]) && bare["pitch_um"].is_null(), "{bare}");
    assert!(bare["colors"][0]["wavelength_nm"].is_null(), "{bare}");
    let scene = json(at, &[&["info", "builtin:plane"][..], &SMALL[..6], &["--json"]].concat());
    assert_eq!(scene["grid"], serde_json::json!([3, 3]));
}

/// An option that a film or a scene does not have is refused.
#[test]
fn options_of_one_picture_of_a_hologram_are_refused_elsewhere() {
    let temp = folder();
    for option in [&["--ideal"][..], &["--exposure", "2"], &["--at", "0"]] {
        let scene = ["render", "builtin:plane", "--size", "16", "--pupil=0,0,1,0", "-o", "x.png"];
        assert_eq!(refusal(temp.path(), &[&scene[..], option].concat()).code, "arguments/of-holograms");
        let film = ["render", "h.zarr", "--path", "p.json", "-o", "x"];
        assert_eq!(refusal(temp.path(), &[&film[..], option].concat()).code, "arguments/with-path");
    }
}

/// `convert` changes video frames back to phases, with an error of one level of the SLM at most.
#[test]
fn video_frames_become_phases_again() {
    let temp = folder();
    let at = temp.path();
    solve(at, &["-o", "h.zarr"]);
    done(at, &["convert", "h.zarr", "phases.npy"]);
    done(at, &["encode", "h.zarr", "-o", "frames"]);
    done(at, &["convert", "frames", "back.npy"]);
    let ((shape, phases), (again, back)) = (array(&at.join("phases.npy")), array(&at.join("back.npy")));
    assert_eq!(shape, again);
    let turn = std::f32::consts::TAU;
    let off = |(a, b): (&f32, &f32)| ((a - b + turn / 2.0).rem_euclid(turn) - turn / 2.0).abs();
    let most = phases.iter().zip(&back).map(off).fold(0.0, f32::max);
    assert!(most <= turn / 256.0, "{most}");
}

/// A software device runs the same kernels.
#[test]
fn a_device_is_tested_against_the_cpu() {
    let temp = folder();
    let report = json(temp.path(), &["device", "test", "--json"]);
    assert_eq!(report["right"], true, "{report}");
    assert!(report["phase_rms_rad"].as_f64().is_some_and(|rms| rms < 1e-4), "{report}");
}

#[test]
fn every_command_of_before_names_the_one_of_today() {
    let temp = folder();
    for (old, now) in [
        ("calibrate", "eyebox display calibrate"),
        ("devices", "eyebox device list"),
        ("displays", "eyebox display list"),
        ("evaluate", "eyebox eval compare"),
        ("export", "eyebox convert"),
        ("film", "eyebox render --path"),
        ("import", "eyebox convert"),
        ("inspect", "eyebox info"),
        ("live", "eyebox show --tracker"),
        ("monitors", "eyebox display monitors"),
        ("photograph", "eyebox render"),
        ("plan", "eyebox solve --dry-run"),
        ("play", "eyebox show"),
        ("score", "eyebox eval score"),
        ("study", "eyebox eval gaze"),
        ("tradeoff", "eyebox eval tune"),
        ("trackers", "eyebox tracker list"),
        ("view", "eyebox render"),
    ] {
        let refusal = refusal(temp.path(), &[old, "x"]);
        assert_eq!(refusal.code, "usage/invalid-subcommand", "{old}");
        assert!(refusal.message.contains(now), "{old}: {refusal:?}");
    }
}
