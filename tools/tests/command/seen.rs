//! `eval score` in just-objectionable differences and the film of `render --path`, as a user runs them.

use crate::common::{Printed, done, folder, refused};
use serde_json::Value;

fn scored(at: &std::path::Path, more: &[&str]) -> Value {
    let said =
        done(at, &[&["eval", "score", "h.zarr", "builtin:still-life", "--engine", "cpu", "--json"], more].concat());
    serde_json::from_str(&said).expect("one JSON object")
}

#[test]
fn a_score_says_what_people_see_and_where() {
    let temp = folder();
    let at = temp.path();
    let solve = ["solve", "builtin:still-life", "-o", "h.zarr", "--size", "40x48", "--steps", "3", "--frames", "2"];
    done(at, &[&solve[..], &["--engine", "cpu"]].concat());
    let mean = |score: &Value| score["jod"]["mean"].as_f64().expect("a JOD");
    let coarse =
        scored(at, &["--test-pupils", "random:3", "--set", "viewing.pixels_per_degree=20", "--jod-maps", "lost"]);
    let judged = |score: &Value| score["pupils"].as_array().unwrap().iter().filter(|p| !p["jod"].is_null()).count();
    assert_eq!((judged(&coarse), coarse["viewing"]["pixels_per_degree"].as_f64()), (3, Some(20.0)));
    assert!((0..3).all(|i| at.join(format!("lost/pupil-{i:04}.png")).is_file()));
    // Finer pixels show less. The pixels of the optics, 873 per degree, show nearly nothing.
    let fine = scored(at, &["--test-pupils", "random:3", "--set", "viewing.pixels_per_degree=80"]);
    let own = scored(at, &["--test-pupils", "random:3"]);
    assert!(mean(&coarse) < mean(&fine) && mean(&fine) < mean(&own) && mean(&own) > 9.0, "{coarse} {fine} {own}");
    // Sub-frames that flicker are worse than their mean.
    let flicker =
        scored(at, &["--test-pupils", "random:3", "--set", "viewing.pixels_per_degree=20", "--sub-frame-rate", "60"]);
    assert!(mean(&flicker) < mean(&coarse), "{flicker} {coarse}");
    // `--jod` judges some of many pupils, all of them, or none.
    assert_eq!(judged(&scored(at, &["--test-pupils", "random:20"])), 16);
    assert_eq!(judged(&scored(at, &["--test-pupils", "random:20", "--jod", "all"])), 20);
    let none = scored(at, &["--test-pupils", "random:2", "--jod", "none"]);
    assert!(judged(&none) == 0 && none["jod"].is_null() && none["pupils"][0]["psnr_db"].is_number());
    let score = ["eval", "score", "h.zarr", "builtin:still-life"];
    refused(at, &[&score[..], &["--set", "viewing.black=300"]].concat(), "x", "optics/viewing/range cd/m2 300 200");
    refused(at, &[&score[..], &["--jod", "none", "--jod-maps", "x"]].concat(), "x", "arguments/jod-none");
}

/// The score of the part at the gaze is printed, and stored next to the score of the whole picture.
#[test]
fn the_part_that_the_eye_looks_at_has_a_score() {
    let temp = folder();
    let at = temp.path();
    let solve =
        ["solve", "builtin:still-life", "--size", "96x96", "--color", "green", "--steps", "24", "--frames", "2"];
    done(at, &[&solve[..], &["--pupil-diameter", "6..20", "--engine", "cpu", "-o", "h.zarr"]].concat());
    let looks = [
        "--test-pupils",
        "random:4",
        "--pupil-diameter",
        "8..20",
        "--set",
        "viewing.pixels_per_degree=8",
        "--gaze=-3,-2",
    ];
    let scores = scored(at, &looks);
    assert!(scores["jod_there"]["mean"].as_f64() > Some(0.0), "{scores}");
    let score =
        ["eval", "score", "h.zarr", "builtin:still-life", "--set", "viewing.pixels_per_degree=8", "--engine", "cpu"];
    let past = [&score[..], &["--test-pupils", "random:1", "--gaze", "30,0"]].concat();
    refused(at, &past, "x", "evaluate/jod/gaze-at-the-edge 12.0");
    let said = done(at, &[&score[..], &["--test-pupils", "random:1", "--gaze", "2,-1.5"]].concat());
    assert!(said.has_sequence(&[2.0, -1.5]), "{said}");
}

/// Returns the number after a letter in the first line of a Y4M file.
fn word(head: &str, letter: char) -> usize {
    head.split(' ').find_map(|w| w.strip_prefix(letter)?.parse().ok()).expect("a number")
}

#[test]
fn a_film_follows_the_eye() {
    let temp = folder();
    let at = temp.path();
    let solve = ["solve", "builtin:still-life", "-o", "h.zarr", "--size", "40x48", "--steps", "3", "--engine", "cpu"];
    done(at, &solve);
    let path = r#"{"rate_hz": 10, "keys": [{"t_s": 0, "x_mm": -4}, {"t_s": 0.5, "x_mm": 4, "focus": 0.3}, {"t_s": 1}], "blinks_s": [0.6]}"#;
    std::fs::write(at.join("path.json"), path).unwrap();
    let film = |what: &str, out: &str, more: &[&str]| {
        let args =
            [&["render", what, "--path", "path.json", "-o", out, "--engine", "cpu", "--json"][..], more].concat();
        serde_json::from_str::<Value>(&done(at, &args)).expect("one JSON object")
    };
    let made = film("h.zarr", "a.y4m", &[]);
    // The pictures are next to each other with one column between them. Five of the eleven frames repeat the frame
    // before.
    assert_eq!(
        (&made["size"], &made["frames"], &made["looked"]),
        (&serde_json::json!([40, 97]), &11.into(), &6.into())
    );
    let bytes = std::fs::read(at.join("a.y4m")).unwrap();
    let head = std::str::from_utf8(&bytes[..bytes.iter().position(|b| *b == b'\n').unwrap()]).unwrap();
    assert_eq!((word(head, 'W'), word(head, 'H')), (97, 40));
    assert_eq!(bytes.len(), head.len() + 1 + 11 * (6 + 3 * 97 * 40));
    film("h.zarr", "b.y4m", &[]);
    assert_eq!(bytes, std::fs::read(at.join("b.y4m")).unwrap());
    assert_eq!(film("h.zarr", "alone", &["--what", "image", "--binning", "2"])["size"], serde_json::json!([20, 24]));
    assert_eq!(std::fs::read_dir(at.join("alone")).unwrap().count(), 11);
    // A scene is solved first.
    film("builtin:plane", "plane.y4m", &["--size", "40x48", "--color", "green", "--quality", "fast"]);
    // Errors are reported before anything is written.
    std::fs::write(at.join("bad.json"), r#"{"keys": [{"t_s": 0, "x": 1}]}"#).unwrap();
    let bad = |path: &'static str, out: &'static str| ["render", "h.zarr", "--path", path, "-o", out];
    refused(at, &bad("bad.json", "c.y4m"), "c.y4m", "film/path `x`");
    refused(at, &bad("none.json", "c.y4m"), "c.y4m", "film/path none.json");
    refused(at, &bad("path.json", "c.mp4"), "c.mp4", "arguments/film NAME.y4m");
    refused(at, &["render", "none.zarr", "--path", "path.json", "-o", "c.y4m"], "c.y4m", "file/read none.zarr");
}
