//! `eyebox eval compare` as a user runs it, with its report, its continuation after an interruption, and its errors.

use crate::common::{self, command, done};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, Instant, SystemTime};

#[track_caller]
fn refused(folder: &Path, args: &[&str], what: &str) {
    common::refused(folder, args, "out", what);
}

const SMALL: [&str; 8] = ["--size", "40x48", "--steps", "3", "--engine", "cpu", "-o", "out"];

fn evaluate<'a>(scenes: &[&'a str], more: &[&'a str]) -> Vec<&'a str> {
    [&["eval", "compare"][..], scenes, &SMALL, more].concat()
}

fn read(folder: &Path, name: &str) -> String {
    std::fs::read_to_string(folder.join("out").join(name)).unwrap_or_else(|e| panic!("{name}: {e}"))
}

fn written(folder: &Path, name: &str) -> SystemTime {
    std::fs::metadata(folder.join("out").join(name)).unwrap_or_else(|e| panic!("{name}: {e}")).modified().unwrap()
}

/// Writes four views as a folder of pictures.
fn views(folder: &Path, name: &str, size: &str) -> PathBuf {
    std::fs::create_dir(folder.join(name)).unwrap();
    for i in 0..4 {
        let (pupil, out) =
            (format!("--pupil={},{},2,0", i % 2 * 8 - 4, i / 2 * 8 - 4), format!("{name}/view_{i:02}.png"));
        done(folder, &["render", "builtin:plane", "--size", size, "--views", "3", &pupil, "-o", &out]);
    }
    folder.join(name)
}

#[test]
fn a_report_is_one_page_and_the_same_numbers_as_csv_and_json() {
    let temp = tempfile::tempdir().unwrap();
    let at = temp.path();
    let published =
        "method,category,n,mean,median,q25,q75,min,max,std\nslfh,Random pupils,70,28.6,29.4,24.8,30.9,22.9,37.7,3.8\n";
    std::fs::write(at.join("paper.csv"), published).unwrap();
    let more = [
        "--methods",
        "slfh,dpac",
        "--frames",
        "1,2",
        "--set",
        "compare.reference=paper.csv",
        "--set",
        "compare.speckle=false",
        "--json",
    ];
    let said = done(at, &evaluate(&["builtin:still-life", "builtin:plane?depth=0.05"], &more));
    let mut report: serde_json::Value = serde_json::from_str(&said).expect("one JSON object");
    assert_eq!(report.as_object_mut().and_then(|all| all.remove("schema")), Some("eval-compare/1".into()));
    assert_eq!(report, serde_json::from_str::<serde_json::Value>(&read(at, "report.json")).unwrap());
    assert_eq!(report["runs"].as_array().unwrap().len(), 8, "two scenes, two methods, two numbers of sub-frames");
    assert_eq!(report["missing"], 0);

    // The groups have 9, 9, 25, 25 and 24 pupils in three colors.
    let scores = read(at, "scores.csv");
    assert_eq!(scores.lines().count(), 1 + 8 * 3 * 92);
    assert!(scores.lines().next().unwrap().starts_with("method,frames,scene,color,group"));
    let random: Vec<f64> = scores
        .lines()
        .filter(|l| l.starts_with("slfh,2,still-life,") && l.contains(",Random pupils,"))
        .map(|l| l.split(',').nth(10).unwrap().parse().unwrap())
        .collect();
    assert_eq!(random.len(), 72);
    let summary = read(at, "summary.csv");
    let line = summary.lines().find(|l| l.starts_with("slfh,2,still-life,Random pupils,72,")).expect("a summary");
    let mean: f64 = line.split(',').nth(5).unwrap().parse().unwrap();
    assert!((mean - random.iter().sum::<f64>() / 72.0).abs() < 1e-3, "{line}");
    assert!(summary.lines().any(|l| l.starts_with("dpac,1,all scenes,Focal stack,54,")));
    // Four pupils of each group are judged, with all colors together.
    let judged = scores.lines().filter(|l| l.starts_with("slfh,2,still-life,red,") && !l.ends_with(',')).count();
    assert_eq!(judged, 20);
    assert!(report["runs"][0]["groups"]["random_pupils"]["jod"]["mean"].as_f64().is_some_and(|jod| jod < 10.0));

    common::figures_of(&at.join("out"), "report.html");
    let page = read(at, "report.html");
    assert!(page.starts_with("<!DOCTYPE html>") && page.trim_end().ends_with("</html>"));
    for outside in ["<script", "<link", "src=\"http", "url(", "href=\"http", "@import"] {
        assert!(!page.contains(outside), "{outside}");
    }
    let images = page.matches("<img").count();
    assert!(images > 60 && page.matches("alt=\"").count() == images, "every picture has a text");
    assert_eq!(page.matches("<svg").count(), page.matches("role=\"img\"").count());
    assert!(
        (&report["published"][0]["mean"], page.contains("28.6")) == (&28.6.into(), true),
        "{}",
        report["published"]
    );
    // Base64 can contain any word by chance.
    let words: String = page.split("base64,").map(|p| p.split_once('"').map_or(p, |(_, rest)| rest)).collect();
    for word in ["NaN", "inf", "∞"] {
        let at = words.find(word).map(|i| words[i.saturating_sub(60)..].chars().take(100).collect::<String>());
        assert_eq!(at, None, "{word}");
    }
}

#[test]
fn what_is_done_is_not_done_again() {
    let temp = tempfile::tempdir().unwrap();
    let at = temp.path();
    let run = |more: &[&str]| {
        done(
            at,
            &evaluate(
                &["builtin:plane"],
                &[&["--color", "green", "--methods", "slfh,lf2fs", "--set", "compare.speckle=false"], more].concat(),
            ),
        )
    };
    run(&[]);
    let names = ["results/plane-slfh-8.json", "results/plane-lf2fs-8.json", "holograms/plane-slfh-8.zarr/zarr.json"];
    let first = names.map(|n| written(at, n));
    let scores = read(at, "scores.csv");
    run(&[]);
    assert_eq!(first, names.map(|n| written(at, n)), "nothing was computed again");
    // A damaged or missing result is measured again from the existing hologram.
    std::fs::write(at.join("out").join(names[0]), "{").unwrap();
    std::fs::remove_file(at.join("out").join(names[1])).unwrap();
    run(&[]);
    assert!(written(at, names[0]) > first[0] && written(at, names[1]) > first[1]);
    assert_eq!(written(at, names[2]), first[2]);
    assert_eq!(read(at, "scores.csv"), scores);
    // Another seed gives another hologram.
    run(&["--seed", "3"]);
    assert!(written(at, names[2]) > first[2] && read(at, "scores.csv") != scores);
}

#[test]
#[cfg(unix)]
fn an_interrupted_evaluation_goes_on_where_it_was() {
    let temp = tempfile::tempdir().unwrap();
    let at = temp.path();
    let args = [
        "eval",
        "compare",
        "builtin:still-life",
        "--size",
        "64x64",
        "--steps",
        "60",
        "--methods",
        "dpac,slfh,lf2fs,stft,pupil-aware",
        "--frames",
        "4,8",
        "--engine",
        "cpu",
        "-o",
        "out",
    ];
    let mut child =
        command(at, &args).stderr(std::process::Stdio::null()).stdout(std::process::Stdio::piped()).spawn().unwrap();
    let first = at.join("out/results/still-life-dpac-4.json");
    let start = Instant::now();
    while !first.exists() {
        assert!(start.elapsed() < Duration::from_secs(120), "no result after two minutes");
        std::thread::sleep(Duration::from_millis(10));
    }
    let killed = Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap();
    assert!(killed.success());
    assert!(child.wait().unwrap().success());
    let report: serde_json::Value = serde_json::from_str(&read(at, "report.json")).unwrap();
    let warnings = || read(at, "report.html").matches("class=\"warn\"").count();
    let before = warnings();
    assert!(report["missing"].as_u64().unwrap() > 0 && before > 0);
    let kept = written(at, "results/still-life-dpac-4.json");
    done(at, &[&args[..], &["--set", "compare.speckle=false"]].concat());
    let report: serde_json::Value = serde_json::from_str(&read(at, "report.json")).unwrap();
    assert_eq!((report["missing"].as_u64(), report["runs"].as_array().unwrap().len()), (Some(0), 10));
    assert!(warnings() < before, "the page warns while results are missing");
    assert_eq!(written(at, "results/still-life-dpac-4.json"), kept);
}

#[test]
fn holograms_that_exist_are_measured_as_they_are() {
    let temp = tempfile::tempdir().unwrap();
    let at = temp.path();
    let solve = |size, out| {
        done(
            at,
            &[
                "solve",
                "builtin:plane",
                "--size",
                size,
                "--steps",
                "3",
                "--color",
                "green",
                "--engine",
                "cpu",
                "-o",
                out,
            ],
        );
    };
    solve("40x48", "mine.zarr");
    solve("32x32", "other.zarr");
    let wrong = [
        "eval",
        "compare",
        "builtin:plane",
        "--hologram",
        "mine=mine.zarr",
        "--hologram",
        "other=other.zarr",
        "-o",
        "out",
    ];
    refused(at, &wrong, "quality/input/size other.zarr 32");
    refused(at, &evaluate(&["builtin:plane"], &["--hologram", "mine=mine.zarr"]), "quality/input/colors --color");
    refused(
        at,
        &evaluate(&["builtin:plane"], &["--color", "green", "--hologram", "slfh=mine.zarr"]),
        "quality/input/name-of-a-method",
    );
    refused(
        at,
        &evaluate(&["builtin:plane"], &["--color", "green", "--hologram", "x=none.zarr"]),
        "file/read none.zarr",
    );
    refused(at, &evaluate(&["builtin:plane"], &["--hologram", "mine.zarr"]), "usage/value-validation NAME=FILE");
    let two = evaluate(&["builtin:chart", "builtin:points"], &["--color", "green", "--hologram", "mine=mine.zarr"]);
    refused(at, &two, "quality/input/other-scene");
    // The comparison reads the size and the colors from the hologram.
    done(
        at,
        &["eval", "compare", "builtin:plane", "--hologram", "Mine & <co>=mine.zarr", "--engine", "cpu", "-o", "out"],
    );
    let report: serde_json::Value = serde_json::from_str(&read(at, "report.json")).unwrap();
    assert_eq!(report["about"]["size"], serde_json::json!([40, 48]));
    assert_eq!(report["runs"][0]["method"], "Mine & <co>");
    let page = read(at, "report.html");
    assert!(page.contains("Mine &amp; &lt;co&gt;") && !page.contains("<co>"));
    // One color has a header line and 92 pupils.
    assert!(read(at, "scores.csv").lines().count() == 93);
}

#[test]
fn mistakes_are_one_line_and_leave_nothing() {
    let temp = tempfile::tempdir().unwrap();
    let at = temp.path();
    refused(at, &evaluate(&["builtin:plane"], &["--methods", "slfh,magic"]), "arguments/no-such-method 'magic' lf2fs");
    refused(at, &evaluate(&[], &[]), "usage/missing-required-argument");
    refused(at, &evaluate(&["none"], &[]), "scene/not-found");
    refused(at, &evaluate(&["builtin:none"], &[]), "scene/builtin/no-such-scene still-life");
    refused(at, &evaluate(&["builtin:plane", "builtin:plane"], &[]), "arguments/scene-twice");
    refused(at, &evaluate(&["builtin:plane"], &["--frames", "0"]), "arguments/frames");
    refused(at, &evaluate(&["builtin:plane"], &["--pupils", "0"]), "solve/setting pupils");
    refused(at, &evaluate(&["builtin:plane"], &["--pupil-diameter", "0..2"]), "usage/value-validation");
    refused(at, &evaluate(&["builtin:plane"], &["--display", "none"]), "optics/unknown-display");
    refused(at, &evaluate(&["builtin:plane", "builtin:chart"], &["--depth-map", "d.png"]), "scene/maps");
    refused(at, &evaluate(&["builtin:plane"], &["--set", "compare.reference=none.csv"]), "quality/input none.csv");
    std::fs::write(at.join("bad.csv"), "method,mean\nslfh,1\n").unwrap();
    refused(
        at,
        &evaluate(&["builtin:plane"], &["--set", "compare.reference=bad.csv"]),
        "quality/input/columns bad.csv",
    );
    let mut zero = evaluate(&["builtin:plane"], &[]);
    zero[6] = "0";
    refused(at, &zero, "arguments/steps --steps");
    // The pictures of the folders have different sizes, and no option states the size of the display.
    views(at, "wide", "20x40");
    views(at, "tall", "40x36");
    refused(at, &["eval", "compare", "wide", "tall", "--engine", "cpu", "-o", "out"], "arguments/sizes 40 36 20");
    // A missing view is found before anything is written.
    std::fs::remove_file(at.join("wide/view_02.png")).unwrap();
    refused(at, &evaluate(&["builtin:plane", "wide"], &[]), "scene/missing-view");
    // A file has the name of the folder, or of its parent.
    std::fs::write(at.join("file"), "kept").unwrap();
    let mut into = evaluate(&["builtin:plane"], &[]);
    for (place, what) in [("file", "file/taken/is-a-file"), ("file/out", "file/taken/not-ours")] {
        *into.iter_mut().find(|a| **a == "out" || a.starts_with("file")).unwrap() = place;
        refused(at, &into, what);
    }
    assert_eq!(std::fs::read_to_string(at.join("file")).unwrap(), "kept");
}
