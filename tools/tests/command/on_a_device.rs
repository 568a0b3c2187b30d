//! Tests the unit for systemd, a restart after a fault, and the first light and the memory of a session.

use crate::common::{self, Printed, command, document, done, text};
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

const UNIT: &str = include_str!("../../eyebox-show.service");
const SIZE: [&str; 6] = ["--size", "32x32", "--color", "green", "--engine", "cpu"];

/// Bounds of the resident memory of a session of 1080 x 1920 pixels, 8 sub-frames and one color, MiB. They are a quarter
/// above the measured memory.
const PLAYED_MIB: u64 = 290;
const REFINED_MIB: u64 = 1580;

/// Returns the line that the unit runs, after the name of the program.
fn start() -> &'static str {
    UNIT.lines().find_map(|line| line.strip_prefix("ExecStart=/usr/local/bin/eyebox ")).expect("a command")
}

/// Waits until a file of shared memory has a picture that `is` accepts, and returns its pixels.
fn shared_picture(file: &Path, is: impl Fn(&[u8]) -> bool) -> Vec<u8> {
    // A header of 64 bytes precedes the picture.
    let picture =
        || std::fs::read(file).map_or_else(|_| Vec::new(), |bytes| bytes.into_iter().skip(64).collect::<Vec<u8>>());
    let until = Instant::now() + Duration::from_secs(120);
    loop {
        let read = picture();
        // The second read shows that the picture was complete.
        if read.iter().any(|byte| *byte != 0) && is(&read) && read == picture() {
            return read;
        }
        assert!(Instant::now() < until, "no such picture in {}", file.display());
        std::thread::sleep(Duration::from_millis(20));
    }
}

/// The unit for systemd starts the command again after a fault. The command then shows the content that is there.
#[test]
fn the_unit_for_systemd_shows_the_last_content_after_a_fault() {
    let lines: Vec<&str> = UNIT.lines().collect();
    assert!(lines.contains(&"Restart=always") && lines.contains(&"StartLimitIntervalSec=0"), "{UNIT}");
    let line = start()
        .replace("/var/lib/eyebox/content.zarr", "content.zarr")
        .replace("/etc/eyebox/display.toml", "planes8")
        .replace("--output direct", "--output shared:picture");
    let temp = common::folder();
    let at = temp.path();
    for (name, scene) in [("content.zarr", "builtin:plane"), ("next.zarr", "builtin:still-life")] {
        let solve = ["solve", scene, "--steps", "2", "--frames", "8", "--views", "3", "-o", name];
        done(at, &[&solve, &SIZE[..]].concat());
    }
    let words: Vec<&str> = line.split(' ').chain(["--engine", "cpu", "--size", "32x32"]).collect();
    let begin = || common::command(at, &words).stderr(Stdio::null()).stdout(Stdio::null()).spawn().expect("it starts");
    let mut shown = begin();
    let first = shared_picture(&at.join("picture"), |_| true);
    // New content replaces the old one, and the next start shows it.
    std::fs::remove_dir_all(at.join("content.zarr")).unwrap();
    std::fs::rename(at.join("next.zarr"), at.join("content.zarr")).unwrap();
    shown.kill().unwrap();
    assert!(!shown.wait().unwrap().success());
    let mut again = begin();
    shared_picture(&at.join("picture"), |picture| picture != first);
    again.kill().unwrap();
    again.wait().unwrap();
}

/// systemd reads each key and value of the unit. It reports unknown ones as warnings with the name of the file.
#[test]
fn systemd_reads_the_unit() {
    let temp = common::folder();
    let verified = |unit: &str| {
        let file = temp.path().join("eyebox-show.service");
        std::fs::write(&file, unit.replace("/usr/local/bin/eyebox", &common::program())).unwrap();
        Command::new("systemd-analyze").arg("verify").arg(&file).output()
    };
    let Ok(answer) = verified(UNIT) else {
        eprintln!("skipped: systemd-analyze was not found");
        return;
    };
    let warnings = |answer: &std::process::Output| text(&answer.stderr).matches("eyebox-show.service").count();
    assert!(answer.status.success() && warnings(&answer) == 0, "{}", text(&answer.stderr));
    // No restart has this value.
    let faulty = verified(&UNIT.replace("Restart=always", "Restart=forever")).unwrap();
    assert_eq!(warnings(&faulty), 1, "{}", text(&faulty.stderr));
}

/// A session prints the time to its first light and its memory. The memory of 1080 x 1920 pixels has a bound.
#[test]
fn a_session_of_1080p_states_its_first_light_and_stays_within_its_memory() {
    let temp = common::folder();
    let at = temp.path();
    let size = ["--size", "1080x1920", "--color", "green", "--engine", "cpu"];
    let solve = ["solve", "builtin:plane", "--steps", "1", "--frames", "8", "--views", "3", "-o", "h.zarr"];
    done(at, &[&solve[..], &size].concat());
    for (tracker, most) in [(&[][..], PLAYED_MIB), (&["--tracker", "simulated"][..], REFINED_MIB)] {
        let show = ["show", "h.zarr", "--display", "planes8", "--engine", "cpu", "--loop", "--duration", "2"];
        let answer = command(at, &[&show[..], &["--stats", "s.json"], tracker].concat()).output().expect("it runs");
        let said = text(&answer.stderr);
        assert!(answer.status.success(), "{said}");
        let stats = document(&at.join("s.json"));
        let (light, memory) = (stats["first_light_s"].as_f64(), stats["peak_memory_mib"].as_u64());
        assert!(light > Some(0.0), "{stats}");
        assert_eq!((said.lines_with("first light"), said.lines_with("peak memory")), (1, 1), "{said}");
        // The phases alone have 8 x 1080 x 1920 float32 values.
        assert!(memory > Some(63) && memory <= Some(most), "{memory:?} MiB, at most {most}: {said}");
    }
}
