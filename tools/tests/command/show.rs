//! `eyebox show` with each kind of content.

use super::common::{self, Printed, done, refused, text};
use serde_json::Value;
use std::path::Path;
use std::process::{Child, Stdio};
use std::time::{Duration, Instant};

const SIZE: [&str; 6] = ["--size", "32x32", "--color", "green", "--engine", "cpu"];
const SIMULATED: [&str; 6] = ["--tracker", "simulated", "--clock", "simulated", "--set", "show.step_time=3"];

fn json(file: &Path) -> Value {
    serde_json::from_slice(&std::fs::read(file).expect("a file")).expect("JSON")
}

fn run(at: &Path, all: &[&[&str]]) -> String {
    let answer = common::eyebox(at, &all.concat());
    let said = text(&answer.stderr);
    assert!(answer.status.success(), "{all:?}: {said}");
    said
}

/// Returns the name and the bytes of each file of a recording, which are the pictures and their times.
fn recorded(folder: &Path) -> Vec<(String, Vec<u8>)> {
    let file = |e: std::io::Result<std::fs::DirEntry>| {
        let e = e.expect("an entry");
        (e.file_name().to_string_lossy().into_owned(), std::fs::read(e.path()).expect("bytes"))
    };
    let mut all: Vec<_> = std::fs::read_dir(folder).expect("a recording").map(file).collect();
    all.sort();
    assert!(all.len() > 2, "{} files", all.len());
    all
}

fn sequence(at: &Path) {
    let scenes = ["builtin:still-life?shift=0", "builtin:still-life?shift=0.1", "builtin:still-life?shift=0.2"];
    let solve = ["--steps", "3", "--frames", "8", "--views", "3", "--rate", "20", "-o", "s.zarr"];
    done(at, &[&["solve"], &scenes[..], &solve, &SIZE].concat());
}

/// A solved hologram is shown with the same bytes with and without its size. One scene or several scenes are solved
/// first.
#[test]
fn holograms_sequences_and_scenes_are_shown() {
    let temp = common::folder();
    let at = temp.path();
    sequence(at);
    let display = ["--display", "planes8"];
    run(at, &[&["show", "s.zarr", "--record", "sized", "--size", "32x32", "--engine", "cpu"], &display]);
    run(at, &[&["show", "s.zarr", "--record", "shown", "--engine", "cpu"], &display]);
    assert!(recorded(&at.join("sized")) == recorded(&at.join("shown")));
    let brief = ["--clock", "simulated", "--duration", "0.2", "--quality", "fast", "--views", "3"];
    let said = run(at, &[&["show", "builtin:plane", "--record", "one"], &brief, &display, &SIZE]);
    // The text has the number of holograms and their size.
    assert!(said.lines().any(|line| line.has_sequence(&[1.0, 32.0, 32.0])), "{said}");
    assert!(recorded(&at.join("one")).iter().any(|f| f.0.starts_with("set-000000")));
    let two = ["show", "builtin:plane", "builtin:plane?shift=0.1", "--rate", "10", "--stats", "s.json"];
    let said = run(at, &[&two, &brief, &display, &SIZE]);
    assert!(said.lines().any(|line| line.has_sequence(&[2.0, 10.0, 32.0, 32.0])), "{said}");
    // Ten holograms per second for 0.2 s are two holograms.
    assert_eq!(json(&at.join("s.json"))["content_shown"], 2);
    // The settings decide the sub-frames if the option does not.
    let said = run(at, &[&two, &brief, &display, &SIZE, &["--set", "frames=16"]]);
    assert!(said.lines().any(|line| line.has_sequence(&[2.0, 10.0, 32.0, 32.0, 16.0])), "{said}");
}

/// A far field in tiles is shown whole.
#[test]
fn a_far_field_in_tiles_is_shown() {
    let temp = common::folder();
    let at = temp.path();
    let far = "name = \"far\"\nresolution = [96, 96]\npitch_um = 8.0\nfocal_length_mm = 400.0\n\
               wavelengths_nm = { green = 520 }\ngeometry = \"far-field\"\n";
    std::fs::write(at.join("far.toml"), far).unwrap();
    let solve =
        ["solve", "builtin:still-life", "--display", "far.toml", "--memory", "600MiB", "--set", "tiles.picture=64"];
    done(
        at,
        &[&solve[..], &["--set", "tiles.passes=1", "--steps", "1", "--frames", "1", "--engine", "cpu", "-o", "f.zarr"]]
            .concat(),
    );
    let show = ["show", "f.zarr", "--display", "far.toml", "--color", "green", "--duration", "0.1", "--record", "r"];
    run(at, &[&show, &["--engine", "cpu"]]);
    assert!(recorded(&at.join("r")).iter().any(|f| f.0.starts_with("set-000000")));
}

/// A far field in tiles is refined around the eye, piece after piece. The rest of it stays lit. A second run is
/// identical.
#[test]
fn a_far_field_in_tiles_is_shown_and_steered() {
    let temp = common::folder();
    let at = temp.path();
    let far = "name = \"far\"\nresolution = [1024, 1024]\npitch_um = 16.0\nfocal_length_mm = 400.0\n\
               wavelengths_nm = { green = 520 }\ngeometry = \"far-field\"\n";
    std::fs::write(at.join("far.toml"), far).unwrap();
    let solve =
        ["solve", "builtin:still-life", "--display", "far.toml", "--memory", "1GiB", "--set", "tiles.picture=64"];
    let quick =
        ["--set", "tiles.passes=1", "--steps", "1", "--frames", "1", "--pupil-diameter", "2..4", "--engine", "cpu"];
    done(at, &[&solve[..], &quick, &["-o", "f.zarr"]].concat());
    let show =
        ["show", "f.zarr", "--display", "far.toml", "--color", "green", "--engine", "cpu", "--tracker", "simulated:3"];
    let time = ["--clock", "simulated", "--set", "show.step_time=5", "--duration", "0.8"];
    let said = run(at, &[&show, &time, &["--stats", "s.json", "--output", "raw:one.raw"]]);
    // The line has the size of the hologram and the size of its tiles.
    assert!(said.lines().any(|line| line.has_sequence(&[1024.0, 1024.0, 64.0])), "{said}");
    let stats = json(&at.join("s.json"));
    let content = &stats["content"];
    let count = |of: &Value, name: &str| of[name].as_u64().unwrap_or_else(|| panic!("{name} in {of}"));
    assert!(count(content, "scenes") >= 2, "the eye goes from piece to piece: {content}");
    assert_eq!((count(content, "refused"), count(&content["sets"], "late_content")), (0, 0), "{content}");
    assert!(count(&stats, "steps") > 50, "{stats}");
    run(at, &[&show, &time, &["--output", "raw:two.raw"]]);
    let read = |file: &str| std::fs::read(at.join(file)).unwrap();
    let one = read("one.raw");
    assert!(one == read("two.raw"));
    // Much of the content stays between the first and the last set, and much changes.
    let frames: Vec<&[u8]> = one.chunks(1024 * 1024).collect();
    let mut content = frames.into_iter().filter(|frame| frame.iter().any(|b| *b != frame[0]));
    let (first, last) = (content.next().expect("content"), content.next_back().expect("more of it"));
    let changed = first.iter().zip(last).filter(|(a, b)| a != b).count();
    let share = changed as f64 / first.len() as f64;
    assert!((0.02..0.9).contains(&share), "{share} of the pixels changed");
}

/// Every hologram of a sequence is refined for its own scene before it is lit. On a simulated clock, a second run is
/// identical.
#[test]
fn a_sequence_is_steered() {
    let temp = common::folder();
    let at = temp.path();
    sequence(at);
    let show = ["show", "s.zarr", "--display", "planes8", "--engine", "cpu", "--loop", "--duration", "0.5"];
    run(at, &[&show, &SIMULATED, &["--stats", "s.json", "--trace", "t.json", "--record", "one"]]);
    run(at, &[&show, &SIMULATED, &["--record", "two"]]);
    assert!(recorded(&at.join("one")) == recorded(&at.join("two")));
    let stats = json(&at.join("s.json"));
    let content = &stats["content"];
    let count = |of: &Value, name: &str| of[name].as_u64().unwrap_or_else(|| panic!("{name} in {of}"));
    // The first hologram starts 0.5 s at 20 holograms per second, which are about ten.
    assert!((9..=11).contains(&count(content, "shown")), "{content}");
    assert_eq!((count(content, "scenes") - count(content, "shown") <= 1, count(content, "refused")), (true, 0));
    assert!(count(content, "began_with_own_phases") + count(content, "went_on_with_phases_before") >= 8, "{content}");
    assert!(count(&stats, "steps") > 30 && count(&content["sets"], "late_content") == 0, "{stats}");
    let trace = json(&at.join("t.json"));
    let sets: Vec<&Value> = trace.as_array().unwrap().iter().filter(|e| e["name"] == "set").collect();
    assert_eq!(sets.len() as u64, count(&stats, "sets_new"));
    let frames: std::collections::BTreeSet<u64> =
        sets.iter().filter_map(|s| s["args"]["content_frame"].as_u64()).collect();
    assert_eq!(frames.len() as u64, count(content, "shown"), "{frames:?}");
    // Without --loop, the show ends at the end of the sequence.
    let end = ["show", "s.zarr", "--display", "planes8", "--engine", "cpu", "--stats", "e.json"];
    run(at, &[&end, &SIMULATED]);
    assert_eq!(json(&at.join("e.json"))["ended_by"], "the end");
    let real = ["show", "s.zarr", "--tracker", "simulated", "--loop", "--display", "planes8", "--engine", "cpu"];
    run(at, &[&real, &["--duration", "0.3", "--stats", "l.json"]]);
    assert_eq!(json(&at.join("l.json"))["content"]["refused"], 0);
}

fn wait_for(what: &str, mut done: impl FnMut() -> bool) {
    let since = Instant::now();
    while !done() {
        assert!(since.elapsed() < Duration::from_secs(120), "{what}");
        std::thread::sleep(Duration::from_millis(20));
    }
}

fn start(at: &Path, all: &[&[&str]]) -> Child {
    let mut command = common::command(at, &all.concat());
    command.env("XDG_RUNTIME_DIR", at).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("it starts")
}

/// An application sends the requested content, is killed and starts again. The picture stays, and the statistics have
/// the cause.
#[test]
#[cfg(target_os = "linux")]
fn an_application_is_shown_killed_and_shown_again() {
    let temp = common::folder();
    let at = temp.path();
    let show =
        ["show", "live:demo", "--display", "planes8", "--views", "3", "--tracker", "simulated", "--stats", "s.json"];
    let kept = ["--journal", "kept", "--output", "raw:live.raw"];
    let mut display = start(at, &[&show, &SIZE, &kept, &["--trace", "t.json"]]);
    wait_for("its socket", || at.join("eyebox/demo.sock").exists());
    let feed = [
        "feed",
        "builtin:still-life",
        "--name",
        "demo",
        "--rate",
        "20",
        "--move=shift=-0.1..0.1",
        "--move-frames",
        "3",
    ];
    let gives = [&feed[..], &["--per-pupil", "--json", "--display", "planes8"]].concat();
    let shown = |least: u64| {
        let trace = std::fs::read_to_string(at.join("t.json")).unwrap_or_default();
        trace.lines().filter(|l| l.contains("\"content\":\"new\"")).count() as u64 >= least
    };
    let mut first = start(at, &[&gives]);
    wait_for("the first application's frames", || shown(3));
    first.kill().unwrap();
    first.wait().unwrap();
    let gone = || std::fs::read_to_string(at.join("t.json")).unwrap_or_default().contains("application gone");
    wait_for("its end in the trace", gone);
    let before = {
        let trace = std::fs::read_to_string(at.join("t.json")).unwrap_or_default();
        trace.lines().filter(|l| l.contains("\"content\":\"new\"")).count() as u64
    };
    let second = start(at, &[&gives, &["--count", "1000"]]);
    wait_for("the second application's frames", || shown(before + 3));
    assert!(std::process::Command::new("kill").args(["-INT", &display.id().to_string()]).status().unwrap().success());
    let ended = display.wait().unwrap();
    let said = second.wait_with_output().unwrap();
    assert!(ended.success() && said.status.success(), "{}", text(&said.stderr));
    let given: Value = serde_json::from_slice(&said.stdout).expect("statistics");
    assert_eq!(given["ended"], "the display is gone");
    let stats = json(&at.join("s.json"));
    let content = &stats["content"];
    assert_eq!(content["source"], "live:demo");
    let sets = content["sets"].as_object().unwrap();
    assert!(sets["new"].as_u64().unwrap() >= 6 && sets["application_gone"].as_u64().unwrap() >= 1, "{content}");
    assert_eq!(content["shown"], sets["new"]);
    assert!(content["arrival_to_light_ms"]["count"].as_u64().unwrap() >= 6, "{content}");
    // The journal is shown again without the application, without the eye and without the time of the computation. The
    // bytes are the same.
    let again =
        ["show", "live:demo", "--display", "planes8", "--views", "3", "--replay", "kept", "--output", "raw:again.raw"];
    run(at, &[&again, &SIZE]);
    let shown = |file: &str| {
        let bytes = std::fs::read(at.join(file)).unwrap();
        let frames: Vec<Vec<u8>> = bytes.chunks(32 * 32).map(<[u8]>::to_vec).collect();
        let content = |frame: &&Vec<u8>| frame.iter().any(|b| *b != frames[0][0]);
        frames.iter().filter(content).cloned().collect::<Vec<_>>()
    };
    let (live, again) = (shown("live.raw"), shown("again.raw"));
    assert!(live.len() > 6 && live == again, "{} video frames, {} again", live.len(), again.len());
}

/// The content moves as a whole. Its sub-frames are refined with motion compensation, and the phases move with the
/// content. `show.moments=off` switches both off. On a simulated clock, a second run is identical.
#[test]
fn content_that_moves_is_refined_for_its_moments() {
    let temp = common::folder();
    let at = temp.path();
    let scenes: Vec<String> = (0..6).map(|i| format!("builtin:plane?shift={}", 0.05 * f64::from(i))).collect();
    let scenes: Vec<&str> = scenes.iter().map(String::as_str).collect();
    let solve =
        ["--steps", "3", "--frames", "8", "--views", "3", "--rate", "30", "--size", "64x64", "--color", "green"];
    done(at, &[&["solve"], &scenes[..], &solve, &["--engine", "cpu", "-o", "s.zarr"]].concat());
    let show = ["show", "s.zarr", "--display", "planes8", "--engine", "cpu", "--duration", "0.3", "--loop"];
    let count = |name: &str| json(&at.join("s.json"))[name].as_u64().unwrap();
    for raw in ["raw:one.raw", "raw:two.raw"] {
        run(at, &[&show, &SIMULATED, &["--stats", "s.json", "--output", raw]]);
        assert!(count("sets_moving") >= 5 && count("phases_moved") >= 5, "{}", json(&at.join("s.json")));
    }
    run(at, &[&show, &SIMULATED, &["--stats", "s.json", "--output", "raw:off.raw", "--set", "show.moments=off"]]);
    assert_eq!((count("sets_moving"), count("phases_moved")), (0, 0));
    let read = |file: &str| std::fs::read(at.join(file)).unwrap();
    assert!(read("one.raw") == read("two.raw") && read("one.raw") != read("off.raw"));
}

#[test]
fn what_does_not_go_together_is_one_line() {
    let temp = common::folder();
    let at = temp.path();
    sequence(at);
    let show = |what: &'static str, more: &[&'static str]| [&["show", what, "--display", "planes8"][..], more].concat();
    refused(at, &show("missing.zarr", &[]), "x", "file/read missing.zarr");
    refused(at, &show("s.zarr", &["--set", "show.step_time=3"]), "x", "arguments/without-tracker --tracker");
    refused(
        at,
        &show("s.zarr", &["--tracker", "simulated", "--clock", "simulated"]),
        "x",
        "arguments/no-step-time show.step_time",
    );
    refused(
        at,
        &show("s.zarr", &["--tracker", "simulated", "--set", "show.step_time=3"]),
        "x",
        "arguments/step-time --clock",
    );
    refused(
        at,
        &show("s.zarr", &["--tracker", "simulated", "--set", "show.speed=2"]),
        "x",
        "arguments/with-tracker show.speed",
    );
    refused(at, &show("s.zarr", &["builtin:plane"]), "x", "arguments/shown-alone");
    refused(at, &show("live:../x", &SIZE), "x", "session/live-input");
    refused(at, &show("live:x", &["--clock", "simulated", "--set", "show.step_time=3"]), "x", "arguments/live");
    refused(at, &show("s.zarr", &["--journal", "x"]), "x", "arguments/journal-without-live");
    common::refusal(at, &[&show("live:x", &["--replay", "s.zarr"])[..], &SIZE].concat()).is("file/read decisions");
    // The output is checked before any work, and before the scene, which does not exist.
    refused(at, &show("builtin:nothing", &["--output", "raw:s.zarr/zarr.json"]), "x", "file/taken/exists");
    refused(at, &["eval", "gaze", "s.zarr", "--display", "planes8", "-o", "x"], "x", "arguments/sequence");
}

/// Phases that are shown as they were solved have no use for settings of solves, which are refused and not ignored.
#[test]
fn settings_of_solves_are_refused_for_phases_that_are_not_refined() {
    let temp = common::folder();
    let at = temp.path();
    sequence(at);
    let show = ["show", "s.zarr", "--display", "planes8", "--engine", "cpu"];
    for (more, what) in [
        (&["--quality", "fast"][..], "arguments/quality-of-phases"),
        (&["--set", "steps=9"], "arguments/settings-of-phases"),
        (&["--set", "refine.pupils=9"], "arguments/settings-of-phases"),
    ] {
        refused(at, &[&show, more].concat(), "none", what);
    }
    run(at, &[&show, &["--set", "show.mark=8"]]);
    let render = ["render", "s.zarr", "--at", "0", "--pupil=0,0,4,0", "--quality", "fast", "-o", "r.png"];
    refused(at, &render, "r.png", "arguments/quality-of-phases");
}
