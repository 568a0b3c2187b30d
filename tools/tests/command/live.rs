//! `eyebox eval gaze` and `eyebox show --tracker` as a user runs them.

use crate::common::desk::Desk;
use crate::common::screen::Screen;
use crate::common::{self, Printed};
use crate::common::{done, folder, refused, text};
use serde_json::Value;
use std::path::Path;
use std::process::{Child, Stdio};
use std::time::{Duration, Instant};

const ESCAPE: u32 = 0xff1b;
const S: u32 = 0x73;

fn solved(at: &Path) {
    let solve = ["solve", "builtin:still-life", "--size", "64x72", "--steps", "12", "--color", "green"];
    done(at, &[&solve[..], &["--engine", "cpu", "-o", "h.zarr"]].concat());
}

fn json(file: &Path) -> Value {
    serde_json::from_slice(&std::fs::read(file).expect("a file")).expect("JSON")
}

#[test]
fn a_study_says_what_steering_gains_and_shows_it() {
    let temp = folder();
    let at = temp.path();
    solved(at);
    let study = ["eval", "gaze", "h.zarr", "--display", "planes8", "--duration", "1", "--engine", "cpu", "--json"];
    // At 20 pixels per degree, the grain of the picture is visible.
    let large = ["--set", "gaze.step_time=4", "--set", "viewing.pixels_per_degree=20", "-o", "out"];
    let said: Value = serde_json::from_str(&done(at, &[&study[..], &large].concat())).expect("one object");
    let all = json(&at.join("out/study.json"));
    let moments = all["study"]["moments"].as_array().unwrap();
    assert!((58..=61).contains(&moments.len()), "{} sets in a second", moments.len());
    let landed = moments.iter().filter(|m| m["since_landing_ms"].as_f64().is_some_and(|t| t > 150.0));
    let gains: Vec<f64> = landed.map(|m| m["steered_db"].as_f64().unwrap() - m["whole_db"].as_f64().unwrap()).collect();
    let mean = gains.iter().sum::<f64>() / gains.len() as f64;
    assert!(mean > 0.5, "{mean} dB");
    assert_eq!(said["summary"], all["summary"]);
    // Only the last set of a complete fixation is judged. The gain of the refinement is visible.
    let judged = moments.iter().filter(|m| !m["jod"].is_null()).count() as u64;
    assert!(judged > 0 && judged == all["summary"]["fixations"], "{judged} sets are judged");
    let jod = |which: &str| all["summary"]["end_of_fixation_jod"][which].as_f64().unwrap();
    let (steered, unsteered) = (jod("steered"), jod("unsteered"));
    assert!(unsteered < steered && steered < 10.0, "{steered} JOD, unsteered {unsteered}");
    let page = std::fs::read_to_string(at.join("out/study.html")).unwrap();
    assert!(page.contains(&format!("{steered:.2} JOD")) && page.contains(&format!("{unsteered:.2} JOD")));
    assert_eq!(page.matches("<svg").count(), 2);
    assert!(page.matches("<circle").count() > 20);
    common::figures_of(&at.join("out"), "study.html");
}

/// Content rests or moves, with and without refinement and motion compensation. The page, the JSON and a table have the
/// results.
#[test]
fn a_study_of_content_says_what_moments_gain() {
    let temp = folder();
    let at = temp.path();
    solved(at);
    let study = [
        "eval",
        "gaze",
        "h.zarr",
        "--display",
        "planes8",
        "--engine",
        "cpu",
        "--set",
        "gaze.fixation=100000",
        "--set",
        "gaze.tracker_noise=0.02",
    ];
    let content = "[gaze]\ncontent = ['still', 'moving']\nsets = 16\nsteps_per_set = 2\nmoves = '8px'\n";
    std::fs::write(at.join("content.toml"), content).unwrap();
    let content = ["--settings", "content.toml"];
    let said: Value = serde_json::from_str(&done(at, &[&study[..], &content, &["--json", "-o", "out"]].concat()))
        .expect("one object");
    let all = json(&at.join("out/study.json"));
    assert_eq!(said["summary"], all["summary"]);
    let runs = all["summary"].as_array().unwrap();
    assert_eq!((runs.len(), all["runs"][0]["samples"].as_array().unwrap().len()), (12, 16));
    let mean = |content: &str, eye: &str, moments: bool| {
        let is = |run: &&Value| {
            run["content"] == content && run["eye"] == eye && run["steered"] == true && run["moments"] == moments
        };
        runs.iter().find(is).unwrap()["mean_db"].as_f64().unwrap()
    };
    let [with, without] = [true, false].map(|moments| mean("moving", "follows", moments));
    assert!(with > without + 0.5, "{with} dB with moments, {without} dB without");
    let page = std::fs::read_to_string(at.join("out/study.html")).unwrap();
    assert_eq!(page.matches("<svg").count(), 3);
    assert!(page.contains(&format!("{with:.2}")) && page.contains(&format!("{without:.2}")));
    common::figures_of(&at.join("out"), "study.html");
    // The content jumps to other scenes. The first jump goes to points and not to the still life's mirror image.
    let jumps = |more: &[&str], out: &str| {
        let how = [
            "--set",
            "gaze.content=jumping",
            "--set",
            "gaze.jumps_every=2",
            "--set",
            "gaze.sets=6",
            "--set",
            "gaze.steps_per_set=1",
            "--json",
        ];
        done(at, &[&study[..], &how, more, &["-o", out]].concat());
        json(&at.join(out).join("study.json"))
    };
    let [mirrored, slides] =
        [jumps(&[], "mirrored"), jumps(&["--set", "gaze.jumps_to=builtin:points,builtin:plane"], "slides")];
    assert_eq!(slides["jumps_to"], serde_json::json!(["builtin:points", "builtin:plane"]));
    let db = |of: &Value, set: usize| of["runs"][0]["samples"][set]["db"].as_f64().unwrap();
    assert_eq!(db(&slides, 1), db(&mirrored, 1));
    assert!((db(&slides, 2) - db(&mirrored, 2)).abs() > 1.0, "{} dB, {} dB", db(&slides, 2), db(&mirrored, 2));
    refused(
        at,
        &[&study[..], &["--set", "gaze.content=flying", "-o", "x"]].concat(),
        "x",
        "arguments/settings-value gaze.content flying",
    );
}

#[test]
fn a_scene_is_solved_and_followed_and_every_set_accounted_for() {
    let temp = folder();
    let at = temp.path();
    let show = ["show", "builtin:still-life", "--size", "64x72", "--color", "green", "--display", "planes8"];
    let more = ["--duration", "1.5", "--stats", "s.json", "--trace", "t.json", "--record", "kept", "--engine", "cpu"];
    done(at, &[&show[..], &more, &["--quality", "fast", "--tracker", "simulated"]].concat());
    let stats = json(&at.join("s.json"));
    let count = |name: &str| stats[name].as_u64().unwrap();
    let sets = stats["playback"]["sets"].as_u64().unwrap() - stats["playback"]["idle_sets"].as_u64().unwrap();
    assert_eq!(count("sets_new") + count("sets_repeated"), sets);
    // The number of sets that are refined in time depends on the machine. The first set exists before the time begins.
    assert!(count("sets_new") >= 1 && count("steps") + 2 >= count("sets_new"), "{stats}");
    let late = stats["playback"]["late_sets"].as_object().unwrap();
    assert!(late.values().all(|v| v == 0), "{late:?}");
    let light = &stats["latency"]["stages"]["sample_to_light_ms"];
    assert!(light["count"].as_u64().unwrap() <= count("sets_new"), "{light}");
    // The middle of a set's light is half a set after its beginning.
    assert!(light["p50"].as_f64().is_none_or(|ms| ms > 8.0), "{light}");
    let trace = json(&at.join("t.json"));
    let names: Vec<&str> = trace.as_array().unwrap().iter().filter_map(|e| e["name"].as_str()).collect();
    for name in ["filter", "encode", "upload", "submit", "present"] {
        assert!(names.contains(&name), "{name}");
    }
    let pictures = std::fs::read_dir(at.join("kept"))
        .unwrap()
        .filter(|e| e.as_ref().is_ok_and(|e| e.path().extension().is_some_and(|x| x == "png")));
    assert!(pictures.count() >= 1);
}

/// A recorded eye focuses near, which the tracker reports, and then far, which the directions of both eyes show. Each
/// set on the display is sharp at the focus of its time.
#[test]
fn the_hologram_follows_a_focus_that_changes() {
    let temp = folder();
    let at = temp.path();
    let bench = done(at, &["display", "show", "grey8"]).replace("focal_length_mm = 400", "focal_length_mm = 100");
    std::fs::write(at.join("bench.toml"), bench).unwrap();
    let optics = ["--display", "bench.toml", "--size", "64x72", "--color", "green", "--engine", "cpu"];
    let scene = "builtin:still-life?span=4";
    let solve = ["solve", scene, "--frames", "1", "--steps", "4", "-o", "h.zarr"];
    done(at, &[&solve[..], &optics].concat());
    // 0.14 dioptres are 1.4 mm at a focal length of 100 mm.
    let degrees = (0.5 * 0.14 * 0.064_f64).atan().to_degrees();
    let line = |i: u32| {
        let (left, more) = if i < 100 { (0.0, "\"focus_d\": 0.14") } else { (-degrees, "\"ipd_mm\": 64") };
        let eye = |x: f64| format!("{{\"x\": {x}, \"y\": 0, \"unit\": \"deg\", \"what\": \"gaze\", \"diameter\": 4}}");
        let (left, right) = (eye(left), eye(-left));
        format!("{{\"t\": {}, \"left\": {left}, \"right\": {right}, {more}}}\n", f64::from(i) / 100.0)
    };
    std::fs::write(at.join("eye.jsonl"), (0..200).map(line).collect::<String>()).unwrap();
    let show =
        ["show", "h.zarr", "--tracker", "eye.jsonl", "--duration", "2.5", "--stats", "s.json", "--record", "kept"];
    done(at, &[&show[..], &optics].concat());
    let stats = json(&at.join("s.json"));
    for (key, nearest) in [("focus_mm", 1.4), ("focus_dioptres", 0.14)] {
        let [far, near] = [0, 1].map(|i| stats[key][i].as_f64().expect("a depth"));
        assert!((near / nearest - 1.0).abs() < 1e-3 && (far / nearest + 1.0).abs() < 0.02, "{key}: {far} to {near}");
    }
    let shown = std::fs::read_to_string(at.join("kept/shown.csv")).unwrap();
    let rows: Vec<Vec<&str>> = shown.lines().skip(1).map(|row| row.split(',').collect()).collect();
    let time = |row: &Vec<&str>| row[1].parse::<f64>().unwrap() * 1e-9;
    let (began, set) = (time(&rows[0]), |row: &&Vec<&str>| row[6].starts_with("set-"));
    let last = |end: f64| rows.iter().rfind(|row| set(row) && time(row) - began < end).expect("a set")[6];
    for (picture, focus) in [(last(0.9), 1.4), (last(9.0), -1.4)] {
        let psnr = |focus: f64| {
            std::fs::write(at.join("pupils.json"), format!("[[0, 0, 4, {focus}]]")).unwrap();
            let picture = format!("kept/{picture}");
            let score = ["eval", "score", "--encoded", &picture, scene, "--test-pupils", "pupils.json", "--json"];
            let said: Value = serde_json::from_str(&done(at, &[&score[..], &optics].concat())).expect("JSON");
            said["psnr_db"]["mean"].as_f64().unwrap_or_else(|| panic!("{said}"))
        };
        let (here, there) = (psnr(focus), psnr(-focus));
        assert!(here > there + 3.0, "{picture}: {here} dB where the eye focuses, {there} dB elsewhere");
    }
}

#[test]
fn mistakes_are_one_line() {
    let temp = folder();
    let at = temp.path();
    solved(at);
    let show = |tracker, more: &[&'static str]| {
        [&["show", "h.zarr", "--display", "planes8", "--tracker", tracker][..], more].concat()
    };
    refused(at, &show("mouse", &[]), "x", "tracker/setting/mouse-without-view --view");
    refused(at, &show("nonsense", &[]), "x", "tracker/spec");
    refused(at, &show("missing.hid", &[]), "x", "tracker/file missing.hid");
    refused(at, &show("simulated", &["--set", "refine.restart=-1"]), "x", "arguments/restart");
    refused(at, &show("simulated", &["--size", "80x80"]), "x", "arguments/size 64x72");
    refused(at, &["show", "missing.zarr", "--tracker", "simulated"], "x", "file/read missing.zarr");
    refused(at, &["eval", "gaze", "h.zarr", "--scene", "builtin:nothing", "-o", "x"], "x", "arguments/other-scene");
    refused(
        at,
        &["eval", "gaze", "h.zarr", "--display", "planes8", "--duration", "0", "-o", "x"],
        "x",
        "usage/value-validation --duration",
    );
}

/// A session that follows no tracker ends with an error.
#[test]
fn a_tracker_that_says_nothing_or_nothing_of_use_ends_with_a_line_and_2() {
    let temp = folder();
    let at = temp.path();
    solved(at);
    let free = std::net::UdpSocket::bind("127.0.0.1:0").and_then(|s| s.local_addr()).expect("a free port").port();
    let silent = format!("udp://:{free}");
    // Counts of a device mean nothing without a calibration.
    let lines: String =
        (0..20).map(|i| format!("{{\"t\": 0.0{i:02}, \"x\": 1, \"y\": 2, \"unit\": \"counts\"}}\n")).collect();
    std::fs::write(at.join("counts.jsonl"), lines).unwrap();
    let show = ["show", "h.zarr", "--display", "planes8", "--engine", "cpu", "--duration", "0.3", "--stats", "s.json"];
    for (tracker, name) in [(&*silent, "udp://"), ("counts.jsonl", "counts.jsonl")] {
        let refusal = common::refusal(at, &[&show[..], &["--tracker", tracker]].concat());
        refusal.is("session/not-followed");
        assert!(refusal.fields["tracker"].as_str().is_some_and(|found| found.contains(name)), "{refusal:?}");
        // The statistics still have the sets that were shown.
        assert_eq!(json(&at.join("s.json"))["ended_by"], "the duration");
    }
    common::refusal(at, &["tracker", "watch", &silent, "--duration", "0.1"]).is("arguments/no-sample");
}

fn start(at: &Path, desk: &Desk, more: &[&str]) -> Child {
    let show = ["show", "h.zarr", "--display", "planes8", "--engine", "cpu", "--view", "--validation"];
    common::command(at, &[&show[..], more].concat())
        .env("DISPLAY", desk.name())
        .env_remove("WAYLAND_DISPLAY")
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .expect("it starts")
}

fn wait_for(what: &str, mut done: impl FnMut() -> bool) {
    let since = Instant::now();
    while !done() {
        assert!(since.elapsed() < Duration::from_secs(60), "{what}");
        std::thread::sleep(Duration::from_millis(20));
    }
}

/// The window covers a whole monitor. At the end, the screen has a video frame of a refined set or the idle picture.
#[test]
fn a_window_shows_what_follows_the_eye() {
    let temp = folder();
    let at = temp.path();
    solved(at);
    let screen = Screen::new(at, [64, 72]);
    let show =
        ["show", "h.zarr", "--display", "planes8", "--tracker", "simulated", "--output", "window", "--validation"];
    // On Vulkan, the engine, the encoder and the window share one device, which has the video frames.
    for engine in ["cpu", "vulkan"] {
        let more = ["--engine", engine, "--duration", "1.5", "--stats", "s.json"];
        let answer = common::command(at, &[&show[..], &more].concat())
            .env("DISPLAY", screen.name())
            .env_remove("WAYLAND_DISPLAY")
            .output()
            .expect("it starts");
        let said = text(&answer.stderr);
        assert!(answer.status.success() && !said.contains("validation:"), "{said}");
        let stats = json(&at.join("s.json"));
        assert!(stats["sets_new"].as_u64().unwrap() >= 1, "{stats}");
        assert!(stats["presenter"].as_str().unwrap().contains("72"), "{}", stats["presenter"]);
    }
    // A monitor of another size is refused.
    let other = Screen::new(temp.path(), [80, 90]);
    let refused = common::command(at, &show).env("DISPLAY", other.name()).env_remove("WAYLAND_DISPLAY").output();
    let refused = refused.expect("it starts");
    assert_eq!(refused.status.code(), Some(2), "{}", text(&refused.stderr));
}

/// The mouse is the eye. The window shows the view of this eye, and a key switches the refinement on and off.
#[test]
fn the_view_follows_the_mouse_and_a_key_stops_steering() {
    let temp = folder();
    let at = temp.path();
    solved(at);
    let desk = Desk::new(at, [720, 900]);
    // Without a tracker, the mouse in the view is the tracker.
    let child = start(at, &desk, &["--stats", "s.json"]);
    // The title of the window has lengths from the first picture on.
    let window = desk.window(" mm");
    // The title has decibels after the first comparison. Before, it has the mode and the place of the pupil.
    let plain = || {
        let title = desk.title(window);
        title.split([',', ';']).filter(|part| !part.has("dB")).collect::<Vec<_>>().join(" ")
    };
    let place = || plain().numbers()[..2].to_vec();
    let words = || plain().split_whitespace().filter(|w| w.numbers().is_empty()).collect::<Vec<_>>().join(" ");
    let (begun, steered) = (place(), words());
    // The mouse moves many times, because a pupil is accepted only after it has been seen for a while.
    for i in 0..40 {
        desk.point(window, [400, 100 + i % 2]);
        std::thread::sleep(Duration::from_millis(10));
    }
    wait_for("another pupil", || place() != begun && words() == steered);
    desk.press(window, S);
    wait_for("no steering", || words() != steered);
    desk.press(window, S);
    wait_for("steering again", || words() == steered);
    desk.press(window, ESCAPE);
    let ended = child.wait_with_output().expect("its end");
    let said = text(&ended.stderr);
    assert!(ended.status.success(), "{said}");
    assert!(!said.contains("validation:"), "{said}");
    assert_eq!(json(&at.join("s.json"))["ended_by"], "closed");
}

/// Three colors are refined, encoded and shown over a whole monitor, with a view of them in another window. The Vulkan
/// loader prints one line for each device that is made. It must print one.
#[test]
fn a_steered_colour_show_with_a_view_makes_one_device() {
    let temp = folder();
    let at = temp.path();
    let solve = ["solve", "builtin:still-life", "--size", "64x72", "--steps", "4", "--frames", "8", "--color", "all"];
    done(at, &[&solve[..], &["--engine", "cpu", "-o", "h.zarr"]].concat());
    let screen = Screen::new(at, [64, 72]);
    let show = ["show", "h.zarr", "--display", "planes24", "--engine", "vulkan", "--output", "window", "--view"];
    let more = ["--tracker", "simulated", "--duration", "1.5", "--stats", "s.json"];
    let answer = common::command(at, &[&show[..], &more].concat())
        .env("DISPLAY", screen.name())
        .env("VK_LOADER_DEBUG", "all")
        .env_remove("WAYLAND_DISPLAY")
        .output()
        .expect("it starts");
    let said = text(&answer.stderr);
    assert!(answer.status.success(), "{said}");
    assert_eq!(said.matches("vkCreateDevice layer callstack setup").count(), 1, "{said}");
    assert!(json(&at.join("s.json"))["sets_new"].as_u64().unwrap() >= 1);
}
