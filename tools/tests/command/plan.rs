//! `eyebox solve --dry-run` as a user runs it, and the solve that uses its plan.

use crate::common::{self, Printed, command, done, folder, refused, written};
use serde_json::Value;
use std::path::Path;

const SMALL: [&str; 6] = ["--size", "48x40", "--engine", "cpu", "--pupil-diameter", "4..18"];

fn json(folder: &Path, scene: &str, more: &[&str]) -> Value {
    let text = done(folder, &[&["solve", scene, "--json"][..], &SMALL, more].concat());
    serde_json::from_str(&text).expect("one JSON object")
}

fn planned(folder: &Path, scene: &str, more: &[&str]) -> Value {
    json(folder, scene, &[&["--dry-run"], more].concat())
}

fn choice<'a>(plan: &'a Value, what: &str) -> &'a Value {
    plan["choices"].as_array().unwrap().iter().find(|c| c["what"] == what).unwrap_or_else(|| panic!("{what}: {plan}"))
}

#[test]
fn a_plan_says_what_why_and_how_much() {
    let temp = folder();
    let at = temp.path();
    let text = done(at, &[&["solve", "builtin:still-life", "--dry-run"][..], &SMALL].concat());
    let deep = planned(at, "builtin:still-life", &[]);
    let choices = deep["choices"].as_array().unwrap();
    assert!(choices.len() >= 8, "{deep}");
    // Each choice is a line that has its name and its value.
    for choice in choices {
        let [what, value] = ["what", "value"].map(|key| choice[key].as_str().unwrap());
        let is_said = |line: &str| line.trim_start().starts_with(what) && line.contains(value);
        assert!(text.lines().any(is_said), "{choice}: {text}");
    }
    // The text has the time of a step per color, the total, the memory and how the engine runs its lists.
    assert!(text.has("red green blue ms s MiB") && text.contains(deep["lists"].as_str().unwrap()), "{text}");
    assert!(text.number("MiB") > 1.0 && text.number("ms") > 0.0, "{text}");
    assert_eq!((&deep["views_merged"], choice(&deep, "views")["saves"].as_bool()), (&Value::from(1), Some(false)));
    let flat = planned(at, "builtin:plane", &[]);
    assert_eq!((&flat["views_merged"], choice(&flat, "views")["saves"].as_bool()), (&Value::from(9), Some(true)));
    let full = planned(at, "builtin:plane", &["--set", "full=all"]);
    assert_eq!((&full["views_merged"], &full["settings"]["window"]), (&Value::from(1), &Value::from("full")));
    let forecast = |plan: &Value, i: usize| plan["forecast"][i].clone();
    let (saved, whole) = (forecast(&flat, 0), forecast(&full, 0));
    assert!(saved["step_ms"].as_f64() < whole["step_ms"].as_f64(), "{saved} {whole}");
    assert!(saved["peak_memory_bytes"].as_u64() > Some(48 * 40 * 81 * 3 * 4), "{saved}");
    // A plan writes no file.
    assert_eq!(std::fs::read_dir(at).unwrap().count(), 0);
}

/// One view instead of 81 makes no visible difference, and the file stores the scene as it is.
#[test]
fn a_flat_scene_solved_from_one_view_is_the_same() {
    let temp = folder();
    let at = temp.path();
    let solve = |out: &str, more: &[&str]| {
        let said = json(at, "builtin:plane", &[&["--color", "green", "--steps", "8", "-o", out], more].concat());
        let score: Value =
            serde_json::from_str(&done(at, &["eval", "score", out, "builtin:plane", "--json", "--engine", "cpu"]))
                .unwrap();
        (
            said,
            score["mean"]["psnr_db"]
                .as_f64()
                .or(score["psnr_db"]["mean"].as_f64())
                .unwrap_or_else(|| panic!("{score}")),
        )
    };
    let (saved, one) = solve("one.zarr", &[]);
    let (whole, all) = solve("all.zarr", &["--set", "full=views"]);
    assert!((one - all).abs() < 0.01, "{one} dB from one view, {all} dB from all");
    let count = |said: &Value| said["plan"].as_array().unwrap().iter().filter(|c| c["saves"] == true).count();
    assert_eq!((count(&saved), count(&whole)), (1, 0));
    assert!(saved["peak_memory_mib"].as_u64() > Some(1) && saved["colors"][0]["step_ms"].as_f64() > Some(0.0));
}

#[test]
fn sub_frames_follow_the_speckle_asked_for() {
    let temp = folder();
    let at = temp.path();
    assert_eq!(planned(at, "builtin:plane", &["--set", "contrast=0.5"])["settings"]["frames"], 4);
    let plan = |more: &[&'static str]| [&["solve", "builtin:plane", "--dry-run"][..], more].concat();
    refused(at, &plan(&["--set", "contrast=2"]), "x", "produce/job/value 0.016 4096");
    refused(at, &plan(&["--set", "contrast=0.5", "--frames", "8"]), "x", "arguments/frames-and-contrast --frames");
    refused(at, &plan(&["--set", "full=colors,nonsense"]), "x", "produce/job/value nonsense");
    refused(at, &plan(&["--set", "padding=sometimes"]), "x", "produce/job/value padding");
    refused(at, &["solve", "builtin:none", "--dry-run"], "x", "scene/builtin/no-such-scene still-life");
}

/// A cache folder that cannot be written costs only time. Rates are measured once, and again if their file is damaged.
#[test]
fn rates_are_a_convenience() {
    let temp = folder();
    let (at, cache) = (temp.path().join("work"), temp.path().join("cache"));
    std::fs::create_dir(&at).unwrap();
    let arguments = [&["solve", "builtin:plane", "--dry-run"][..], &SMALL].concat();
    let run = || {
        let answer = command(&at, &arguments).env("XDG_CACHE_HOME", &cache).output().unwrap();
        assert!(answer.status.success(), "{}", common::text(&answer.stderr));
        // A measurement is announced, because it takes time.
        !answer.stderr.is_empty()
    };
    std::fs::write(&cache, "no folder").unwrap();
    assert!(run());
    std::fs::remove_file(&cache).unwrap();
    std::fs::create_dir_all(cache.join("eyebox")).unwrap();
    assert!(run());
    let mut kept = std::fs::read_dir(cache.join("eyebox")).unwrap().map(|e| e.unwrap().path());
    let file = kept.find(|p| p.to_string_lossy().contains("rates-")).expect("the rates");
    let whole = std::fs::read_to_string(&file).unwrap();
    std::fs::write(&file, &whole[..whole.len() / 2]).unwrap();
    assert!(run());
    let again = (std::fs::read_to_string(&file).unwrap().lines().count(), written(&file));
    assert_eq!(again.0, whole.lines().count());
    assert!(!run() && written(&file) == again.1, "the next plan knows the rates");
}

/// A side with a large prime factor is padded to a size that transforms well. The plan reports the padding.
#[test]
fn a_side_that_would_transform_slowly_is_padded() {
    let temp = folder();
    let at = temp.path();
    let solved = |out: &str, more: &[&str]| {
        let args = "solve builtin:plane --steps 2 --frames 1 --pupils 2 --color green --engine cpu --json -o";
        let args: Vec<&str> = args.split(' ').chain([out]).chain(more.iter().copied()).collect();
        serde_json::from_str::<Value>(&done(at, &args)).unwrap()
    };
    let choice_of = |solved: &Value| {
        let mut choices = solved["plan"].as_array().unwrap().iter();
        choices.find(|choice| choice["what"] == "padding").expect("a choice").to_string()
    };
    let padded = solved("p.zarr", &["--size", "12x262"]);
    assert_eq!(padded["padding"], serde_json::json!([0, 26]));
    assert!(choice_of(&padded).has("262 131"), "{padded}");
    done(at, &["render", "p.zarr", "--pupil=0,0,5,0", "-o", "v.png"]);
    assert_eq!(solved("n.zarr", &["--size", "12x264"])["padding"], serde_json::json!([0, 0]));
    // `padding=exact` keeps exactly the size of the SLM.
    let exact = solved("e.zarr", &["--size", "12x262", "--set", "padding=exact"]);
    assert_eq!(
        (&exact["padding"], &exact["settings"]["padding"]),
        (&serde_json::json!([0, 0]), &serde_json::json!("exact"))
    );
    assert!(choice_of(&exact).has("262 131"), "{exact}");
    done(at, &["render", "e.zarr", "--pupil=0,0,5,0", "-o", "e.png"]);
}

/// Steps are recorded and not run. The report has their load on a device, and a model gives their time on several
/// devices.
#[test]
fn a_bench_records_steps_and_runs_none() {
    let temp = folder();
    let at = temp.path();
    let run = |more: &str| {
        let args = format!("bench builtin:plane --size 64x64 --color green --pupils 2 --steps 4 --dry-run {more}");
        done(at, &args.split(' ').collect::<Vec<_>>())
    };
    for pupil in ["", " --pupil=1,0,4,0"] {
        let dry = serde_json::from_str::<Value>(&run(&format!("--json{pupil}"))).unwrap();
        let step = |name: &str| dry["step"][name]["later"].as_f64().unwrap_or_else(|| panic!("{name}: {dry}"));
        assert!(step("dispatches") > step("stages") && step("stages") >= 6.0 && step("bytes_read") > 0.0, "{dry}");
        assert_eq!(["submissions", "waits_before_recording", "bytes_down"].map(step), [1.0, 0.0, 0.0], "{dry}");
        assert_eq!(["blocks_made", "pipelines_made", "bytes_up"].map(step), [0.0; 3], "{dry}");
        for device in ["H200", "RTX 4090", "Radeon 780M"] {
            assert!(dry["modelled"][device]["with_host_ms"].as_f64().is_some_and(|ms| ms > 0.0), "{dry}");
        }
        assert!(
            dry["kernels"]["project"]["dispatches"] == 1 && dry["longest_submission_ms"].as_f64().is_some(),
            "{dry}"
        );
    }
    // Only splats have a content frame, because their camera can move.
    let dry: Value = serde_json::from_str(&run("--json")).unwrap();
    assert!(dry["content_frame"].is_null(), "{dry}");
    let splats = "bench builtin:still-life-splats --size 64x96 --color green --pupils 2 --steps 2 --views 3 --dry-run";
    let dry = done(at, &format!("{splats} --json").split(' ').collect::<Vec<_>>());
    let frame = serde_json::from_str::<Value>(&dry).unwrap()["content_frame"].take();
    assert!(frame["views"] == 9 && frame["splats"].as_u64().is_some_and(|n| n > 2000), "{frame}");
    assert!(frame["splats_in_tiles"].as_u64() > frame["splats"].as_u64(), "{frame}");
    for device in ["H200", "RTX 4090", "Radeon 780M"] {
        let rate = frame["modelled"][device]["frames_per_second_with_a_step"].as_f64();
        assert!(rate.is_some_and(|rate| rate > 0.0 && rate < 1e5), "{frame}");
    }
    let said = done(at, &splats.split(' ').collect::<Vec<_>>());
    assert_eq!(said.lines().filter(|line| line.starts_with("RTX 4090")).count(), 2, "{said}");
    let said = run("--set storage=fp16");
    for device in ["H200", "RTX 4090", "Radeon 780M"] {
        assert!(said.lines().any(|line| line.starts_with(device) && line.numbers().len() > 4), "{device}: {said}");
    }
    let dry: Value = serde_json::from_str(&run("--set storage=fp16 --json")).unwrap();
    let kernels = dry["kernels"].as_object().unwrap();
    for (kernel, of) in kernels {
        assert_eq!(said.lines_with(&format!("{kernel} {}", of["dispatches"])), 1, "{kernel}: {said}");
    }
    // The text has the given number of steps.
    assert!(said.has("4") && kernels.len() > 4, "{said}");
}
