//! The keys of every report that `--json` prints, and the page that lists them.
//!
//! `EYEBOX_WRITE=1 cargo test -p eyebox-tools --test command reports` writes docs/json.md again.

use crate::common::{done, folder, json};
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write;
use std::path::Path;

const HEAD: &str = "# Reports in JSON

This page is for programs that read what the command prints with `--json`. A test runs each command and writes its keys here.

Every report is one object on one line of standard output. `schema` has the command and the version of its keys, such as `solve/1`. The
version rises when a key goes or changes its meaning. New keys do not change it. Keys are in snake case and end in their unit, such as
`_mm`, `_db` or `_ms`. A number that does not exist is `null`. Some keys are names, such as colors, kernels and settings. The lists
show the keys of one example, and other calls may have more.

`tracker watch` and `tracker record` print one object per sample instead ([trackers](trackers.md)), and `display calibrate` prints its
report as [calibration](calibrate.md) describes it. [Phase light modulators](plm.md) has the report of `display connect`. An error is
one object on standard error with `code`, `message` and `fields`.
";

/// The reports of the page, with a heading and the words of a command that prints one.
const REPORTS: [(&str, &str); 21] = [
    ("demo", "demo --size 32 --engine cpu --quality fast --out demo --json"),
    ("solve", "solve builtin:plane --size 16 --frames 1 --steps 1 --color green --engine cpu -o h.zarr --json"),
    (
        "solve SCENE SCENE",
        "solve builtin:plane builtin:points --size 16 --frames 1 --steps 1 --color green --engine cpu -o s.zarr --json",
    ),
    ("solve --dry-run", "solve builtin:plane --size 16 --frames 1 --color green --engine cpu --dry-run --json"),
    ("refine", "refine h.zarr --pupil=0,0,2,0 --steps 1 --engine cpu --json"),
    ("render --pupil", "render h.zarr --pupil=0,0,2,0 --engine cpu -o x.png --json"),
    ("render --path", "render h.zarr --path path.json --engine cpu -o x.y4m --json"),
    ("show", "show h.zarr --display grey8 --duration 0.2 --clock simulated --json"),
    (
        "show --tracker",
        "show h.zarr --display grey8 --tracker simulated --duration 0.2 --clock simulated --set show.step_time=5 --engine cpu --json",
    ),
    ("encode", "encode h.zarr -o frames --json"),
    ("info SCENE", "info builtin:plane --size 16 --color green --json"),
    ("info HOLOGRAM", "info h.zarr --json"),
    ("info RECORDING", "info eye.jsonl --json"),
    ("convert", "convert h.zarr phases.npy --json"),
    ("eval score", "eval score h.zarr --test-pupils random:2 --jod none --engine cpu --json"),
    (
        "eval compare",
        "eval compare builtin:plane --size 16 --color green --methods slfh --frames 1 --steps 1 --jod none --engine cpu -o compared --json",
    ),
    (
        "eval gaze",
        "eval gaze h.zarr --display grey8 --duration 0.2 --set gaze.step_time=5 --jod none --engine cpu -o study --json",
    ),
    (
        "eval tune",
        "eval tune builtin:plane --size 16 --color green --duration 1 --jod none --no-store --engine cpu -o tuned --json",
    ),
    ("display list", "display list --json"),
    ("display check", "display check paper --json"),
    ("device list", "device list --json"),
];

#[test]
fn every_report_names_its_schema_and_the_page_lists_its_keys() {
    let temp = folder();
    let at = temp.path();
    std::fs::write(at.join("path.json"), r#"{"keys": [{"t_s": 0, "x_mm": -1}, {"t_s": 0.1, "x_mm": 1}]}"#).unwrap();
    let mut page = HEAD.to_owned();
    for (name, words) in REPORTS {
        if name == "info RECORDING" {
            done(at, &"tracker record simulated:3 --duration 0.1 -o eye.jsonl".split(' ').collect::<Vec<_>>());
        }
        if name == "device list" {
            // The list has the results of the last test.
            done(at, &["device", "test"]);
        }
        let report = json(at, &words.split(' ').collect::<Vec<_>>());
        let commands = words.split(' ').take(
            if words.starts_with("eval") || words.starts_with("d") && !words.starts_with("demo") { 2 } else { 1 },
        );
        let schema = format!("{}/1", commands.collect::<Vec<_>>().join("-"));
        assert_eq!(report["schema"], schema.as_str(), "{words}");
        let mut keys = keys(&report);
        if name == "eval tune" {
            // Numbers of levels are compared if the budget has time left, which depends on the machine.
            keys.retain(|key, _| key != "levels" && !key.starts_with("levels[]"));
            keys.insert("levels".into(), ["list"].into());
        }
        let _ = write!(page, "\n## {name}\n\n```text\n");
        for (key, kinds) in &keys {
            assert!(key.chars().all(|c| !c.is_uppercase() && c != ' '), "{name}: the key {key}");
            let kinds: Vec<&str> = kinds.iter().copied().collect();
            let _ = writeln!(page, "{key:44} {}", kinds.join(" or "));
        }
        page += "```\n";
    }
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("the workspace").join("docs/json.md");
    if std::env::var_os("EYEBOX_WRITE").is_some() {
        std::fs::write(&file, &page).expect("the page");
    }
    let kept = std::fs::read_to_string(&file).unwrap_or_default().replace("\r\n", "\n");
    let differing = page.lines().zip(kept.lines()).find(|(new, old)| new != old);
    assert!(
        kept == page,
        "docs/json.md is not what the command prints (first: {differing:?}): EYEBOX_WRITE=1 writes it"
    );
}

/// Returns the keys of a report with the kinds of their values. `a.b` is a key within `a`, and `a[]` represents the
/// elements of a list.
fn keys(report: &Value) -> BTreeMap<String, BTreeSet<&'static str>> {
    let mut all = BTreeMap::new();
    collect("", report, &mut all);
    all
}

fn collect(path: &str, value: &Value, all: &mut BTreeMap<String, BTreeSet<&'static str>>) {
    let kind = match value {
        Value::Object(fields) => {
            let dot = if path.is_empty() { "" } else { "." };
            fields.iter().for_each(|(key, value)| collect(&format!("{path}{dot}{key}"), value, all));
            return;
        }
        Value::Array(elements) if elements.is_empty() => "empty list",
        Value::Array(elements) => {
            elements.iter().for_each(|element| collect(&format!("{path}[]"), element, all));
            return;
        }
        Value::Null => "null",
        Value::Bool(_) => "truth",
        Value::Number(_) => "number",
        Value::String(_) => "text",
    };
    all.entry(path.to_owned()).or_default().insert(kind);
}
