//! Views in an order that differs from their names, and their depths, in the commands that refine and show.

use crate::common::{Printed, done, folder, made, refused};
#[cfg(target_os = "linux")]
use crate::common::{command, desk::Desk};
use serde_json::Value;
use std::path::Path;
#[cfg(target_os = "linux")]
use std::time::{Duration, Instant};

const STILL_LIFE: &str = "builtin:still-life?span=0.7";
const SMALL: [&str; 6] = ["--size", "64x64", "--color", "green", "--engine", "cpu"];

/// Writes the same views twice, once in the order of their names and once with rows that run upward.
fn both(at: &Path) {
    made::views(&at.join("right"), STILL_LIFE, |r, c| [r, c]);
    made::views(&at.join("upwards"), STILL_LIFE, |r, c| [2 - r, c]);
}

#[test]
fn a_study_steers_by_views_in_the_order_that_is_stated() {
    let temp = folder();
    let at = temp.path();
    both(at);
    let solve = ["solve", "right", "-o", "h.zarr", "--steps", "8", "--order", "as-named"];
    done(at, &[&solve[..], &SMALL].concat());
    let study = |scene: &[&str], out: &str| -> Value {
        let words = ["eval", "gaze", "h.zarr", "--display", "planes8", "--force", "--duration", "0.5", "--json"];
        let time = ["--set", "gaze.step_time=4", "--engine", "cpu", "-o", out, "--scene"];
        let said: Value = serde_json::from_str(&done(at, &[&words[..], &time, scene].concat())).expect("one object");
        assert!(said["summary"]["steps"].as_u64().expect("a number") > 0, "{said}");
        said["summary"].clone()
    };
    let right = study(&["right"], "a");
    assert_eq!(study(&["upwards", "--order", "flip-rows"], "b"), right);
    assert_ne!(study(&["upwards", "--order", "as-named"], "c"), right);
}

/// Returns the picture that `show` with a tracker puts on the display for a scene without refinement. The result is the
/// same on every machine.
fn shown(at: &Path, scene: &[&str], out: &str) -> Vec<u8> {
    let show = ["show", "--tracker", "simulated", "--display", "planes8", "--unsteered", "--quality", "fast"];
    done(at, &[&show[..], &["--duration", "0.2", "--record", out], &SMALL, scene].concat());
    let recorded = std::fs::read_to_string(at.join(out).join("shown.csv")).expect("what was shown");
    let set = recorded.lines().find_map(|row| Some(&row[row.find("set-")?..])).expect("a set");
    std::fs::read(at.join(out).join(set)).expect("its picture")
}

#[test]
fn show_takes_views_in_the_order_that_is_stated() {
    let temp = folder();
    let at = temp.path();
    both(at);
    let show = |scene: &[&'static str], out| shown(at, &[scene, &["--depth=-1..1"]].concat(), out);
    let right = show(&["right"], "a");
    assert_eq!(show(&["upwards", "--order", "flip-rows"], "b"), right);
    assert_ne!(show(&["upwards", "--order", "as-named"], "c"), right);
    refused(
        at,
        &[&["show", "upwards", "--tracker", "simulated", "--display", "planes8"][..], &SMALL].concat(),
        "x",
        "scene/order/moves-otherwise --order",
    );
}

/// Rows in folders of their own look like the frames of a sequence.
#[test]
fn a_folder_of_rows_is_one_light_field_or_a_sequence_as_is_said() {
    let temp = folder();
    let at = temp.path();
    made::views(&at.join("flat"), STILL_LIFE, |r, c| [r, c]);
    for i in 0..9 {
        std::fs::create_dir_all(at.join(format!("rows/row_{}", i / 3))).unwrap();
        let [from, to] = ["flat/view_{}_{}.png", "rows/row_{}/view_{}.png"]
            .map(|name| name.replacen("{}", &(i / 3).to_string(), 1).replacen("{}", &(i % 3).to_string(), 1));
        std::fs::copy(at.join(from), at.join(to)).unwrap();
    }
    let solve = |scene: &[&'static str], out| {
        [
            &["solve", "-o", out, "--steps", "2", "--frames", "1", "--depth=-1..1", "--order", "as-named"],
            &SMALL[..],
            scene,
        ]
        .concat()
    };
    let phases = |name: &str| {
        done(at, &["convert", name, "p.npy"]);
        std::fs::read(at.join("p.npy")).unwrap()
    };
    for command in [&["solve", "rows"][..], &["info", "rows"], &["solve", "rows", "--dry-run"]] {
        refused(at, &[command, &SMALL[..4]].concat(), "hologram.zarr", "scene/rows");
    }
    done(at, &solve(&["flat"], "flat.zarr"));
    // A hologram is refused as a scene, and a scene as a hologram.
    refused(at, &["solve", "flat.zarr"], "x.zarr", "scene/corrupt/hologram-not-scene flat.zarr");
    refused(at, &["encode", "builtin:plane", "--display", "paper", "-o", "x"], "x", "hologram/not-a-hologram/scene");
    refused(at, &["render", "none.npy", "--pupil=0,0,4,0", "-o", "x.png"], "x.png", "file/read");
    std::fs::write(at.join("rows/lightfield.toml"), "files = \"*/*\"\n").unwrap();
    done(at, &solve(&["rows"], "rows.zarr"));
    assert_eq!(phases("rows.zarr"), phases("flat.zarr"));
    // Rows with files that describe light fields are frames.
    std::fs::remove_file(at.join("rows/lightfield.toml")).unwrap();
    (0..3).for_each(|r| std::fs::write(at.join(format!("rows/row_{r}/lightfield.toml")), "grid = [1, 3]\n").unwrap());
    done(at, &[solve(&["rows"], "moving.zarr"), vec!["--rate", "5"]].concat());
    done(at, &["convert", "moving.zarr", "p.npy", "--at", "2"]);
    // A missing view next to a folder of views does not make a sequence of that folder.
    std::fs::create_dir(at.join("flat/more")).unwrap();
    std::fs::copy(at.join("flat/view_0_0.png"), at.join("flat/more/view_0_0.png")).unwrap();
    std::fs::remove_file(at.join("flat/view_1_2.png")).unwrap();
    refused(at, &solve(&["flat"], "x.zarr"), "x.zarr", "scene/missing-view view_1_2.png");
}

/// Blades hide each other by pixels from view to view, so that their depths cannot be measured.
#[test]
fn show_solves_for_the_depths_that_are_stated() {
    let temp = folder();
    let at = temp.path();
    made::views(&at.join("grass"), "builtin:dense-grass?span=2", |r, c| [r, c]);
    let asked =
        [&["show", "grass", "--tracker", "simulated", "--display", "planes8", "--order", "as-named"][..], &SMALL]
            .concat();
    refused(at, &asked, "x", "scene/depth --depth depth_mm lightfield.toml");
    let grass = |more: &[&'static str], out| shown(at, &[&["grass", "--order", "as-named"], more].concat(), out);
    let [near, far] = [grass(&["--depth=0..2"], "a"), grass(&["--depth=-2..0"], "b")];
    assert_ne!(near, far);
    std::fs::write(at.join("grass/lightfield.toml"), "depth_mm = [0, 2]\n").unwrap();
    assert_eq!(grass(&[], "c"), near);
}

/// The title has the PSNR against the target image of the views in the stated order.
#[test]
#[cfg(target_os = "linux")]
fn a_preview_compares_with_views_in_the_order_that_is_stated() {
    let temp = folder();
    let at = temp.path();
    both(at);
    let solve = ["solve", "right", "-o", "h.zarr", "--steps", "8", "--order", "as-named"];
    done(at, &[&solve[..], &SMALL].concat());
    let decibels = |scene: &[&str]| {
        // Each preview has a desktop of its own, because the window of a program that was killed stays for a moment.
        let desk = Desk::new(at, [720, 900]);
        let preview = ["preview", "h.zarr", "--engine", "cpu", "--pupil=0,7,10,0.6", "--force", "--scene"];
        let mut child = command(at, &[&preview[..], scene].concat())
            .env("DISPLAY", desk.name())
            .env_remove("WAYLAND_DISPLAY")
            .spawn()
            .expect("it starts");
        let window = desk.window("h.zarr");
        // The mouse moves the pupil down, because the order of the rows is visible there.
        desk.point(window, [520, 320]);
        let since = Instant::now();
        let decibels = loop {
            let title = desk.title(window);
            let is_there = title.numbers().windows(2).any(|place| place[0] == 0.5 && (7.0..8.0).contains(&place[1]));
            if is_there && title.has("dB") {
                break title.number("dB");
            }
            assert!(since.elapsed() < Duration::from_secs(60), "{title}");
            std::thread::sleep(Duration::from_millis(20));
        };
        child.kill().and_then(|()| child.wait()).expect("its end");
        decibels
    };
    let right = decibels(&["right"]);
    assert_eq!(decibels(&["upwards", "--order", "flip-rows"]), right);
    assert_ne!(decibels(&["upwards", "--order", "as-named"]), right);
    refused(at, &["preview", "h.zarr", "--order", "flip-rows"], "x", "arguments/scene-options-without-scene --scene");
}
