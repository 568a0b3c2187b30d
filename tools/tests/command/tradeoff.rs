//! `eyebox eval tune` and `--quality` as a user sees them.

use crate::common::{self, Printed, folder, text};
use eyebox::low_level::engine::{Engine, cpu::CpuEngine};
use eyebox::low_level::optics::{Color, WindowFactor};
use eyebox::low_level::quality::Quality;
use eyebox::low_level::solve::{Levels, PaddingRule, Settings};
use eyebox_lab::tuning::{Measured, Recommended, Trial};
use serde_json::Value;
use std::path::Path;
use std::process::Output;
use std::time::{Duration, Instant};

/// Runs the command with a cache that no other test has.
fn eyebox(at: &Path, args: &[&str]) -> Output {
    common::command(at, args).env("XDG_CACHE_HOME", at.join("cache")).output().expect("the command starts")
}

fn done(at: &Path, args: &[&str]) -> (String, String) {
    let answer = eyebox(at, args);
    assert!(answer.status.success(), "{args:?}: {}", text(&answer.stderr));
    (text(&answer.stdout), text(&answer.stderr))
}

#[track_caller]
fn refused(at: &Path, args: &[&str], what: &str) {
    common::refused(at, args, "out", what);
    assert!(!at.join("x.zarr").exists(), "{args:?} left something");
}

const SMALL: [&str; 6] = ["--size", "32x40", "--engine", "cpu", "--color", "green"];

fn tune<'a>(more: &[&'a str]) -> Vec<&'a str> {
    [&["eval", "tune", "builtin:still-life", "-o", "out", "--frames", "2"][..], &SMALL, more].concat()
}

fn read(at: &Path, name: &str) -> String {
    std::fs::read_to_string(at.join("out").join(name)).unwrap_or_else(|e| panic!("{name}: {e}"))
}

#[test]
fn a_sweep_is_a_page_and_the_same_numbers_and_goes_on() {
    let temp = folder();
    let at = temp.path();
    // The number of trials per second depends on the machine and its load. The duration grows until it is enough.
    let longer_until = |start: u32, enough: usize| -> (u32, Value) {
        for budget in [start, 2 * start, 4 * start, 8 * start] {
            let (said, _) = done(at, &tune(&["--duration", &budget.to_string(), "--json", "--no-store"]));
            let mut found: Value = serde_json::from_str(&said).expect("one JSON object");
            assert_eq!(found.as_object_mut().and_then(|all| all.remove("schema")), Some("eval-tune/1".into()));
            if found["trials"].as_array().unwrap().len() >= enough {
                return (budget, found);
            }
        }
        panic!("fewer than {enough} trials in {} s", 8 * start);
    };
    let (budget, found) = longer_until(6, 3);
    assert_eq!(found, serde_json::from_str::<Value>(&read(at, "tradeoff.json")).unwrap());
    let trials = found["trials"].as_array().unwrap();
    assert_eq!(read(at, "trials.csv").lines().count(), 1 + trials.len());
    assert!(!at.join("cache").exists(), "nothing is to be kept");

    // Every trial is judged in JOD. The best trial by PSNR is about as good as the worst one, or better. Few trials of
    // a slow machine are close to each other, and JOD do not follow PSNR to the last digit.
    let jod = |t: &Value| [0, 1].map(|i| t["jod"][i].as_f64().expect("JOD"));
    assert!(trials.iter().map(jod).all(|[mean, worst]| worst <= mean && mean < 10.0));
    let by_mean = |a: &&Value, b: &&Value| a["mean"].as_f64().unwrap().total_cmp(&b["mean"].as_f64().unwrap());
    let [least, most] = [trials.iter().min_by(by_mean), trials.iter().max_by(by_mean)].map(|t| jod(t.unwrap())[0]);
    assert!(most > least - 0.1, "{most} and {least} JOD");
    assert!(read(at, "trials.csv").lines().next().unwrap().contains("worst_db,jod_mean,jod_worst"));

    // No trial beats a trial on a front.
    let number = |t: &Value, key: &str| t[key].as_f64().unwrap();
    for (front, cost, good) in
        [("mean", "milliseconds", "mean"), ("worst", "milliseconds", "worst"), ("memory", "bytes", "mean")]
    {
        let places = found["fronts"][front].as_array().unwrap();
        assert!(!places.is_empty());
        for place in places {
            let t = &trials[place.as_u64().unwrap() as usize];
            let beats = |o: &Value| number(o, cost) <= number(t, cost) && number(o, good) > number(t, good);
            assert!(!trials.iter().any(beats), "{front}: {t}");
        }
    }
    assert_eq!(trials[0]["recipe"], serde_json::to_value(Settings::default()).unwrap(), "the default comes first");
    let best = trials.iter().map(|t| number(t, "mean")).fold(f64::MIN, f64::max);
    assert!(number(&found["recommended"][2]["trial"], "mean") >= best - 0.011);

    common::figures_of(&at.join("out"), "index.html");
    let page = read(at, "index.html");
    assert!(page.starts_with("<!DOCTYPE html>") && page.trim_end().ends_with("</html>"));
    for outside in ["<script", "<link", "src=\"http", "url(", "href=\"http", "@import", "NaN", "inf"] {
        assert!(!page.contains(outside), "{outside}");
    }
    assert_eq!(page.matches("<svg").count(), 4);
    // Every trial has a tooltip in each plot.
    assert!(page.matches("<title>").count() > 4 * trials.len());

    // The same command continues. Its time is used up, so that nothing is added until it has more time.
    let (said, _) = done(at, &tune(&["--duration", &budget.to_string(), "--json", "--no-store"]));
    let again: Value = serde_json::from_str(&said).unwrap();
    let kept = |found: &Value| -> Vec<Value> {
        found["trials"].as_array().unwrap().iter().map(|t| t["recipe"].clone()).collect()
    };
    assert_eq!(kept(&again), kept(&found));
    let (_, more) = longer_until(budget + 2, trials.len() + 1);
    assert!(kept(&more).starts_with(&kept(&found)));
    // Another seed makes another sweep.
    let (said, _) = done(at, &tune(&["--duration", "1", "--json", "--no-store", "--seed", "4"]));
    let other: Value = serde_json::from_str(&said).unwrap();
    assert_ne!(other["trials"][0]["mean"], found["trials"][0]["mean"]);

    // The three settings of this run are measured next to the front of another run.
    std::fs::rename(at.join("out"), at.join("first")).unwrap();
    let check = ["--duration", "1", "--json", "--no-store", "--seed", "5", "--check", "first/tradeoff.json"];
    let answer = eyebox(at, &tune(&check));
    // Times of milliseconds vary, so that both exit codes are valid here.
    let checked: Value = serde_json::from_str(&text(&answer.stdout)).unwrap();
    let rows = checked["check"].as_array().unwrap();
    assert_eq!(rows.len(), 3);
    let far = rows.iter().filter(|r| r["short_db"].as_f64().unwrap() > 0.3).count();
    assert_eq!(answer.status.code(), Some(if far > 0 { 2 } else { 0 }), "{}", text(&answer.stderr));
    // The check has a heading of its own.
    let first = std::fs::read_to_string(at.join("first/index.html")).unwrap();
    assert!(read(at, "index.html").matches("<h3").count() > first.matches("<h3").count());
}

#[test]
#[cfg(unix)]
fn an_interrupted_sweep_is_a_valid_report() {
    let temp = folder();
    let at = temp.path();
    let mut child = common::command(at, &tune(&["--duration", "600"]))
        .env("XDG_CACHE_HOME", at.join("cache"))
        .stderr(std::process::Stdio::null())
        .stdout(std::process::Stdio::null())
        .spawn()
        .unwrap();
    let start = Instant::now();
    while !at.join("out/trials.json").exists() {
        assert!(start.elapsed() < Duration::from_secs(120), "no trial after two minutes");
        std::thread::sleep(Duration::from_millis(10));
    }
    let killed = std::process::Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap();
    assert!(killed.success());
    assert!(child.wait().unwrap().success());
    let found: Value = serde_json::from_str(&read(at, "tradeoff.json")).unwrap();
    assert_eq!(found["interrupted"], true);
    assert_eq!(found["recommended"].as_array().unwrap().len(), 3);
    assert!(!found["trials"].as_array().unwrap().is_empty() && read(at, "index.html").contains("class=\"warn\""));
}

#[test]
fn mistakes_are_one_line_and_leave_nothing() {
    let temp = folder();
    let at = temp.path();
    refused(at, &tune(&["--duration", "0"]), "usage/value-validation --duration");
    refused(at, &tune(&["--check", "none.json"]), "arguments/tradeoff-file none.json");
    std::fs::write(at.join("other.json"), "{\"recommended\": []}").unwrap();
    refused(at, &tune(&["--check", "other.json"]), "arguments/tradeoff-file");
    std::fs::write(at.join("other.json"), "[").unwrap();
    refused(at, &tune(&["--check", "other.json"]), "arguments/tradeoff-file tradeoff.json");
    refused(at, &tune(&["--set", "levels=none.txt"]), "produce/job/value levels");
    refused(at, &tune(&["--set", "levels=300"]), "solve/setting levels");
    refused(at, &["eval", "tune", "none", "-o", "out"], "scene/not-found");
    refused(
        at,
        &["eval", "tune", "builtin:plane", "-o", "out", "--frames", "0", "--engine", "cpu"],
        "solve/setting sub-frames",
    );
    refused(at, &["eval", "tune", "builtin:plane", "--size", "32x32"], "usage/missing-required-argument --out");
    refused(at, &solve(&["--quality", "best"]), "usage/value-validation --quality");
    refused(at, &solve(&["--quality", "fast", "--quality", "9ms"]), "usage/argument-conflict");
    refused(at, &solve(&["--quality", "0ms"]), "usage/value-validation --quality");
    // Without a measurement, a built-in setting has no time on this machine.
    refused(at, &solve(&["--quality", "1000000ms"]), "arguments/nothing-measured");
}

fn solve<'a>(more: &[&'a str]) -> Vec<&'a str> {
    [&["solve", "builtin:still-life", "-o", "x.zarr"][..], &SMALL, more].concat()
}

/// Returns the settings that a solve reports.
fn settings(at: &Path, more: &[&str]) -> Value {
    let (said, _) = done(at, &[&solve(more)[..], &["--json"]].concat());
    std::fs::remove_dir_all(at.join("x.zarr")).unwrap();
    serde_json::from_str::<Value>(&said).unwrap()["settings"].clone()
}

fn trial(recipe: Settings, milliseconds: f64, mean: f64) -> Trial {
    Trial::new(recipe, milliseconds, vec![mean; 2], 1 << 20)
}

/// Stores measurements as if `eval tune` had made them on this machine, with 32 x 40 pixels and 8 sub-frames.
fn keep(at: &Path, all: [Trial; 3]) -> std::path::PathBuf {
    let front = all.to_vec();
    let recommended =
        Quality::ALL.into_iter().zip(all).map(|(quality, trial)| Recommended { quality, trial, met: true });
    let measured = Measured {
        device: CpuEngine::new().describe(),
        scene: "still-life".into(),
        color: Color::Green,
        size: [32, 40],
        frames: 8,
        recommended: recommended.collect(),
        front,
    };
    measured.save(&at.join("cache/eyebox")).unwrap()
}

#[test]
fn built_in_qualities_hold_until_they_are_measured_and_what_is_given_wins() {
    let temp = folder();
    let at = temp.path();
    let plain = settings(at, &["--steps", "3"]);
    assert_eq!(
        (plain["steps"].as_u64(), plain["pupils"].as_u64(), &plain["window"]),
        (Some(3), Some(16), &"one".into())
    );
    let built_in = Settings::of(Quality::Fast);
    let fast = settings(at, &["--quality", "fast"]);
    assert_eq!(fast["steps"].as_u64(), Some(built_in.steps as u64));
    assert_eq!(fast["optimizer"], serde_json::to_value(built_in.optimizer).unwrap());
    let given = ["--quality", "accurate", "--steps", "4", "--pupils", "3", "--set", "window=1", "--frames", "2"];
    let own = settings(at, &[&given[..], &["--set", "diameters=reciprocal", "--set", "optimizer=adam"]].concat());
    assert_eq!((own["steps"].as_u64(), own["pupils"].as_u64(), own["frames"].as_u64()), (Some(4), Some(3), Some(2)));
    assert_eq!((&own["window"], &own["diameters"]), (&"one".into(), &"reciprocal".into()));
    assert_eq!(own["optimizer"]["kind"], "adam");

    let recipe = |steps| Settings { steps, pupils: 5, window: WindowFactor::Two, ..Settings::default() };
    let file = keep(at, [trial(recipe(2), 10.0, 20.0), trial(recipe(5), 100.0, 25.0), trial(recipe(9), 1000.0, 26.0)]);
    for (name, steps) in [("fast", 2), ("balanced", 5), ("accurate", 9)] {
        let found = settings(at, &["--quality", name]);
        assert_eq!((found["steps"].as_u64(), found["pupils"].as_u64()), (Some(steps), Some(5)), "{name}");
    }
    let (_, said) = done(at, &solve(&["--quality", "balanced"]));
    // The line has the steps, the pupils and the scene of the measurement.
    assert!(said.lines().any(|line| line.has("balanced still-life") && line.has_sequence(&[5.0, 5.0])), "{said}");
    // Without `--quality`, the settings do not change.
    assert_eq!(settings(at, &["--steps", "3"]), plain);

    // A damaged file, or a file of another device, is ignored with one line.
    let whole = std::fs::read(&file).unwrap();
    for broken in [&whole[..whole.len() / 2], b"", b"\xff\xfe", b"eyebox tradeoff 1 00000000\n{}"] {
        std::fs::write(&file, broken).unwrap();
        let (report, said) = done(at, &solve(&["--quality", "fast", "--steps", "1", "--json"]));
        let ignored: Vec<&str> = said.lines().filter(|l| l.contains("tradeoff-cpu")).collect();
        assert!(ignored.len() == 1 && !said.contains("panicked"), "{said}");
        let report: Value = serde_json::from_str(&report).unwrap();
        assert_eq!(report["settings"]["pupils"].as_u64(), Some(built_in.pupils as u64), "{report}");
    }
}

#[test]
fn a_quality_of_a_time_takes_what_fits_and_refuses_what_does_not() {
    let temp = folder();
    let at = temp.path();
    let recipe = |steps| Settings { steps, pupils: 2, ..Settings::default() };
    keep(at, [trial(recipe(2), 10.0, 20.0), trial(recipe(5), 100.0, 25.0), trial(recipe(9), 1000.0, 26.0)]);
    let steps = |more: &[&str]| settings(at, more)["steps"].as_u64().unwrap();
    assert_eq!(steps(&["--quality", "999ms"]), 5);
    assert_eq!(steps(&["--quality", "1s"]), 9);
    assert_eq!(steps(&["--quality", "10ms"]), 2);
    refused(
        at,
        &[&["solve", "builtin:plane", "-o", "x.zarr"][..], &SMALL, &["--quality", "9ms"]].concat(),
        "arguments/nothing-measured",
    );
    // Half of the sub-frames take half of the time, and three colors take three times as long.
    assert_eq!(steps(&["--quality", "500ms", "--frames", "4"]), 9);
    let all = |time| {
        [
            "solve",
            "builtin:still-life",
            "-o",
            "x.zarr",
            "--size",
            "32x40",
            "--engine",
            "cpu",
            "--json",
            "--quality",
            time,
        ]
    };
    let (said, _) = done(at, &all("299ms"));
    assert_eq!(serde_json::from_str::<Value>(&said).unwrap()["settings"]["steps"], 2);
    let (said, _) = done(at, &all("300ms"));
    assert_eq!(serde_json::from_str::<Value>(&said).unwrap()["settings"]["steps"], 5);
}

/// Fewer views, repeated sub-frames, coarse pixels and padding still give complete holograms.
#[test]
fn holograms_of_reduced_problems_are_whole() {
    let temp = folder();
    let at = temp.path();
    let thin = Settings { steps: 4, views: 2, repeats: 4, ..Settings::default() };
    let coarse = Settings { steps: 4, pixel: 2, repeats: 2, padding: PaddingRule::Always, ..Settings::default() };
    let levels = Settings { steps: 4, levels: Levels::Display, ..Settings::default() };
    keep(at, [trial(thin, 10.0, 20.0), trial(coarse, 100.0, 25.0), trial(levels, 1000.0, 26.0)]);
    let phases = |name: &str| -> Vec<f32> {
        done(at, &solve(&["--quality", name, "--display", "plm"]));
        done(at, &["convert", "x.zarr", "x.npy"]);
        let npy = eyebox::low_level::files::read_npy(&at.join("x.npy")).unwrap();
        assert_eq!(npy.shape, [8, 32, 40], "{name}");
        let (said, _) = done(at, &["eval", "score", "x.zarr", "builtin:still-life", "--engine", "cpu", "--json"]);
        let score: Value = serde_json::from_str(&said).unwrap();
        assert!(score["psnr_db"]["mean"].as_f64().unwrap() > 5.0, "{name}: {score}");
        npy.values
    };
    let frame = 32 * 40;
    let thin = phases("fast");
    assert!(thin[..2 * frame] == thin[2 * frame..4 * frame] && thin[..frame] != thin[frame..2 * frame]);
    let coarse = phases("balanced");
    assert_eq!(coarse[..4 * frame], coarse[4 * frame..]);
    assert!((0..frame).all(|i| coarse[i] == coarse[(i / 40 / 2 * 2) * 40 + i % 40 / 2 * 2]));
    // The phases have 16 levels.
    let mut seen: Vec<u32> = phases("accurate").iter().map(|p| p.to_bits()).collect();
    seen.sort_unstable();
    seen.dedup();
    assert!(seen.len() <= 16, "{} phases", seen.len());
    let (said, _) = done(at, &solve(&["--quality", "fast", "--json"]));
    let solved = serde_json::from_str::<Value>(&said).unwrap();
    assert_eq!(
        (&solved["settings"]["frames"], &solved["settings"]["repeats"]),
        (&8.into(), &4.into()),
        "two are solved"
    );
    // With `--frames`, all of these sub-frames are solved.
    let (said, _) = done(at, &solve(&["--quality", "fast", "--frames", "8", "--json"]));
    let solved = serde_json::from_str::<Value>(&said).unwrap();
    assert_eq!((&solved["settings"]["frames"], &solved["settings"]["repeats"]), (&8.into(), &Value::Null));
}

#[test]
fn compare_and_bench_know_qualities() {
    let temp = folder();
    let at = temp.path();
    let recipe = |steps| Settings { steps, pupils: 3, views: 2, repeats: 2, ..Settings::default() };
    keep(at, [trial(recipe(2), 10.0, 20.0), trial(recipe(3), 100.0, 25.0), trial(recipe(4), 1000.0, 26.0)]);
    let run = [
        &["eval", "compare", "builtin:plane", "-o", "out", "--methods", "slfh", "--set", "compare.speckle=false"][..],
        &SMALL,
    ]
    .concat();
    done(at, &[&run[..], &["--quality", "balanced"]].concat());
    let report: Value = serde_json::from_str(&read(at, "report.json")).unwrap();
    assert_eq!((&report["about"]["steps"], &report["about"]["pupils"]), (&3.into(), &3.into()));
    assert_eq!(report["runs"][0]["frames"], 8, "methods are compared with all sub-frames");
    let (said, _) =
        done(at, &[&["bench", "builtin:plane", "--rounds", "1", "--quality", "accurate"][..], &SMALL].concat());
    assert!(said.lines().any(|line| line.has("accurate") && line.has_sequence(&[4.0, 3.0])), "{said}");
    assert!(said.lines_with("4") > 1, "{said}");
}
