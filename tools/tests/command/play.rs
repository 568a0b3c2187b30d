//! `eyebox solve` over several scenes and `eyebox show`, as a user runs them.

use crate::common::{Printed, Refusal, refusal, with_json_errors, written};
use serde_json::Value;
use std::path::Path;
use std::process::{Command, Output};

fn eyebox(folder: &Path, args: &[&str]) -> Output {
    Command::new(crate::common::program())
        .args(args)
        .current_dir(folder)
        .env("XDG_CACHE_HOME", folder.join("cache"))
        .output()
        .expect("the command starts")
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// Runs a command that must succeed, and returns its standard error.
fn done(folder: &Path, args: &[&str]) -> String {
    let answer = eyebox(folder, args);
    assert!(answer.status.success(), "{args:?}: {}", text(&answer.stderr));
    text(&answer.stderr)
}

#[track_caller]
fn refused(folder: &Path, args: &[&str], what: &str) {
    refusal(folder, args).is(what);
}

fn json(file: &Path) -> Value {
    serde_json::from_slice(&std::fs::read(file).expect("a file")).expect("JSON")
}

/// Returns the number of holograms that were not shown.
fn dropped(stats: &Value) -> u64 {
    stats["content_dropped"].as_object().expect("causes").values().filter_map(Value::as_u64).sum()
}

const SOLVE: [&str; 12] =
    ["--size", "48x64", "--views", "3", "--steps", "3", "--pupils", "4", "--display", "small", "--engine", "cpu"];

fn solve(folder: &Path, scenes: &[&str], out: &str, more: &[&str]) -> Output {
    eyebox(folder, &[&["solve"], scenes, &SOLVE, &["-o", out], more].concat())
}

const SCENES: [&str; 3] = ["builtin:still-life?span=1", "builtin:still-life?span=1.1", "builtin:still-life?span=1.2"];

fn sequence(folder: &Path) {
    let answer = solve(folder, &SCENES, "s.zarr", &["--rate", "20"]);
    assert!(answer.status.success(), "{}", text(&answer.stderr));
}

#[test]
fn an_interrupted_sequence_is_gone_on_with_and_comes_out_the_same() {
    let here = tempfile::tempdir().unwrap();
    let at = here.path();
    sequence(at);
    // The copy is in the state of a solve that stopped after its first hologram, because the others are missing.
    let copy = |from: &str, to: &str| {
        assert!(Command::new("cp").args(["-r", from, to]).current_dir(at).status().unwrap().success());
    };
    copy("s.zarr", "cut.zarr");
    (1..3).for_each(|i| std::fs::remove_dir_all(at.join(format!("cut.zarr/phases/c/{i}"))).unwrap());
    let chunks = |name: &str| [0, 1, 2].map(|i| at.join(name).join(format!("phases/c/{i}/0/0/0/0")));
    let first = written(&chunks("cut.zarr")[0]);
    let answer = solve(at, &SCENES, "cut.zarr", &["--rate", "20", "--json"]);
    assert!(answer.status.success(), "{}", text(&answer.stderr));
    // The first hologram is not solved again.
    let report: Value = serde_json::from_slice(&answer.stdout).unwrap();
    assert_eq!(
        (report["frames"].as_array().map(Vec::len), written(&chunks("cut.zarr")[0])),
        (Some(2), first),
        "{report}"
    );
    for i in 0..3 {
        let chunk = |name: &str| std::fs::read(at.join(name).join(format!("phases/c/{i}/0/0/0/0"))).unwrap();
        assert!(chunk("s.zarr") == chunk("cut.zarr"), "hologram {i} is another one");
    }
    let before = chunks("s.zarr").map(|file| written(&file));
    let answer = solve(at, &SCENES, "s.zarr", &["--rate", "20"]);
    assert!(answer.status.success() && text(&answer.stdout).has("s.zarr 3"), "{}", text(&answer.stdout));
    assert_eq!(chunks("s.zarr").map(|file| written(&file)), before);
    for (more, what) in [
        (&["--rate", "30"][..], "hologram/other-sequence/shape-or-rate 30/1"),
        (&["--rate", "20", "--seed", "1"], "hologram/other-sequence/other-setting solve"),
    ] {
        refused(at, &[&["solve"], &SCENES[..], &SOLVE, &["-o", "s.zarr"], more].concat(), what);
    }
    // Other commands read one hologram of the sequence.
    done(at, &["convert", "s.zarr", "two.npy", "--at", "2"]);
    done(at, &["render", "s.zarr", "--at", "1", "--pupil=0,0,4,0", "-o", "one.png"]);
    refused(at, &["convert", "s.zarr", "x.npy"], "hologram/not-a-hologram/is-a-sequence");
    refused(at, &["convert", "s.zarr", "x.npy", "--at", "3"], "hologram/not-a-hologram/no-such-hologram");
}

#[test]
fn a_folder_of_light_fields_is_a_sequence_in_the_order_of_its_numbers() {
    let here = tempfile::tempdir().unwrap();
    let at = here.path();
    for (name, level) in [("f10", 40u8), ("f9", 200)] {
        std::fs::create_dir_all(at.join("film").join(name)).unwrap();
        for view in 0..4 {
            let picture =
                image::GrayImage::from_fn(64, 48, |x, y| image::Luma([level.wrapping_add((x * y) as u8 / 8)]));
            picture.save(at.join("film").join(name).join(format!("input_Cam{view:03}.png"))).unwrap();
        }
    }
    let answer = solve(at, &["film"], "film.zarr", &["--json", "--warm-start", "cold"]);
    assert!(answer.status.success(), "{}", text(&answer.stderr));
    let report: Value = serde_json::from_slice(&answer.stdout).unwrap();
    let scenes: Vec<&str> = report["frames"].as_array().unwrap().iter().map(|f| f["scene"].as_str().unwrap()).collect();
    assert!(scenes.len() == 2 && scenes[0].ends_with("f9") && scenes[1].ends_with("f10"), "{scenes:?}");
}

#[test]
fn what_is_recorded_is_what_encode_writes() {
    let here = tempfile::tempdir().unwrap();
    let at = here.path();
    sequence(at);
    let played =
        ["show", "s.zarr", "--display", "planes24", "--size", "48x64", "--record", "shown", "--stats", "s.json"];
    done(at, &[&played[..], &["--trace", "t.json", "--set", "show.sync=0.1"]].concat());
    let stats = json(&at.join("s.json"));
    // At 60 Hz, each of 20 holograms per second is shown three times.
    assert_eq!((&stats["content_shown"], dropped(&stats)), (&3.into(), 0));
    assert_eq!(stats["sets"].as_u64().unwrap() - stats["idle_sets"].as_u64().unwrap(), 9);
    assert_eq!((&stats["ended_by"], &stats["missed_presents"]), (&"the end".into(), &0.into()));
    for i in 0..3 {
        let npy = format!("{i}.npy");
        done(at, &["convert", "s.zarr", &npy, "--at", &i.to_string()]);
        let out = format!("e{i}");
        done(at, &["encode", &npy, "--display", "planes24", "--size", "48x64", "-o", &out]);
        let picture = |path: String| image::open(at.join(path)).unwrap().into_rgb8();
        assert!(picture(format!("shown/set-{i:06}-00.png")) == picture(format!("e{i}/frame-00000.png")), "{i}");
    }
    let list = std::fs::read_to_string(at.join("shown/shown.csv")).unwrap();
    let sets: Vec<&str> =
        list.lines().skip(1).map(|l| l.split(',').nth(2).unwrap()).filter(|s| !s.is_empty()).collect();
    assert_eq!(sets, ["0", "0", "0", "1", "1", "1", "2", "2", "2"]);
    let trace = json(&at.join("t.json"));
    let names: std::collections::BTreeSet<&str> =
        trace.as_array().unwrap().iter().map(|e| e["name"].as_str().unwrap()).collect();
    for name in ["decode", "upload", "encode", "submit", "present", "thread_name"] {
        assert!(names.contains(name), "{name} in {names:?}");
    }
    refused(at, &played, "file/taken/not-empty");
}

#[test]
fn a_vulkan_device_shows_the_bytes_of_the_cpu() {
    let here = tempfile::tempdir().unwrap();
    let at = here.path();
    sequence(at);
    for display in ["planes24", "grey8"] {
        let show = ["show", "s.zarr", "--display", display, "--size", "48x64", "--rate", "2.5"];
        let (cpu, vulkan) = (format!("{display}-cpu"), format!("{display}-vulkan"));
        done(at, &[&show[..], &["--record", &cpu, "--engine", "cpu"]].concat());
        let on_vulkan = ["--record", &vulkan, "--engine", "vulkan", "--validation", "--stats", "v.json"];
        let said = done(at, &[&show[..], &on_vulkan].concat());
        let stats = json(&at.join("v.json"));
        assert_eq!((&stats["content_shown"], dropped(&stats)), (&3.into(), 0));
        assert!(!said.contains("validation:"), "{said}");
        let mut compared = 0;
        for entry in std::fs::read_dir(at.join(&cpu)).unwrap() {
            let name = entry.unwrap().file_name();
            let read = |folder: &str| std::fs::read(at.join(folder).join(&name)).unwrap();
            assert!(read(&cpu) == read(&vulkan), "{name:?}");
            compared += 1;
        }
        assert!(compared > 3, "{compared} files");
    }
    let mut none = Command::new(crate::common::program());
    let show = ["show", "s.zarr", "--display", "planes24", "--size", "48x64", "--engine", "vulkan", "--record", "none"];
    none.args(show)
        .current_dir(at)
        .env("XDG_CACHE_HOME", at.join("cache"))
        .env("VK_ICD_FILENAMES", "/nowhere.json")
        .env("VK_DRIVER_FILES", "/nowhere.json");
    let none = with_json_errors(&mut none).output().expect("the command starts");
    let said = text(&none.stderr);
    assert_eq!((none.status.code(), said.trim().lines().count()), (Some(2), 1), "{said}");
    Refusal::of(&none).is("engine/no-device");
}

#[test]
fn a_direct_display_that_is_not_there_is_refused_in_a_sentence() {
    let here = tempfile::tempdir().unwrap();
    let at = here.path();
    sequence(at);
    let show = ["show", "s.zarr", "--display", "planes24", "--size", "48x64", "--output"];
    for more in [&["direct"][..], &["direct:HDMI-A-1"], &["direct", "--validation"]] {
        let mut command = Command::new(crate::common::program());
        command.args(show).args(more).current_dir(at).env("XDG_CACHE_HOME", at.join("cache"));
        let answer = crate::common::failed(&mut command);
        assert_eq!(text(&answer.stderr).trim().lines().count(), 1, "{}", text(&answer.stderr));
        // If there is a graphics card, it has no display of 48x64 pixels.
        let refusal = Refusal::of(&answer);
        assert!(refusal.code.starts_with("present/display/no-"), "{refusal:?}");
    }
    refused(at, &[&show[..], &["direct", "--clock", "simulated"]].concat(), "arguments/without-offscreen");
}

/// The first ctrl-C is enough. It leaves the idle picture, which has phase 0 everywhere.
#[test]
#[cfg(unix)]
fn interrupted_it_leaves_the_idle_picture() {
    let here = tempfile::tempdir().unwrap();
    let at = here.path();
    sequence(at);
    for signal in ["-INT", "-TERM"] {
        let mut playing = Command::new(crate::common::program())
            .args(["show", "s.zarr", "--display", "planes24", "--size", "48x64", "--loop", "--output", "shared:shown"])
            .args(["--stats", "s.json"])
            .current_dir(at)
            .env("XDG_CACHE_HOME", at.join("cache"))
            .stderr(std::process::Stdio::piped())
            .spawn()
            .expect("the command starts");
        let since = std::time::Instant::now();
        let picture = || std::fs::read(at.join("shown")).map(|b| b.get(64..).unwrap_or_default().to_vec());
        while picture().map_or(true, |p| p.iter().all(|b| *b == 0)) {
            assert!(since.elapsed().as_secs() < 60 && playing.try_wait().unwrap().is_none(), "no picture came");
            std::thread::sleep(std::time::Duration::from_millis(3));
        }
        assert!(Command::new("kill").args([signal, &playing.id().to_string()]).status().unwrap().success());
        let answer = playing.wait_with_output().unwrap();
        let said = text(&answer.stderr);
        assert_eq!(answer.status.code(), Some(0), "{said}");
        assert_eq!(json(&at.join("s.json"))["ended_by"], "ctrl-C");
        let left = picture().unwrap();
        assert!(left.len() == 3 * 48 * 64 && left.iter().all(|b| *b == 0), "{signal}");
        std::fs::remove_file(at.join("shown")).unwrap();
    }
}

#[test]
fn an_unfinished_sequence_and_a_damaged_hologram_are_told() {
    let here = tempfile::tempdir().unwrap();
    let at = here.path();
    sequence(at);
    let show = ["show", "s.zarr", "--display", "planes8", "--size", "48x64", "--clock", "simulated"];
    let file = at.join("s.zarr/phases/c/1/0/0/0/0");
    let mut bytes = std::fs::read(&file).unwrap();
    bytes[1000] ^= 64;
    std::fs::write(&file, bytes).unwrap();
    let said = done(at, &[&show[..], &["--stats", "s.json"]].concat());
    let stats = json(&at.join("s.json"));
    let counts = [&stats["content_shown"], &stats["content_dropped"]["damaged"]].map(Value::as_u64);
    assert_eq!((counts, dropped(&stats)), ([Some(2), Some(1)], 1), "{stats}");
    // The damaged file is named.
    assert!(said.contains("s.zarr/phases/c/1/0/0/0/0"), "{said}");
    std::fs::write(at.join("s.zarr/phases/c/2/0/0/0/0"), "short").unwrap();
    refused(at, &show, "arguments/unfinished");
    let said = done(at, &[&show[..], &["--unfinished"]].concat());
    assert!(said.lines_with("s.zarr 2 3") > 0, "{said}");
}

#[test]
fn what_cannot_be_shown_is_refused_in_one_sentence() {
    let here = tempfile::tempdir().unwrap();
    let at = here.path();
    sequence(at);
    refused(at, &["show", "none.zarr"], "file/read none.zarr");
    refused(at, &["show", "s.zarr", "--display", "planes24", "--size", "40x64"], "session/setting/size 48x64");
    refused(at, &["show", "s.zarr", "--size", "48x64", "--rate", "0"], "usage/value-validation rate");
    refused(at, &["show", "s.zarr", "--size", "48x64", "--at", "3"], "session/setting/first");
    refused(
        at,
        &["show", "s.zarr", "--size", "48x64", "--loop", "--clock", "simulated"],
        "arguments/endless --duration",
    );
    let before = eyebox(at, &["show", "s.zarr", "--size", "48x64", "--set", "show.speed=5000"]);
    assert_eq!(before.status.code(), Some(2));
}

/// A recording in real time has the list of pulses in its folder.
#[test]
fn pulses_with_the_light_are_sent_and_listed() {
    let here = tempfile::tempdir().unwrap();
    let at = here.path();
    sequence(at);
    done(at, &["display", "new", "fields", "-o", "bench.toml"]);
    let receiver = std::net::UdpSocket::bind("127.0.0.1:0").unwrap();
    let bench = std::fs::read_to_string(at.join("bench.toml")).unwrap();
    let address = receiver.local_addr().unwrap();
    let table = format!("\n[trigger_out]\nudp = \"{address}\"\nsignal = \"number\"\n");
    std::fs::write(at.join("bench.toml"), bench + &table).unwrap();
    let show = ["show", "s.zarr", "--display", "bench.toml", "--size", "48x64", "--record", "r", "--stats", "s.json"];
    done(at, &[&show[..], &["--clock", "real"]].concat());
    let list = std::fs::read_to_string(at.join("r/triggers.csv")).unwrap();
    let pulse = |state: &str| list.lines().filter(|line| line.ends_with(state)).count() as u64;
    let stats = json(&at.join("s.json"));
    assert_eq!(stats["trigger_out"]["sent"], pulse(",sent"));
    assert_eq!(stats["trigger_out"]["late"], pulse(",late"));
    assert_eq!(list.lines().count() as u64 - 1, pulse(",sent") + pulse(",late"));
    assert!(pulse(",sent") > 0, "{list}");
    receiver.set_read_timeout(Some(std::time::Duration::from_secs(20))).unwrap();
    let first: u8 =
        list.lines().find(|line| line.ends_with(",sent")).unwrap().split(',').next().unwrap().parse().unwrap();
    let mut byte = [0];
    receiver.recv(&mut byte).unwrap();
    assert_eq!(byte, [first]);
    // In simulated time there is no list.
    let mut again = show;
    again[7] = "r2";
    done(at, &again);
    assert!(at.join("r2/shown.csv").exists() && !at.join("r2/triggers.csv").exists());
}

#[test]
fn a_loop_in_real_time_ends_after_its_duration() {
    let here = tempfile::tempdir().unwrap();
    let at = here.path();
    sequence(at);
    let show = ["show", "s.zarr", "--display", "fields", "--size", "48x64", "--loop", "--duration", "0.5"];
    done(at, &[&show[..], &["--stats", "s.json", "--rate", "7.5"]].concat());
    let stats = json(&at.join("s.json"));
    assert_eq!(stats["ended_by"], "the duration");
    let count = |name: &str| stats[name].as_u64().unwrap();
    // The statistics add up under any load of the machine.
    assert_eq!(count("content_due"), count("content_shown") + dropped(&stats) + count("content_pending"));
    assert!(count("content_due") >= 3 && count("video_frames") >= 30, "{stats}");
}
