//! A phase light modulator with a simulated controller, in `show`, `display connect` and `display check`.

use crate::common::{command, done, eyebox, folder, json, refusal, text, with_json_errors};
use serde_json::{Value, json};
use std::io::Write;
use std::path::Path;
use std::process::Stdio;

/// Writes a small PLM with a simulated controller.
fn bench(at: &Path, link: &str) {
    let base = done(at, &["display", "show", "planes24"]);
    let device = format!("[device]\nkind = \"dlpc900\"\nlink = \"{link}\"\nsimulated = true\n");
    std::fs::write(at.join("bench.toml"), format!("{base}\n{device}")).unwrap();
    std::fs::write(at.join("plain.toml"), base).unwrap();
}

fn solve(at: &Path) {
    let words =
        "solve builtin:plane --display bench.toml --size 16 --color green --frames 24 --steps 1 --engine cpu -o h.zarr";
    done(at, &words.split(' ').collect::<Vec<_>>());
}

const SHOW: [&str; 8] = ["show", "h.zarr", "--display", "bench.toml", "--clock", "real", "--duration", "2.5"];

#[test]
fn a_session_starts_the_controller_and_puts_it_to_sleep() {
    let temp = folder();
    let at = temp.path();
    bench(at, "displayport");
    solve(at);
    let report = json(at, &[&SHOW[..], &["--json", "--stats", "s.json"]].concat());
    let controller = &report["controller"];
    assert_eq!((&controller["exposure_us"], &controller["rate_hz"]), (&json!(694), &json!(60.0)), "{report}");
    assert_eq!(
        (&controller["aborts"], &controller["errors"], &controller["asleep"]),
        (&json!(0), &json!(0), &json!(true))
    );
    assert!(controller["checks"].as_u64().is_some_and(|checks| checks > 0), "{controller}");
    assert_eq!(controller["events"][0]["kind"], "running");
    // The monitor has 60 video frames per second, so that exposures for 30 do not fit.
    let slow = eyebox(at, &[&SHOW[..], &["--json", "--display-rate", "30"]].concat());
    assert!(slow.status.success(), "{}", text(&slow.stderr));
    let report: Value = serde_json::from_slice(&slow.stdout).unwrap();
    let controller = &report["controller"];
    assert_eq!(controller["exposure_us"], 1388, "{controller}");
    assert!(controller["aborts"].as_u64().is_some_and(|aborts| aborts > 0), "{controller}");
    assert!(controller["events"].as_array().unwrap().iter().any(|event| event["kind"] == "abort"));
    // Statistics without a controller do not have the key.
    let plain = json(at, &["show", "h.zarr", "--display", "plain.toml", "--size", "16", "--duration", "0.1", "--json"]);
    assert!(plain.get("controller").is_none());
}

/// The digest of the file and the copy of the display do not depend on the controller.
#[test]
fn holograms_and_frames_do_not_depend_on_the_controller() {
    let temp = folder();
    let at = temp.path();
    bench(at, "hdmi");
    let solved = |display: &str, out: &str| {
        let words = format!(
            "solve builtin:plane --display {display} --size 16 --color green --frames 24 --steps 1 --engine cpu -o {out}"
        );
        done(at, &words.split(' ').collect::<Vec<_>>());
        let encoded = format!("{out}.frames");
        done(at, &["encode", out, "-o", &encoded]);
        let display = std::fs::read_to_string(at.join(&encoded).join("display.toml")).unwrap();
        (crate::common::attributes(&at.join(out))["settings"]["display_file"]["digest"].clone(), display)
    };
    let ((with, copy), (without, plain)) = (solved("bench.toml", "a.zarr"), solved("plain.toml", "b.zarr"));
    assert!(with == without && with.is_string(), "{with} {without}");
    assert!(copy == plain && !copy.contains("device"), "{copy}");
}

#[test]
fn connect_runs_a_controller_for_other_programs() {
    let temp = folder();
    let at = temp.path();
    bench(at, "hdmi");
    let report = json(at, &["display", "connect", "bench.toml", "--duration", "1.5", "--json"]);
    assert_eq!(report["schema"], "display-connect/1");
    assert_eq!(
        (&report["rate_hz"], &report["exposure_us"], &report["asleep"]),
        (&json!(30.0), &json!(1388), &json!(true))
    );
    assert_eq!(report["versions"]["application"], json!({ "major": 6, "minor": 1, "patch": 3 }));
    let faster = ["display", "connect", "bench.toml", "--duration", "1.5", "--display-rate", "29", "--json"];
    assert!(json(at, &faster)["aborts"].as_u64().is_some_and(|aborts| aborts > 0));
    let words = ["display", "connect", "bench.toml", "--display-rate", "1000", "--duration", "0.5", "--json"];
    assert!(json(at, &words)["events"][0]["error"]["code"] == "exposure");
    // A display without bit planes has no such controller.
    std::fs::write(at.join("grey.toml"), done(at, &["display", "show", "grey8"])).unwrap();
    let code = refusal(at, &["display", "connect", "grey.toml"]).code;
    assert_eq!(code, "session/setting/device-packing");
}

#[test]
fn check_names_dark_planes_and_cells_that_are_upside_down() {
    let temp = folder();
    let at = temp.path();
    let base = done(at, &["display", "show", "plm"]).replace("[800, 1358]", "[8, 12]");
    let device = "[device]\nkind = \"dlpc900\"\nsimulated = true\n";
    std::fs::write(at.join("plm.toml"), format!("{base}\n{device}")).unwrap();
    let check = |answers: &str, more: &[&str]| {
        let words = [&["display", "check", "plm.toml", "--force", "--output", "offscreen"][..], more].concat();
        let mut command = command(at, &words);
        with_json_errors(&mut command).stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
        let mut child = command.spawn().expect("it starts");
        child.stdin.take().expect("standard input").write_all(answers.as_bytes()).expect("written");
        child.wait_with_output().expect("it ends")
    };
    // Planes 3 and 8 are dark. The cells are upside down.
    let planes: String = (0..24).map(|plane| if [3, 8].contains(&plane) { "-\n" } else { "\n" }).collect();
    let heights = [0, 2, 1, 8, 4, 10, 9, 11, 3, 6, 5, 7, 12, 14, 13, 15];
    let levels: String = heights.iter().map(|height| format!("{}\n", 0.5 * f64::from(*height))).collect();
    let answer = check(&format!("{planes}{levels}"), &["--json"]);
    assert!(answer.status.success(), "{}", text(&answer.stderr));
    let report: Value = serde_json::from_slice(&answer.stdout).unwrap();
    assert_eq!(report["dark_planes"], json!(["G3", "R0"]), "{report}");
    assert_eq!(report["levels"]["kind"], "upside-down-cells");
    assert_eq!((&report["controller"]["asleep"], &report["controller"]["exposure_us"]), (&json!(true), &json!(694)));
    // Without answers nothing is judged, and the controller sleeps.
    let report: Value = serde_json::from_slice(&check("", &["--json"]).stdout).unwrap();
    assert!(report["levels"].is_null() && report["controller"]["asleep"] == true, "{report}");
    let wrong = check(&format!("{planes}many\n"), &["--json"]);
    assert_eq!(crate::common::Refusal::of(&wrong).code, "arguments/shift");
    assert_eq!(refusal(at, &["display", "check", "planes24", "--output", "offscreen"]).code, "arguments/no-device");
}
