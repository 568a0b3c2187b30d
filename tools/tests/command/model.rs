//! A display file with a model, from the solve to the picture.

use crate::common::{Printed, done, eyebox, folder, refused, text};
use eyebox::low_level::files::read_npy;

const BENCH: &str =
    "resolution = [48, 48]\npitch_um = 8.0\nfocal_length_mm = 400.0\nwavelengths_nm = { green = 520 }\n";
const MODEL: &str = "[model.green]\ncrosstalk = [[1.2, 2.03], [1.2, 2.03], [1.2, 2.03], [1.2, 2.03]]\nfill = 0.95\n\
                     undiffracted = [0.2, 0, 0, 0, 0]\nwavefront = { 4 = 0.1 }\niris = [0.1, 0, 1.01]\n";

/// Returns the mean PSNR that `eval score --json` prints, in dB.
fn decibels(text: &str) -> f64 {
    serde_json::from_str::<serde_json::Value>(text).unwrap()["psnr_db"]["mean"].as_f64().unwrap()
}

/// A hologram stores the model for which it was solved, and its views use this model.
#[test]
fn what_a_hologram_is_solved_for_is_what_it_is_looked_at_through() {
    let dir = folder();
    let at = dir.path();
    std::fs::write(at.join("ideal.toml"), BENCH).unwrap();
    std::fs::write(at.join("real.toml"), format!("{BENCH}{MODEL}")).unwrap();
    let solve = |display: &str, out: &str| {
        let settings = ["--steps", "12", "--frames", "4", "--engine", "cpu"];
        done(at, &[&["solve", "builtin:still-life", "--display", display][..], &settings, &["-o", out]].concat());
    };
    solve("real.toml", "real.zarr");
    solve("ideal.toml", "ideal.zarr");
    let view = |hologram: &str, out: &str, more: &[&str]| {
        let pupil = ["--pupil", "1,-1,6,0", "--engine", "cpu", "-o", out];
        let answer = eyebox(at, &[&["render", hologram][..], &pupil, more].concat());
        assert!(answer.status.success(), "{}", text(&answer.stderr));
        (read_npy(&at.join(out)).unwrap().values, text(&answer.stderr))
    };
    let (real, said) = view("real.zarr", "real.npy", &[]);
    assert!(said.has("crosstalk fill iris undiffracted wavefront --ideal"), "{said}");
    let (past, said) = view("real.zarr", "past.npy", &["--ideal"]);
    assert!(!said.has("--ideal") && real != past, "{said}");
    // For a display without a model, `--ideal` makes no difference.
    assert!(view("ideal.zarr", "a.npy", &[]).0 == view("ideal.zarr", "b.npy", &["--ideal"]).0);
    let score = |hologram: &str, more: &[&str]| {
        let pupils = ["builtin:still-life", "--json", "--engine", "cpu"];
        decibels(&done(at, &[&["eval", "score", hologram][..], &pupils, more].concat()))
    };
    // The hologram was solved for the display with its faults, and not for the ideal display.
    assert!(score("real.zarr", &[]) > score("real.zarr", &["--ideal"]) + 1.0);
    // A refinement uses the same model.
    let refine = ["refine", "real.zarr", "builtin:still-life", "--pupil=1,-1,4,0", "--steps", "2", "--engine", "cpu"];
    done(at, &[&refine[..], &["-o", "refined.zarr"]].concat());
    assert!(view("refined.zarr", "c.npy", &[]).1.has("crosstalk"));
}

/// A plan reports the work that each term adds to a step. For a display without a model it has no such entry.
#[test]
fn a_plan_says_what_each_term_takes() {
    let dir = folder();
    let at = dir.path();
    std::fs::write(at.join("ideal.toml"), BENCH).unwrap();
    std::fs::write(at.join("real.toml"), format!("{BENCH}{MODEL}")).unwrap();
    let work = |display: &str| {
        let plan = ["solve", "builtin:still-life", "--dry-run", "--display", display, "--engine", "cpu", "--json"];
        let said: serde_json::Value = serde_json::from_str(&done(at, &plan)).unwrap();
        said["model_work"].clone()
    };
    assert_eq!(work("ideal.toml"), serde_json::json!([]));
    let terms = work("real.toml")[0]["share_of_ideal_step"].clone();
    let share = |name: &str| {
        let found = terms.as_array().unwrap().iter().find(|t| t[0] == name);
        found.unwrap_or_else(|| panic!("{terms}"))[1].as_f64().unwrap()
    };
    assert!(share("crosstalk") > share("undiffracted") && share("undiffracted") > 0.0, "{terms}");
    assert!(share("iris").abs() < 0.1 && share("all") >= share("crosstalk"), "{terms}");
}

/// A plan reports the value of each term, and `--model-terms` selects the terms of a solve.
#[test]
fn terms_are_chosen() {
    let dir = folder();
    let at = dir.path();
    std::fs::write(at.join("real.toml"), format!("{BENCH}{MODEL}lag = 0.0001\n")).unwrap();
    let scene = ["builtin:still-life", "--display", "real.toml", "--engine", "cpu", "--frames", "2"];
    let plan = done(at, &[&["solve"], &scene[..], &["--dry-run", "--json"]].concat());
    let said: serde_json::Value = serde_json::from_str(&plan).unwrap();
    let worth = &said["model_worth"][0];
    let lost = worth["measured"]["lost_db"].as_array().unwrap();
    let of = |name: &str| lost.iter().find(|t| t[0] == name).unwrap_or_else(|| panic!("{worth}"))[1].as_f64().unwrap();
    assert!(of("crosstalk") > 0.2 && of("lag").abs() < 0.05, "{worth}");
    let auto = worth["auto"].as_array().unwrap();
    assert!(auto.contains(&"crosstalk".into()) && !auto.contains(&"lag".into()), "{worth}");
    let words = done(at, &[&["solve"], &scene[..], &["--dry-run"]].concat());
    // The line with the decibels names the term that is left out and the size of the measurement.
    assert!(
        words.lines().any(|line| line.has("--model-terms lag crosstalk dB") && line.has_sequence(&[48.0, 48.0])),
        "{words}"
    );
    // A view uses the terms for which the hologram was solved.
    let solved_for = |terms: &str| {
        let out = format!("{}.zarr", terms.replace(',', "-"));
        let more = ["--steps", "1", "--model-terms", terms, "-o", &out];
        done(at, &[&["solve"], &scene[..], &more].concat());
        let view = ["render", &out, "--pupil", "1,-1,6,0", "--engine", "cpu", "-o", "v.npy"];
        let answer = eyebox(at, &view);
        assert!(answer.status.success(), "{}", text(&answer.stderr));
        text(&answer.stderr)
    };
    let said = solved_for("crosstalk,fill");
    assert!(said.has("crosstalk fill") && !said.has("wavefront"), "{said}");
    let said = solved_for("auto");
    assert!(said.has("crosstalk") && !said.has("lag"), "{said}");
    assert!(solved_for("all").has("lag") && !solved_for("none").has("crosstalk"));
    let wrong = [&["solve"], &scene[..], &["--model-terms", "cross", "-o", "h.zarr"]].concat();
    refused(at, &wrong, "h.zarr", "usage/value-validation");
}

/// If the eye sees the picture of a display distorted, the display shows it with the inverse distortion. A view is the
/// picture that the eye sees.
#[test]
fn a_picture_is_shown_where_it_is_seen() {
    let dir = folder();
    let at = dir.path();
    let identity = "homography = [1, 0, 0, 0, 1, 0, 0, 0]";
    let with = |distortion: &str| format!("{BENCH}[picture.green]\n{identity}\ndistortion = {distortion}\n");
    std::fs::write(at.join("bent.toml"), with("[0.3, 0]")).unwrap();
    std::fs::write(at.join("folded.toml"), with("[-1, 0]")).unwrap();
    let settings = ["--steps", "20", "--frames", "8", "--pupil-diameter", "4..10", "--engine", "cpu"];
    let solve =
        |display, out| [&["solve", "builtin:still-life", "--display", display, "-o", out][..], &settings].concat();
    done(at, &solve("bent.toml", "bent.zarr"));
    let view = |out: &str, more: &[&str]| {
        let view = ["render", "bent.zarr", "--pupil", "0,0,10,0", "--engine", "cpu", "-o", out];
        let answer = eyebox(at, &[&view[..], more].concat());
        assert!(answer.status.success(), "{}", text(&answer.stderr));
        (read_npy(&at.join(out)).unwrap().values, text(&answer.stderr))
    };
    let ((seen, said), (shown, past)) = (view("seen.npy", &[]), view("shown.npy", &["--ideal"]));
    assert!(said.has("--ideal") && !past.has("--ideal"), "{said}");
    let photograph = ["render", "builtin:still-life", "--display", "bent.toml", "--engine", "cpu"];
    done(at, &[&photograph[..], &["--pupil", "0,0,10,0", "-o", "scene.npy"]].concat());
    let scene = read_npy(&at.join("scene.npy")).unwrap().values;
    // The seen picture is the scene, and the shown picture is not. At the edges, some of the scene has left the
    // display.
    let middle = |v: &[f32]| {
        let values: Vec<f32> = (8..40).flat_map(|row| v[48 * row + 8..48 * row + 40].to_vec()).collect();
        let mean = values.iter().sum::<f32>() / values.len() as f32;
        values.iter().map(|v| v - mean).collect::<Vec<f32>>()
    };
    let scene = middle(&scene);
    let unlike = |view: &[f32]| {
        let view = &middle(view);
        let dot = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| f64::from(a * b)).sum::<f64>();
        1.0 - dot(view, &scene) / (dot(view, view) * dot(&scene, &scene)).sqrt()
    };
    assert!(unlike(&seen) < 0.6 * unlike(&shown), "{} {}", unlike(&seen), unlike(&shown));
    refused(at, &solve("folded.toml", "h.zarr"), "h.zarr", "optics/display-file/picture-folds [picture.green]");
}

/// A term without meaning in the far field is refused, and not left out.
#[test]
fn a_fill_in_the_far_field_is_refused() {
    let dir = folder();
    let far = format!("{BENCH}geometry = \"far-field\"\n[model.green]\nfill = 0.95\n");
    std::fs::write(dir.path().join("far.toml"), far).unwrap();
    let solve = ["solve", "builtin:still-life", "--display", "far.toml", "-o", "h.zarr"];
    refused(dir.path(), &solve, "h.zarr", "optics/display-file/model-far-field");
    let far = format!("{BENCH}geometry = \"far-field\"\n[model.green]\nsubpixels = 2\n");
    std::fs::write(dir.path().join("far.toml"), far).unwrap();
    refused(dir.path(), &solve, "h.zarr", "optics/display-file/model-far-field");
    std::fs::write(dir.path().join("far.toml"), format!("{BENCH}[model.green]\nsubpixels = 4\n")).unwrap();
    refused(dir.path(), &solve, "h.zarr", "optics/display-file/model-range");
}
