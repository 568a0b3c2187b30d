//! What people see: `score` in just-objectionable differences, as a user runs it.

use crate::common::{done, folder, refused};
use serde_json::Value;

fn scored(at: &std::path::Path, more: &[&str]) -> Value {
    let said = done(at, &[&["score", "h.zarr", "builtin:still-life", "--engine", "cpu", "--json"], more].concat());
    serde_json::from_str(&said).expect("one JSON object")
}

#[test]
fn a_score_says_what_people_see_and_where() {
    let temp = folder();
    let at = temp.path();
    let solve = ["solve", "builtin:still-life", "-o", "h.zarr", "--size", "40x48", "--steps", "3", "--frames", "2"];
    done(at, &[&solve[..], &["--engine", "cpu"]].concat());
    let mean = |score: &Value| score["jod"]["mean"].as_f64().expect("a JOD");
    let coarse = scored(at, &["--pupils", "random:3", "--pixels-per-degree", "20", "--jod-maps", "lost"]);
    let judged = |score: &Value| score["pupils"].as_array().unwrap().iter().filter(|p| !p["jod"].is_null()).count();
    assert_eq!((judged(&coarse), coarse["viewing"]["pixels_per_degree"].as_f64()), (3, Some(20.0)));
    assert!((0..3).all(|i| at.join(format!("lost/pupil-{i:04}.png")).is_file()));
    // Finer pixels show less, and the optics' own, 873 a degree, nearly nothing.
    let fine = scored(at, &["--pupils", "random:3", "--pixels-per-degree", "80"]);
    let own = scored(at, &["--pupils", "random:3"]);
    assert!(mean(&coarse) < mean(&fine) && mean(&fine) < mean(&own) && mean(&own) > 9.0, "{coarse} {fine} {own}");
    // Sub-frames that flicker are worse than their mean.
    let flicker = scored(at, &["--pupils", "random:3", "--pixels-per-degree", "20", "--sub-frame-rate", "60"]);
    assert!(mean(&flicker) < mean(&coarse), "{flicker} {coarse}");
    // Some of many, all of them, none.
    assert_eq!(judged(&scored(at, &["--pupils", "random:20"])), 16);
    assert_eq!(judged(&scored(at, &["--pupils", "random:20", "--jod"])), 20);
    let none = scored(at, &["--pupils", "random:2", "--no-jod"]);
    assert!(judged(&none) == 0 && none["jod"].is_null() && none["pupils"][0]["psnr_db"].is_number());
    let score = ["score", "h.zarr", "builtin:still-life"];
    refused(at, &[&score[..], &["--black", "300"]].concat(), "x", "black in cd/m2 is 300: it must be 0 to 200");
    refused(at, &[&score[..], &["--no-jod", "--jod-maps", "x"]].concat(), "x", "cannot be used with");
}
