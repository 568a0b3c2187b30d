//! Switchable sources, from the display file to the picture.

use crate::common::{Printed, done, eyebox, folder, json, refused, text};
use eyebox::low_level::files::read_npy;
use serde_json::Value;
use std::fmt::Write;
use std::path::Path;

const BENCH: &str = "resolution = [64, 64]\npitch_um = 8.0\nfocal_length_mm = 400.0\n";
const GREEN: &str = "wavelengths_nm = { green = 520 }\n";

/// Returns a display file with 3 x 3 sources at the spacing of an eyebox.
fn nine(lit: &str) -> String {
    let mut text = format!("{BENCH}{GREEN}sources_lit = \"{lit}\"\n");
    for i in 0..9 {
        let [x, y] = [f64::from(i % 3) - 1.0, f64::from(i / 3) - 1.0].map(|at| at * 26.0);
        writeln!(text, "[[sources]]\neyebox_mm = [{x}, {y}]").unwrap();
    }
    text
}

const SETTINGS: [&str; 8] = ["--steps", "6", "--frames", "9", "--pupil-diameter", "3.5..4.5", "--engine", "cpu"];

fn solve(at: &Path, display: &str, out: &str) {
    done(at, &[&["solve", "builtin:still-life", "--display", display, "-o", out][..], &SETTINGS].concat());
}

fn view(at: &Path, hologram: &str, pupil: &str) -> Vec<f32> {
    let pupil = format!("--pupil={pupil}");
    let answer = eyebox(at, &["render", hologram, &pupil, "--engine", "cpu", "-o", "seen.npy"]);
    assert!(answer.status.success(), "{}", text(&answer.stderr));
    read_npy(&at.join("seen.npy")).unwrap().values
}

/// Returns the eyebox of a display with its sources, and the text of `eyebox display check`.
fn reach(at: &Path, display: &str) -> (Value, String) {
    let devices = ["display", "check", display];
    let all = json(at, &[&devices[..], &["--json"]].concat())["reach"]["sources"].clone();
    (all, done(at, &devices))
}

/// Returns the plan of a display's sources as data and as text.
fn planned(at: &Path, display: &str) -> (Value, String) {
    let plan = ["solve", "builtin:still-life", "--dry-run", "--display", display, "--frames", "9", "--engine", "cpu"];
    let choices = json(at, &[&plan[..], &["--json"]].concat())["choices"].clone();
    let choice = choices.as_array().unwrap().iter().find(|choice| choice["what"] == "sources");
    (choice.unwrap_or_else(|| panic!("{choices}")).clone(), done(at, &plan))
}

/// Nine sources in turn give nine times the eyebox. Each sub-frame has its own source, which `encode` writes.
#[test]
fn sources_take_turns_and_are_kept() {
    let dir = folder();
    let at = dir.path();
    std::fs::write(at.join("nine.toml"), nine("in-turn")).unwrap();
    std::fs::write(at.join("one.toml"), format!("{BENCH}{GREEN}[[sources]]\n")).unwrap();
    std::fs::write(at.join("plain.toml"), format!("{BENCH}{GREEN}")).unwrap();
    let (all, said) = reach(at, "nine.toml");
    let size = [0, 1].map(|i| all["eyebox_mm"][i].as_f64().unwrap());
    assert!(all["sources"] == 9 && size.iter().all(|mm| (mm - 78.0).abs() < 1e-6), "{all}");
    assert!(said.has_sequence(&[9.0, 78.0, 78.0, 9.0]), "{said}");
    let (choice, said) = planned(at, "nine.toml");
    // All nine sources are lit, each in one of nine sub-frames.
    assert!(choice["value"].as_str().unwrap().has("green 9") && choice["why"].as_str().unwrap().has("1 9"), "{choice}");
    assert!(said.lines_with("green 9 1") > 0, "{said}");
    solve(at, "plain.toml", "plain.zarr");
    solve(at, "one.toml", "one.zarr");
    solve(at, "nine.toml", "nine.zarr");
    // A single source in the middle changes no byte.
    assert!(view(at, "plain.zarr", "1,-1,4,0") == view(at, "one.zarr", "1,-1,4,0"));
    let light = |pupil: &str| view(at, "nine.zarr", pupil).iter().sum::<f32>();
    let middle = light("0,0,4,0");
    for place in ["26,26,4,0", "-26,0,4,0", "13,0,4,0"] {
        let there = light(place);
        assert!(there > 0.3 * middle && there < 3.0 * middle, "at {place}: {there}, {middle} in the middle");
    }
    refused(at, &["render", "nine.zarr", "--pupil=60,0,4,0", "-o", "x.npy"], "x.npy", "arguments/outside-eyebox 78.00");
    done(at, &["encode", "nine.zarr", "--display", "grey8", "--size", "64x64", "-o", "frames"]);
    let table = std::fs::read_to_string(at.join("frames/sources.csv")).unwrap();
    assert!(table.starts_with("color,sub_frame,source_1,source_2"), "{table}");
    let line: Vec<&str> = table.lines().nth(3).unwrap().split(',').collect();
    assert_eq!((&line[..2], line[4]), (&["green", "2"][..], "9.000000"), "{table}");
    // A view of the frames is in the light of their sources.
    assert!(view(at, "frames", "26,26,4,0").iter().sum::<f32>() > 0.3 * middle);
}

/// The time of switching is missing from the light. White is dimmer, and the picture is as good.
#[test]
fn switching_takes_its_light() {
    let dir = folder();
    let at = dir.path();
    let slow = |us: u32| nine("in-turn").replace("[[sources]]", &format!("[[sources]]\nswitching_us = {us}"));
    std::fs::write(at.join("nine.toml"), nine("in-turn")).unwrap();
    std::fs::write(at.join("slow.toml"), slow(5000)).unwrap();
    let (all, said) = reach(at, "slow.toml");
    let is = |key: &str, number: f64| (all[key].as_f64().unwrap() / number - 1.0).abs() < 1e-3;
    assert!(is("switching_us", 5000.0) && is("sub_frame_us", 16667.0) && is("lit_share", 0.7), "{all}");
    assert!(said.has("5000 16667 us 70 %"), "{said}");
    let (choice, said) = planned(at, "slow.toml");
    assert!(choice["why"].as_str().unwrap().has("70 % 5000 16667 us") && said.has("70 % 5000 16667 us"), "{choice}");
    let figures = |display: &str| {
        solve(at, display, "h.zarr");
        let said =
            done(at, &["eval", "score", "h.zarr", "builtin:still-life", "--engine", "cpu", "--jod", "none", "--json"]);
        let said: Value = serde_json::from_str(&said).unwrap();
        [said["exposure"]["green"].as_f64().unwrap(), said["psnr_db"]["mean"].as_f64().unwrap()]
    };
    let ([plain, of_plain], [dark, of_dark]) = (figures("nine.toml"), figures("slow.toml"));
    assert!((dark * 0.7 / plain - 1.0).abs() < 0.02, "{dark} and {plain}");
    assert!((of_plain - of_dark).abs() < 0.5, "{of_plain} and {of_dark} dB");
    std::fs::write(at.join("bad.toml"), slow(17_000)).unwrap();
    refused(at, &["display", "check", "bad.toml"], "none", "optics/display-file/switching-times 17000");
}

/// A hologram that is refined for an eye stores the sources that light it. Near a border there are two.
#[test]
fn refinement_chooses_the_source() {
    let dir = folder();
    let at = dir.path();
    std::fs::write(at.join("nine.toml"), nine("steered")).unwrap();
    solve(at, "nine.toml", "base.zarr");
    for (pupil, lit) in [("26,0,4,0", vec![6]), ("0,0,4,0", vec![5]), ("13,0,4,0", vec![5, 6])] {
        let pupil = format!("--pupil={pupil}");
        let line = ["refine", "base.zarr", "builtin:still-life", &pupil, "--steps", "8", "--engine", "cpu", "--json"];
        let said = done(at, &[&line[..], &["-o", "there.zarr"]].concat());
        let said: Value = serde_json::from_str(&said).unwrap();
        let rows = said["rows"].as_array().unwrap();
        let db = |i: usize| rows[i]["eye_db"].as_f64().unwrap();
        assert!(db(rows.len() - 1) > db(0) + 1.0, "{pupil}: {rows:?}");
        let document = std::fs::read_to_string(at.join("there.zarr/zarr.json")).unwrap();
        let document: Value = serde_json::from_str(&document).unwrap();
        let kept = &document["attributes"]["eyebox"]["settings"]["sources"]["lit"]["only"]["green"];
        assert_eq!(kept, &serde_json::json!(lit), "{pupil}");
    }
}

/// Each set of a show with a tracker records the sources that light it. A study of gaze counts the sets that are dark
/// for the eye.
#[test]
fn live_sets_say_their_sources() {
    let dir = folder();
    let at = dir.path();
    std::fs::write(at.join("nine.toml"), nine("steered")).unwrap();
    solve(at, "nine.toml", "base.zarr");
    let line = ["show", "base.zarr", "--tracker", "simulated", "--display", "nine.toml", "--output", "offscreen"];
    done(at, &[&line[..], &["--duration", "1.5", "--engine", "cpu", "--set", "show.sources_out=lit.jsonl"]].concat());
    let lit = std::fs::read_to_string(at.join("lit.jsonl")).unwrap();
    let sets: Vec<Value> = lit.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    assert!(sets.len() > 2 && sets.iter().all(|set| set["sources"]["green"] == serde_json::json!([5])), "{lit}");
    let line = ["eval", "gaze", "base.zarr", "--display", "nine.toml", "--duration", "2", "--jod", "none"];
    let said =
        done(at, &[&line[..], &["--set", "gaze.step_time=2", "--engine", "cpu", "--json", "-o", "study"]].concat());
    let said: Value = serde_json::from_str(&said).unwrap();
    assert_eq!(said["summary"]["dark_sets"], serde_json::json!({ "eye_moves": 0, "eye_rests": 0 }));
    assert_eq!(said["summary"]["most_sources"], 1);
}

/// The report compares the views across the eyebox by the way in which the sources are lit. It has a table, a plot and
/// pictures.
#[test]
fn sources_are_compared_across_the_eyebox() {
    let dir = folder();
    let at = dir.path();
    std::fs::write(at.join("nine.toml"), nine("steered")).unwrap();
    std::fs::write(at.join("plain.toml"), format!("{BENCH}{GREEN}")).unwrap();
    let line = [
        "eval",
        "compare",
        "builtin:still-life",
        "--set",
        "compare.sources=true",
        "--frames",
        "9",
        "--steps",
        "3",
        "--set",
        "compare.speckle=false",
    ];
    done(at, &[&line[..], &["--display", "nine.toml", "--engine", "cpu", "-o", "report"]].concat());
    let report: Value = serde_json::from_slice(&std::fs::read(at.join("report/report.json")).unwrap()).unwrap();
    let places = report["sources"].as_array().unwrap();
    // There are three ways, with seven places along x and six along the diagonal.
    assert_eq!(places.len(), 3 * 13, "{places:?}");
    let steered: Vec<&Value> = places.iter().filter(|place| place["way"] == "steered").collect();
    assert!(steered.iter().all(|place| (1..=4).contains(&place["lit"].as_u64().unwrap())), "{steered:?}");
    let page = std::fs::read_to_string(at.join("report/report.html")).unwrap();
    assert!(page.contains("id=\"sources\"") && page.matches("data:image/").count() >= 3);
    let line = [
        "eval",
        "compare",
        "builtin:still-life",
        "--set",
        "compare.sources=true",
        "--display",
        "plain.toml",
        "-o",
        "other",
    ];
    refused(at, &line, "other/report.html", "arguments/no-sources");
}

#[test]
fn a_bad_source_is_refused_in_a_line() {
    let dir = folder();
    let at = dir.path();
    let solve = ["solve", "builtin:still-life", "--display", "bad.toml", "--engine", "cpu", "-o", "out.zarr"];
    for (sources, says) in [
        ("[[sources]]\npower = 0\n", "optics/display-file/sources-without-color"),
        ("[[sources]]\npower = -2\n", "optics/display-file/range"),
        ("[[sources]]\nangle_mrad = [0, 800]\n", "optics/display-file/source-angle 800.0"),
        (
            "[[sources]]\n[source.green]\nmodes = [{ weight = 1, wavelength_nm = 600 }]\n",
            "optics/display-file/line-width 600.0",
        ),
    ] {
        std::fs::write(at.join("bad.toml"), format!("{BENCH}{GREEN}{sources}")).unwrap();
        refused(at, &solve, "out.zarr", says);
    }
    std::fs::write(at.join("bad.toml"), nine("in-turn")).unwrap();
    refused(at, &[&solve[..], &["--frames", "4"]].concat(), "out.zarr", "solve/setting");
}
