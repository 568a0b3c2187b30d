//! Eyes with a prescription, from the solve to the picture.

use crate::common::{Printed, attributes, done, eyebox, folder, json, refused, text};
use eyebox::low_level::files::read_npy;

const BENCH: &str =
    "resolution = [64, 64]\npitch_um = 8.0\nfocal_length_mm = 400.0\nwavelengths_nm = { green = 520 }\n";

/// Returns the mean PSNR that `eval score --json` prints, in dB.
fn decibels(text: &str) -> f64 {
    serde_json::from_str::<serde_json::Value>(text).unwrap()["psnr_db"]["mean"].as_f64().unwrap()
}

/// Obstructions in the pupil cost a hologram of random phases little, compared with its view through a clear pupil.
/// They cost more if they stop more light. Without them nothing is compared, and an unknown name is refused with the
/// known names.
#[test]
fn a_score_says_what_an_obstruction_costs() {
    let dir = folder();
    let at = dir.path();
    std::fs::write(at.join("pupils.json"), "[[0, 0, 4, 0], [3, -2, 4, 0]]").unwrap();
    let solve = ["solve", "builtin:still-life", "--size", "96x96", "--color", "green", "--steps", "10", "-o", "h.zarr"];
    done(at, &[&solve[..], &["--engine", "cpu"]].concat());
    let score = |more: &[&str]| {
        let how =
            ["eval", "score", "h.zarr", "--test-pupils", "pupils.json", "--engine", "cpu", "--json", "--jod", "none"];
        serde_json::from_str::<serde_json::Value>(&done(at, &[&how[..], more].concat())).unwrap()
    };
    let clear = score(&[]);
    assert!(clear["against_clear_db"].is_null() && clear["pupils"][0]["against_clear_db"].is_null(), "{clear}");
    let of = |name: &str| {
        let score = score(&["--obstructed", name]);
        assert_ne!(score["psnr_db"], clear["psnr_db"], "{name}");
        let own: Vec<f64> = (0..2).map(|i| score["pupils"][i]["against_clear_db"].as_f64().unwrap()).collect();
        assert!((score["against_clear_db"]["mean"].as_f64().unwrap() - (own[0] + own[1]) / 2.0).abs() < 1e-9);
        own[0].min(own[1])
    };
    let [lashes, floaters, opacity, scratches] = ["lashes", "floaters", "opacity", "scratches"].map(of);
    assert!(lashes > 18.0 && lashes < opacity && opacity > 24.0, "{lashes} {opacity}");
    assert!(floaters > opacity - 3.0 && scratches > opacity - 3.0, "{floaters} {scratches}");
    let said = done(
        at,
        &["eval", "score", "h.zarr", "--test-pupils", "pupils.json", "--jod", "none", "--obstructed", "lashes"],
    );
    assert!(said.has(&format!("{lashes:.2}")), "{said}");
    refused(at, &["eval", "score", "h.zarr", "--obstructed", "nose"], "x", "usage/invalid-value");
}

/// A hologram stores the eye for which it was solved. Views use this eye unless an option states another.
#[test]
fn a_hologram_keeps_its_eye() {
    let dir = folder();
    let at = dir.path();
    std::fs::write(at.join("bench.toml"), BENCH).unwrap();
    std::fs::write(at.join("eye.toml"), "sphere = -0.1\n").unwrap();
    let solve = |out: &str, more: &[&str]| {
        let settings = [
            "--display",
            "bench.toml",
            "--steps",
            "10",
            "--frames",
            "4",
            "--pupil-diameter",
            "2..5",
            "--engine",
            "cpu",
        ];
        done(at, &[&["solve", "builtin:still-life"], &settings[..], &["-o", out], more].concat());
    };
    solve("plain.zarr", &[]);
    solve("near.zarr", &["--prescription", "-0.1"]);
    solve("file.zarr", &["--eye-file", "eye.toml"]);
    let view = |hologram: &str, out: &str, more: &[&str]| {
        let pupil = ["--pupil", "2,-1,4,0", "--engine", "cpu", "-o", out];
        let answer = eyebox(at, &[&["render", hologram][..], &pupil, more].concat());
        assert!(answer.status.success(), "{}", text(&answer.stderr));
        (read_npy(&at.join(out)).unwrap().values, text(&answer.stderr))
    };
    let (own, said) = view("near.zarr", "own.npy", &[]);
    assert!(said.has("-0.1 D --prescription none"), "{said}");
    let (perfect, said) = view("near.zarr", "perfect.npy", &["--prescription", "none"]);
    assert!(own != perfect && !said.has("-0.1"), "{said}");
    assert!(view("near.zarr", "said.npy", &["--prescription", "-0.1"]).0 == own);
    assert!(view("file.zarr", "file.npy", &[]).0 == own);
    // The power of a pair of spectacles is weaker at the eye.
    std::fs::write(at.join("spectacles.toml"), "sphere = -0.1\nvertex_mm = 14\n").unwrap();
    assert!(view("near.zarr", "far.npy", &["--eye-file", "spectacles.toml"]).0 != own);
    let (plain, _) = view("plain.zarr", "plain.npy", &[]);
    assert!(view("plain.zarr", "none.npy", &["--prescription", "none"]).0 == plain);
    let score = |hologram: &str, more: &[&str]| {
        let pupils = ["builtin:still-life", "--json", "--engine", "cpu", "--pupil-diameter", "2..5"];
        decibels(&done(at, &[&["eval", "score", hologram][..], &pupils, more].concat()))
    };
    let (kept, lost) = (score("near.zarr", &[]), score("plain.zarr", &["--prescription", "-0.1"]));
    assert!(kept > score("plain.zarr", &[]) - 0.5 && lost < kept, "{kept} {lost}");
    // A refinement keeps this eye unless an option states another.
    let refine = ["refine", "near.zarr", "builtin:still-life", "--pupil=2,-1,4,0", "--steps", "2", "--engine", "cpu"];
    done(at, &[&refine[..], &["-o", "refined.zarr"]].concat());
    assert!(view("refined.zarr", "refined.npy", &[]).1.has("-0.1 D"));
    let eye = |hologram: &str| attributes(&at.join(hologram))["settings"]["prescription"].clone();
    assert_eq!(eye("refined.zarr"), eye("near.zarr"));
    done(at, &[&refine[..], &["--prescription", "0.05 -0.1 90", "-o", "other.zarr"]].concat());
    assert!(view("other.zarr", "other.npy", &[]).1.has("0.05 -0.1 90"));
    assert_eq!(["sphere", "cylinder", "axis_deg"].map(|k| eye("other.zarr")[k].as_f64()), [0.05, -0.1, 90.0].map(Some));
}

/// The plan reports the eye, and the comparison of methods simulates it.
#[test]
fn a_plan_and_a_comparison_have_an_eye() {
    let dir = folder();
    let at = dir.path();
    std::fs::write(at.join("bench.toml"), format!("{BENCH}[prescription]\nsphere = -0.05\n")).unwrap();
    let plan = |more: &[&str]| {
        let plan = ["solve", "builtin:still-life", "--dry-run", "--display", "bench.toml", "--pupil-diameter", "2..5"];
        let plan = [&plan[..], &["--engine", "cpu"], more].concat();
        let said = done(at, &plan);
        let choices = json(at, &[&plan[..], &["--json"]].concat())["choices"].clone();
        let chosen = choices.as_array().unwrap().iter().find(|c| c["what"] == "eye");
        let chosen = chosen.map(|choice| choice["value"].as_str().unwrap().to_owned());
        assert!(chosen.iter().all(|eye| said.contains(eye)), "{chosen:?}: {said}");
        chosen
    };
    assert!(plan(&[]).is_some_and(|eye| eye.has("-0.05 D")) && plan(&["--prescription", "none"]).is_none());
    let evaluate = |out: &str, more: &[&str]| {
        let settings =
            ["--methods", "slfh", "--steps", "3", "--frames", "2", "--engine", "cpu", "--pupil-diameter", "2..5"];
        let evaluate = [
            "eval",
            "compare",
            "builtin:still-life",
            "--display",
            "bench.toml",
            "--set",
            "compare.speckle=false",
            "-o",
            out,
        ];
        done(at, &[&evaluate[..], &settings, more].concat())
    };
    let own = evaluate("out", &[]);
    // Results for one eye are not used for another.
    assert!(evaluate("out", &["--prescription", "none"]) != own);
}

/// The simulated eye of a study is the eye of the hologram or another one. Views and refinements are for this eye.
#[test]
fn a_study_follows_an_eye_with_its_prescription() {
    let dir = folder();
    let at = dir.path();
    let solve =
        ["solve", "builtin:still-life", "--size", "64x72", "--color", "green", "--steps", "8", "--engine", "cpu"];
    done(at, &[&solve[..], &["--prescription", "-0.1", "--pupil-diameter", "2..5", "-o", "h.zarr"]].concat());
    let study = |out: &str, more: &[&str]| {
        let study = [
            "eval",
            "gaze",
            "h.zarr",
            "--display",
            "planes8",
            "--duration",
            "0.5",
            "--set",
            "gaze.step_time=4",
            "--engine",
            "cpu",
        ];
        done(at, &[&study[..], &["-o", out], more].concat());
        let all = std::fs::read(at.join(out).join("study.json")).unwrap();
        let all: serde_json::Value = serde_json::from_slice(&all).unwrap();
        let moments = all["study"]["moments"].as_array().unwrap();
        let mean = |key: &str| moments.iter().map(|m| m[key].as_f64().unwrap()).sum::<f64>() / moments.len() as f64;
        [mean("whole_db"), mean("steered_db")]
    };
    let ([own, own_steered], [other, other_steered]) = (study("own", &[]), study("other", &["--prescription", "none"]));
    assert!(own > other + 1.0, "{own} dB and {other}");
    assert!(own_steered > own && other_steered > other + 0.5, "{own_steered} dB and {other_steered}");
}

#[test]
fn eyes_that_cannot_be_are_refused() {
    let dir = folder();
    let at = dir.path();
    std::fs::write(at.join("bench.toml"), BENCH).unwrap();
    let solve = |more: &[&str], says: &str| {
        let solve = ["solve", "builtin:still-life", "--display", "bench.toml", "--engine", "cpu", "-o", "h.zarr"];
        refused(at, &[&solve[..], more].concat(), "h.zarr", says);
    };
    solve(&["--prescription", "-2 -0.5"], "usage/value-validation");
    solve(&["--prescription", "-2", "--pupil-diameter", "2..8"], "optics/blur 0.32");
    solve(&["--prescription", "-0.02", "--method", "dpac", "--pupil-diameter", "2..4"], "solve/setting prescription");
    for (text, says) in [
        ("sphere = -100\n", "optics/prescription/range -40 40"),
        ("sphere = 0\nzernikes_um = { 7 = 0.1 }\n", "optics/prescription/zernikes-without-diameter measured_mm"),
        ("zernikes_um = { 1 = 0.1 }\nmeasured_mm = 6\n", "optics/prescription/polynomial"),
        ("spere = 1\n", "optics/prescription/toml"),
    ] {
        std::fs::write(at.join("eye.toml"), text).unwrap();
        solve(&["--eye-file", "eye.toml"], says);
    }
    solve(&["--eye-file", "nothing.toml"], "optics/prescription nothing.toml");
}
