//! `eyebox tracker` as a user runs it.

use crate::common::{self, Printed};
use std::io::{BufRead, BufReader, Write};
use std::net::UdpSocket;
use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

fn trackers(folder: &Path, args: &[&str]) -> Command {
    common::command(folder, &[&["tracker"], args].concat())
}

fn eyebox(folder: &Path, args: &[&str]) -> Output {
    trackers(folder, args).output().expect("the command starts")
}

fn done(folder: &Path, args: &[&str]) -> String {
    common::done(folder, &[&["tracker"], args].concat())
}

/// Asserts the error in the last line and no line on standard output. The wording of earlier lines is free.
#[track_caller]
fn refused(folder: &Path, args: &[&str], what: &str) {
    let answer = common::failed(&mut trackers(folder, args));
    common::Refusal::of(&answer).is(what);
    assert!(answer.stdout.is_empty(), "{args:?}");
}

/// Report descriptor of an eye tracker that sends a gaze point. It has usage page 0x12, report 1 and two values of 32
/// bits in micrometers.
const TRACKER: &str = "05 12 09 01 a1 01 09 10 a1 02 85 01 65 11 55 0c 17 80 7b e1 ff 27 80 84 1e 00 \
                       09 24 a1 00 75 20 95 02 09 21 09 22 81 03 c0 c0 c0";
/// Report descriptor of a mouse.
const MOUSE: &str = "05 01 09 02 a1 01 09 30 09 31 15 81 25 7f 75 08 95 02 81 06 c0";

fn bytes(hex: &str) -> Vec<u8> {
    hex.split_whitespace().map(|w| u8::from_str_radix(w, 16).unwrap()).collect()
}

fn recording(descriptor: &str) -> String {
    format!(
        "# by hand\nR: {} {descriptor}\nN: By Hand\nP: usb\nI: 3 1234 5678\n\
         E: 0.000000 9 01 40 0d 03 00 b0 3c ff ff\n\
         E: 0.010000 9 01 81 84 1e 00 00 00 00 00\n",
        bytes(descriptor).len()
    )
}

#[test]
fn a_descriptor_is_explained_in_all_its_forms() {
    let temp = tempfile::tempdir().unwrap();
    let at = temp.path();
    std::fs::write(at.join("a.bin"), bytes(TRACKER)).unwrap();
    let listing =
        TRACKER.replace(' ', ", 0x").replacen("05", "0x05", 1).replacen("0xa1, 0x01,", "0xa1, 0x01, // opens\n", 1);
    std::fs::write(at.join("a.txt"), listing).unwrap();
    std::fs::write(at.join("a.hid"), recording(TRACKER)).unwrap();
    let expected = done(at, &["describe", "a.bin", "--json"]);
    for name in ["a.txt", "a.hid"] {
        assert_eq!(done(at, &["describe", name, "--json"]), expected, "{name}");
    }
    let json: serde_json::Value = serde_json::from_str(&expected).unwrap();
    assert_eq!(json["eye_tracker"], true);
    let report = &json["reports"][0];
    assert_eq!((&report["id"], &report["bytes"], &report["kind"]), (&1.into(), &9.into(), &"input".into()));
    let field = &report["fields"][0];
    assert_eq!(
        (&field["unit"], &field["byte"], &field["bits"], &field["count"]),
        (&"um".into(), &1.into(), &32.into(), &2.into())
    );
    assert_eq!(field["usages"][1], "Position Y");
    assert_eq!(field["path"][2], "Gaze Point");
    // The text has the same usages, units and bytes.
    let said = done(at, &["describe", "a.bin"]);
    assert!(said.contains("Position Y") && said.contains("Gaze Point") && said.has("um 32 9"), "{said}");

    std::fs::write(at.join("m.bin"), bytes(MOUSE)).unwrap();
    let mouse: serde_json::Value = serde_json::from_str(&done(at, &["describe", "m.bin", "--json"])).unwrap();
    assert_eq!(mouse["eye_tracker"], false);
    assert!(done(at, &["describe", "m.bin"]).has("Mouse"));
    std::fs::write(at.join("m.hid"), recording(MOUSE)).unwrap();
    refused(at, &["watch", "m.hid"], "tracker/file");
}

#[test]
fn a_recording_is_shown_and_recorded_again() {
    let temp = tempfile::tempdir().unwrap();
    let at = temp.path();
    std::fs::write(at.join("a.hid"), recording(TRACKER)).unwrap();
    let shown = done(at, &["watch", "a.hid"]);
    let lines: Vec<&str> = shown.lines().collect();
    let is_placed = |line: &str| line.has("combined mm") && line.has_sequence(&[200.0, -50.0]);
    assert!(is_placed(lines[0]), "{shown}");
    assert!(lines.len() == 2 && lines[1].has("combined") && !lines[1].has("mm"), "{shown}");

    let json = done(at, &["record", "a.hid", "--json", "-o", "b.hid"]);
    let values: Vec<serde_json::Value> = json.lines().map(|l| serde_json::from_str(l).unwrap()).collect();
    assert_eq!((&values[0]["combined"]["x"], &values[0]["combined"]["what"]), (&200.0.into(), &"gaze".into()));
    assert_eq!(
        (&values[1]["combined"]["valid"], &values[1]["combined"]["x"]),
        (&false.into(), &serde_json::Value::Null)
    );
    let again = std::fs::read_to_string(at.join("b.hid")).unwrap();
    assert_eq!(again.trim(), recording(TRACKER).trim_start_matches("# by hand\n").trim());

    done(at, &["record", "a.hid", "-o", "c.jsonl"]);
    let replayed = done(at, &["watch", "c.jsonl"]);
    assert!(is_placed(replayed.lines().next().unwrap()), "{replayed}");
    let real = Instant::now();
    done(at, &["watch", "c.jsonl", "--clock", "real"]);
    assert!(real.elapsed() >= Duration::from_millis(10));
}

/// Recordings as laboratories have them, with the number of 60 samples that are placed and the place of the pupil at
/// the end in mm.
#[test]
fn recordings_of_other_trackers_are_placed() {
    let temp = tempfile::tempdir().unwrap();
    let at = temp.path();
    let seconds = |i: u32| f64::from(i) / 120.0;
    let x = |i: u32| 3.0 * (2.0 * seconds(i)).sin();
    let end = x(59);
    let eye = |i: u32, more: &str| format!("\"x\": {}, \"y\": 0{more}", x(i));
    type Line<'a> = Box<dyn Fn(u32) -> String + 'a>;
    let kinds: [(&str, Line<'_>, usize, f64); 12] = [
        ("seconds", Box::new(|i| format!("\"t\": {}, {}", seconds(i), eye(i, ""))), 60, end),
        ("below zero", Box::new(|i| format!("\"t\": {}, {}", seconds(i) - 323_801.0, eye(i, ""))), 60, end),
        (
            "us",
            Box::new(|i| format!("\"t\": {}, {}", 1.69e15 + 1e6 * seconds(i), eye(i, ", \"diameter\": 4"))),
            60,
            end,
        ),
        ("ms", Box::new(|i| format!("\"t\": {}, {}", -5.0 + 1e3 * seconds(i), eye(i, ""))), 60, end),
        ("ns", Box::new(|i| format!("\"t\": {}, {}", 1e9 * seconds(i), eye(i, ""))), 60, end),
        ("NaN", Box::new(|i| format!("\"t\": {}, {}", seconds(i), eye(i, ", \"diameter\": NaN"))), 60, end),
        ("set back", Box::new(|i| format!("\"t\": {}, {}", seconds(i) - f64::from(i / 30) * 2.0, eye(i, ""))), 60, end),
        (
            "meters",
            Box::new(|i| format!("\"t\": {}, \"x\": {}, \"y\": 0, \"diameter\": 0.004", seconds(i), x(i) * 1e-3)),
            60,
            end,
        ),
        (
            "stated meters",
            Box::new(|i| format!("\"t\": {}, \"unit\": \"m\", \"x\": {}, \"y\": 0", seconds(i), x(i) * 1e-3)),
            60,
            end,
        ),
        ("pixels", Box::new(|i| format!("\"t\": {}, {}", seconds(i), eye(i, ", \"diameter\": 41"))), 60, end),
        (
            "one eye in turn",
            Box::new(|i| {
                let (eye, x) = if i % 2 == 0 { ("left", 0.40) } else { ("right", 0.44) };
                format!("\"t\": {}, \"{eye}\": {{\"x\": {x}, \"y\": 0.5, \"unit\": \"normalized\"}}", seconds(i))
            }),
            60,
            -1.92,
        ),
        ("twice", Box::new(|i| format!("\"t\": {}, {}", seconds(i / 2), eye(i / 2, ""))), 30, x(29)),
    ];
    for (name, line, placed, end) in kinds {
        let text: String = (0..60).map(|i| format!("{{{}}}\n", line(i))).collect();
        std::fs::write(at.join("a.jsonl"), text).unwrap();
        let shown = done(at, &["watch", "a.jsonl", "--predict", "0", "--json"]);
        let values: Vec<serde_json::Value> = shown.lines().map(|l| serde_json::from_str(l).unwrap()).collect();
        let found: Vec<f64> =
            values.iter().filter_map(|v| v["stages"]["placed"]["Ok"]["position"][0].as_f64()).collect();
        let last = shown.lines().last().unwrap_or_default();
        assert_eq!((values.len(), found.len()), (60, placed), "{name}: {last}");
        let found = found.last().unwrap() * 1e3;
        assert!((found - end).abs() < 1e-6, "{name}: {found} mm, not {end}");
    }
}

/// If no unit makes the numbers plausible, they are refused. The remedy in the line works.
#[test]
fn numbers_of_an_unknown_unit_are_refused_until_it_is_stated() {
    let temp = tempfile::tempdir().unwrap();
    let at = temp.path();
    let write = |more: &str, time: f64, size: f64| {
        let line = |i: u32| {
            let (t, x) = (f64::from(i) * time, size * (0.1 * f64::from(i)).sin());
            format!("{{\"t\": {t}, \"x\": {x}, \"y\": 0{more}}}\n")
        };
        std::fs::write(at.join("a.jsonl"), (0..200).map(line).collect::<String>()).unwrap();
    };
    write("", 1.0, 3.0);
    refused(at, &["watch", "a.jsonl"], "tracker/time-unit \"t_unit\"");
    write(", \"t_unit\": \"ms\"", 1.0, 3.0);
    assert_eq!(done(at, &["watch", "a.jsonl"]).lines().count(), 200);
    write("", 1.0 / 120.0, 0.003);
    refused(at, &["watch", "a.jsonl"], "tracker/position-unit");
    write(", \"unit\": \"m\"", 1.0 / 120.0, 0.003);
    assert!(done(at, &["watch", "a.jsonl"]).lines().last().unwrap().has("mm"));
}

#[test]
fn a_simulated_eye_is_watched_and_its_pupil_found() {
    let temp = tempfile::tempdir().unwrap();
    let at = temp.path();
    let args = ["watch", "simulated:7", "--tracker-rate", "500", "--duration", "2"];
    let shown = done(at, &args);
    assert!((990..=1001).contains(&shown.lines().count()), "{}", shown.lines().count());
    let stages = done(at, &[&args[..], &["--predict", "20", "--json"]].concat());
    let last: serde_json::Value = serde_json::from_str(stages.lines().last().unwrap()).unwrap();
    assert!(last["pupil"]["spread"].as_f64().unwrap() < 5e-3 && last["stages"]["phase"].is_string(), "{last}");
    // The text has the place of the pupil with its spread, its diameter, and the share of pupils anywhere.
    let said = done(at, &[&args[..], &["--predict"]].concat());
    let last = said.lines().last().unwrap();
    assert!(last.has("mm %") && last.numbers().len() >= 8, "{last}");
}

#[test]
fn lines_over_udp_are_shown() {
    let temp = tempfile::tempdir().unwrap();
    // The port was free a moment ago.
    let port = UdpSocket::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
    let child = trackers(temp.path(), &["watch", &format!("udp://:{port}"), "--duration", "3", "--json"])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let sender = UdpSocket::bind("127.0.0.1:0").unwrap();
    for i in 0..150 {
        let _ = sender
            .send_to(format!("{{\"t\": {i}, \"x\": 1.5, \"y\": -2, \"diameter\": 4}}").as_bytes(), ("127.0.0.1", port));
        std::thread::sleep(Duration::from_millis(20));
    }
    let answer = child.wait_with_output().unwrap();
    assert!(answer.status.success());
    let shown = String::from_utf8_lossy(&answer.stdout);
    let first: serde_json::Value = serde_json::from_str(shown.lines().next().expect("a sample")).unwrap();
    assert_eq!((&first["combined"]["x"], &first["combined"]["diameter"]), (&1.5.into(), &4.0.into()));
}

#[test]
fn a_user_is_calibrated() {
    let temp = tempfile::tempdir().unwrap();
    let port = UdpSocket::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
    let source = format!("udp://:{port}");
    let mut child = trackers(temp.path(), &["calibrate", &source, "-o", "ada.toml", "--targets", "0,0;-8,0;8,0;0,6"])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    // The tracker sees the eye at this place. It is sent all the time, at 100 counts per degree with x mirrored.
    let place = Arc::new(Mutex::new([0.0; 2]));
    let (theirs, over) = (Arc::clone(&place), Arc::new(AtomicBool::new(false)));
    let until = Arc::clone(&over);
    let sending = std::thread::spawn(move || {
        let sender = UdpSocket::bind("127.0.0.1:0").unwrap();
        while !until.load(Ordering::Relaxed) {
            let [x, y] = *theirs.lock().unwrap();
            let line =
                format!("{{\"left\": {{\"x\": {}, \"y\": {}, \"unit\": \"counts\"}}}}", 500.0 - 100.0 * x, 100.0 * y);
            let _ = sender.send_to(line.as_bytes(), ("127.0.0.1", port));
            std::thread::sleep(Duration::from_millis(5));
        }
    });
    let mut said = BufReader::new(child.stderr.take().unwrap()).lines();
    let mut enter = child.stdin.take().unwrap();
    for target in [[0.0, 0.0], [-8.0, 0.0], [8.0, 0.0], [0.0, 6.0]] {
        said.by_ref().map(Result::unwrap).find(|line| line.has_sequence(&target)).expect("a target");
        *place.lock().unwrap() = target;
        enter.write_all(b"\n").unwrap();
    }
    let answer = child.wait_with_output().unwrap();
    over.store(true, Ordering::Relaxed);
    sending.join().unwrap();
    assert!(answer.status.success());
    let text = std::fs::read_to_string(temp.path().join("ada.toml")).unwrap();
    assert!(text.contains("user = \"ada\"") && text.contains("[left]") && !text.contains("[right]"), "{text}");
    assert!(text.contains(&format!("tracker = \"udp://127.0.0.1:{port}\"")), "{text}");
    // The row is 11 mm x sin(8 degrees) for 800 counts, mirrored.
    let row = text.lines().find(|l| l.starts_with("x_mm")).expect("the row of x");
    let first: f64 = row.split(['[', ',']).nth(1).unwrap().trim().parse().unwrap();
    assert!((first + 11.0 * 8f64.to_radians().sin() / 800.0).abs() < 1e-6, "{row}");
}

/// Two trackers with the same unit place the same reading differently.
#[test]
fn a_calibration_made_with_another_tracker_is_reported() {
    let temp = tempfile::tempdir().unwrap();
    let at = temp.path();
    let map = "[combined]\nunit = \"mm\"\nx_mm = [1.0, 0.0, 0.0]\ny_mm = [0.0, 1.0, 0.0]\nresidual_mm = 0.1\n";
    std::fs::write(at.join("r.hid"), recording(TRACKER)).unwrap();
    let said = |tracker: &str| {
        std::fs::write(at.join("me.toml"), format!("user = \"ada\"\n{tracker}{map}")).unwrap();
        let answer = eyebox(at, &["watch", "r.hid", "--predict", "--calibration", "me.toml"]);
        assert!(answer.status.success());
        String::from_utf8_lossy(&answer.stderr).into_owned()
    };
    let other = said("tracker = \"Tower 3\"\n");
    assert!(other.contains("Tower 3") && other.contains("By Hand") && other.contains("tracker calibrate"), "{other}");
    for same in ["tracker = \"By Hand\"\n", ""] {
        assert!(!said(same).contains("By Hand"), "{same}");
    }
}

#[test]
fn what_is_connected_is_listed() {
    let temp = tempfile::tempdir().unwrap();
    let said = done(temp.path(), &["list"]);
    assert!(said.starts_with("hid") && said.contains("simulated") && said.contains("udp://"), "{said}");
    let json: serde_json::Value = serde_json::from_str(&done(temp.path(), &["list", "--json"])).unwrap();
    assert!(json["hid"].is_array());
}

/// The senders send the samples that docs/trackers.md describes, and the focus reaches the pupil. A focus of 1 dioptre
/// is 90 mm with an eyepiece of 300 mm.
#[test]
fn senders_are_heard_and_the_focus_reaches_the_pupil() {
    let temp = common::folder();
    let at = temp.path();
    let senders = Path::new(env!("CARGO_MANIFEST_DIR")).join("senders");
    let has_python = Command::new("python3").arg("--version").output().is_ok_and(|o| o.status.success());
    if !has_python {
        return eprintln!("no python3: the senders were not run");
    }
    for (sender, focus_mm) in [("tobii.py", 90.0), ("openxr.py", 90.0), ("lsl.py", 90.0), ("neon.py", 90.0)] {
        let free = UdpSocket::bind("127.0.0.1:0").and_then(|s| s.local_addr()).expect("a free port");
        let source = format!("udp://:{}", free.port());
        let watch = ["watch", &source, "--predict", "--focal-length", "300", "--json", "--duration", "60"];
        let mut watched = trackers(at, &watch).stdout(Stdio::piped()).spawn().expect("it starts");
        let to = free.to_string();
        let mut sending = Command::new("python3")
            .arg("-B")
            .arg(senders.join(sender))
            .args(["--simulate", "--to", &to])
            .spawn()
            .expect("python3 starts");
        let mut lines = BufReader::new(watched.stdout.take().expect("a pipe")).lines();
        let seen = lines.find_map(|line| {
            let line: serde_json::Value = serde_json::from_str(&line.expect("text")).expect("JSON");
            line["stages"]["placed"]["Ok"].is_object().then_some(line)
        });
        sending.kill().and_then(|()| sending.wait()).expect("it ends");
        watched.kill().and_then(|()| watched.wait()).expect("it ends");
        let focus = &seen.expect("an accepted sample")["pupil"]["focus"];
        for end in focus.as_array().expect("a range") {
            assert!((end.as_f64().unwrap() * 1e3 - focus_mm).abs() < 1e-6, "{sender}: {focus}");
        }
    }
}

#[test]
fn mistakes_are_one_line() {
    let temp = tempfile::tempdir().unwrap();
    let at = temp.path();
    let write = |name: &str, text: &str| std::fs::write(at.join(name), text).unwrap();
    write("a.hid", &recording(TRACKER));
    write("bad.hid", "R: 3 05 12\n");
    write("empty.bin", "");
    write("big.bin", &"x".repeat(20_000));
    write("bad.toml", "vendor = 1\n");
    refused(at, &["describe", "none.bin"], "tracker/file none.bin");
    refused(at, &["describe", "empty.bin"], "tracker/file empty.bin");
    refused(at, &["describe", "big.bin"], "tracker/file");
    refused(at, &["describe", "bad.hid"], "tracker/file/report-length bad.hid");
    refused(at, &["watch", "none.hid"], "tracker/file none.hid");
    refused(at, &["watch", "tobii"], "tracker/spec 'tobii'");
    refused(at, &["watch", "udp://nowhere"], "tracker/spec");
    refused(at, &["watch", "udp://203.0.113.1:9123", "--duration", "1"], "tracker/network/cannot-listen");
    refused(at, &["watch", "mouse"], "tracker/setting/mouse-without-window");
    refused(at, &["record", "a.hid", "-o", "b.txt"], "arguments/ending");
    refused(at, &["record", "simulated", "-o", "b.hid", "--duration", "1"], "arguments/not-hid");
    refused(at, &["watch", "a.hid", "--device-file", "bad.toml"], "tracker/file/toml bad.toml");
    refused(at, &["watch", "a.hid", "--predict", "--calibration", "bad.toml"], "gaze/file/toml bad.toml");
    refused(at, &["watch", "simulated", "--tracker-rate", "1e9", "--duration", "1"], "tracker/setting/simulated 20000");
    refused(at, &["watch", "a.hid", "--duration=-1"], "usage/value-validation --duration");
    refused(at, &["calibrate", "simulated", "-o", "x.toml", "--targets", "0,0;1,1"], "usage/value-validation 64");
    refused(at, &["calibrate", "simulated", "-o", "x.toml", "--targets", "0,0;1,1;90,0"], "usage/value-validation 60");
    refused(at, &["record", "hid", "-o", "c.hid", "--duration", "0.2"], "arguments/no-sample");
    assert!(
        !at.join("x.toml").exists()
            && !at.join("b.txt").exists()
            && !at.join("b.hid").exists()
            && !at.join("c.hid").exists()
    );
}
