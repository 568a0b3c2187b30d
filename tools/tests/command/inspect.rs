//! `eyebox info`, and the order of views, as a user sees them.

use crate::common::{Printed, done, folder, refused};
use serde_json::Value;

const SIZE: [&str; 4] = ["--size", "64x64", "--color", "green"];

#[test]
fn a_scene_is_inspected_and_a_reversed_axis_is_refused_until_it_is_stated() {
    let temp = folder();
    let at = temp.path();
    std::fs::create_dir(at.join("views")).unwrap();
    // The rows of these views run upward.
    for i in 0..9 {
        let (x, y) = ((i % 3 - 1) * 7, (1 - i / 3) * 7);
        let (pupil, out) = (format!("--pupil={x},{y},2,0"), format!("views/view_{}_{}.png", i / 3, i % 3));
        let scene = ["render", "builtin:still-life?span=0.7", "--views", "3", &pupil, "-o", &out, "--engine", "cpu"];
        done(at, &[&scene[..], &SIZE].concat());
    }
    let info = |more: &[&str]| done(at, &[&["info", "views"][..], &SIZE, more].concat());
    let read = |text: &str| serde_json::from_str::<Value>(text).unwrap();
    let doubted = read(&info(&["--json"]));
    assert_eq!(
        (&doubted["grid"], &doubted["order_confirmed"]),
        (&Value::from(vec![3, 3]), &Value::from(false)),
        "{doubted}"
    );
    assert!(doubted["doubt"].as_str().unwrap().contains("--order flip-"), "{doubted}");
    let solve = [&["solve", "views", "-o", "x.zarr", "--steps", "1", "--engine", "cpu"][..], &SIZE].concat();
    refused(at, &solve, "x.zarr", "scene/order/moves-otherwise lightfield.toml");

    let text = info(&["--order", "flip-rows", "-o", "sheet.png"]);
    let found = read(&info(&["--order", "flip-rows", "--json"]));
    assert!(text.has("views 3 64 flip-rows green"), "{text}");
    for of in [&found["disparity_px"], &found["depth_mm"], &found["parallax_px"][0], &found["parallax_px"][1]] {
        let ends = [0, 1].map(|i| (of[i].as_f64().unwrap() * 100.0).round() / 100.0);
        assert!(text.has_sequence(&ends), "{ends:?}: {text}");
    }
    for number in [&found["aliasing_px"], &found["view_pitch_mm"]] {
        assert!(text.has(&format!("{:.2}", number.as_f64().unwrap())), "{number}: {text}");
    }
    let sheet = image::image_dimensions(at.join("sheet.png")).unwrap();
    assert_eq!(sheet, (3 * 66 - 2, 3 * 66 - 2));
    // The hologram stores the stated order.
    done(at, &[&solve[..], &["--order", "flip-rows"]].concat());
    done(at, &["eval", "score", "x.zarr", "views", "--test-pupils", "random:1", "--engine", "cpu"]);
    // If the folder's own file states the order, no option is needed.
    std::fs::write(at.join("views/lightfield.toml"), "flip_rows = true\n").unwrap();
    assert_eq!(read(&info(&["--json"]))["order"], "flip-rows");
    // `--photographs` selects the views from which target images are made. The plan and the hologram have this choice,
    // and a score uses it again.
    let plan = |how: &str| {
        let plan = ["solve", "views", "--dry-run", "--photographs", how, "--engine", "cpu", "--json"];
        let choices = read(&done(at, &[&plan[..], &SIZE].concat()))["choices"].clone();
        choices.as_array().unwrap().iter().find(|choice| choice["what"] == "photographs").cloned()
    };
    let [layers, cells] = ["layers", "cells"].map(plan);
    assert!(layers.is_some_and(|choice| choice["why"].as_str().unwrap().has_sequence(&[3.0, 3.0])) && cells.is_none());
    done(at, &[&solve[..], &["--photographs", "layers"]].concat());
    let settings = std::fs::read_to_string(at.join("x.zarr/zarr.json")).unwrap();
    let settings = &read(&settings)["attributes"]["eyebox"]["settings"];
    assert_eq!((&settings["photographs"], &settings["views"]), (&"layers".into(), &Value::from(vec![3, 3])));
    done(at, &["eval", "score", "x.zarr", "views", "--test-pupils", "random:1", "--engine", "cpu"]);
    for command in ["solve", "eval compare", "eval gaze", "show", "preview", "render"] {
        let words: Vec<_> = command.split(' ').chain(["views", "--order", "backwards"]).collect();
        refused(at, &words, "none", "usage/value-validation as-named");
    }
}

/// Blades hide each other by pixels from view to view, so that the views do not show their depths.
#[test]
fn depths_that_the_views_do_not_show_are_asked_for() {
    let temp = folder();
    let at = temp.path();
    std::fs::create_dir(at.join("views")).unwrap();
    for i in 0..9 {
        let (x, y) = ((i % 3 - 1) * 7, (i / 3 - 1) * 7);
        let (pupil, out) = (format!("--pupil={x},{y},2,0"), format!("views/view_{}_{}.png", i / 3, i % 3));
        let scene = ["render", "builtin:dense-grass?span=2", "--views", "3", &pupil, "-o", &out, "--engine", "cpu"];
        done(at, &[&scene[..], &SIZE].concat());
    }
    let asks = "scene/depth --depth depth_mm lightfield.toml";
    let info = |more: &[&str]| done(at, &[&["info", "views"][..], &SIZE, more].concat());
    let found: Value = serde_json::from_str(&info(&["--json"])).unwrap();
    assert!(found["doubt"].as_str().is_some_and(|doubt| doubt.contains("--depth")), "{found}");
    assert!(info(&[]).contains(found["doubt"].as_str().unwrap()), "{}", info(&[]));
    let steps = ["--steps", "1", "--frames", "1", "--engine", "cpu"];
    refused(
        at,
        &[&["solve", "views", "-o", "x.zarr", "--order", "as-named"][..], &SIZE, &steps].concat(),
        "x.zarr",
        asks,
    );
    refused(
        at,
        &[&["solve", "views", "builtin:plane", "--order", "as-named", "-o", "x.zarr"][..], &SIZE, &steps].concat(),
        "x.zarr",
        asks,
    );
    refused(
        at,
        &[
            &["eval", "compare", "views", "-o", "report", "--methods", "dpac", "--json", "--order", "as-named"][..],
            &SIZE,
        ]
        .concat(),
        "report/report.html",
        asks,
    );
    done(at, &[&["solve", "views", "--depth=-2..2", "-o", "x.zarr"][..], &SIZE, &steps].concat());
}
