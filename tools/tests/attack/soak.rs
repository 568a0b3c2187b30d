//! Plays holograms and follows the eye with a full disk, a slow disk, a loaded machine or a tracker that sends
//! nonsense. Video frames stay complete, statistics add up, and memory does not grow.
//!
//! Each run takes two seconds. With `EYEBOX_SOAK_MINUTES=10 cargo test --workspace --test attack soak -- --nocapture`
//! it takes ten minutes.

use crate::case::program;
use serde_json::Value;
use std::fs::File;
use std::io::Read;
use std::net::UdpSocket;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::time::{Duration, Instant};

/// Allowed growth of memory from the first half of a run to its end, in KiB. Allocators do not take pages evenly over
/// time.
const FLAT_KIB: u64 = 1 << 10;
/// Bytes of a video frame of 16 x 16 pixels with 8 bits.
const FRAME: usize = 256;

fn seconds() -> u64 {
    crate::stated("EYEBOX_SOAK_MINUTES").map_or(2, |minutes| 60 * minutes)
}

/// Makes a folder with a hologram of two sub-frames.
fn place() -> tempfile::TempDir {
    let temp = tempfile::tempdir().expect("a temporary folder");
    let args = "solve builtin:plane --size 16x16 --color green --engine cpu --steps 1 --frames 2 -o h.zarr";
    let answer = Command::new(program()).args(args.split(' ')).current_dir(temp.path()).output().expect("it starts");
    assert!(answer.status.success(), "{}", String::from_utf8_lossy(&answer.stderr));
    temp
}

/// Starts `show` on a small display in real time. It plays the hologram as solved (`played`) or refines it for an eye
/// (`followed`).
fn start(at: &Path, how: &str, more: &str, limits: &str) -> Child {
    let shown = "show h.zarr --display grey8 --size 16x16 --engine cpu";
    let tracker = if how == "played" || more.contains("--tracker") { "" } else { "--tracker simulated" };
    let script =
        format!("{limits} exec '{}' {shown} {tracker} --duration {} --stats {how}.json {more}", program(), seconds());
    let mut shell = Command::new("sh");
    shell.args(["-c", &script]).current_dir(at).env("MALLOC_ARENA_MAX", "1");
    shell
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(File::create(at.join(format!("{how}.said"))).expect("a file"));
    shell.spawn().expect("sh starts")
}

/// Returns the resident memory of a process, in KiB.
fn resident(id: u32) -> Option<u64> {
    let status = std::fs::read_to_string(format!("/proc/{id}/status")).ok()?;
    status.lines().find_map(|l| l.strip_prefix("VmRSS:"))?.trim().strip_suffix(" kB")?.parse().ok()
}

/// Waits for the end of a run and checks its memory and its exit code. Also checks its statistics and returns them.
fn attend(at: &Path, how: &str, mut child: Child, code: i32) -> Value {
    let (begun, half) = (Instant::now(), Duration::from_secs(seconds()) / 2);
    let (mut early, mut late) = (0, 0);
    let end = loop {
        if let Some(end) = child.try_wait().expect("ours") {
            break end;
        }
        let is = resident(child.id()).unwrap_or(0);
        let most = if begun.elapsed() < half { &mut early } else { &mut late };
        *most = is.max(*most);
        assert!(begun.elapsed() < 4 * half + Duration::from_secs(60), "{how} does not end");
        std::thread::sleep(Duration::from_millis(20));
    };
    let said = std::fs::read_to_string(at.join(format!("{how}.said"))).unwrap_or_default();
    assert_eq!(end.code(), Some(code), "{how}: {said}");
    assert!(!said.contains("panicked"), "{said}");
    assert!(code == 0 || said.contains("the disk is full"), "{said}");
    println!("{how}: {} KiB, then {} KiB; {}", early, late, said.lines().last().unwrap_or_default());
    // A run of two seconds can end before all permanent allocations exist.
    let flat = late <= early + FLAT_KIB || seconds() < 60;
    assert!(flat, "{how}: memory grew from {early} to {late} KiB");
    let text = std::fs::read_to_string(at.join(format!("{how}.json"))).unwrap_or_else(|e| panic!("{e}: {said}"));
    let stats: Value = serde_json::from_str(&text).expect("JSON");
    let account = if how == "followed" { stats["playback"].clone() } else { stats.clone() };
    let n = |key: &str| account[key].as_u64().unwrap_or_else(|| panic!("{key}: {account}"));
    let dropped: u64 = account["content_dropped"].as_object().expect("causes").values().filter_map(Value::as_u64).sum();
    assert_eq!(n("content_due"), n("content_shown") + dropped + n("content_pending"), "{account}");
    assert!(n("sets") >= n("content_shown") + n("idle_sets"), "{account}");
    // A set takes two video frames, or one if sets roll. The last video frame may be incomplete.
    let of_a_set = if stats["sets_roll"] == true { 1 } else { 2 };
    let frames = of_a_set * n("sets") + n("missed_presents") + n("held_video_frames");
    assert!((frames.saturating_sub(1)..=frames).contains(&n("video_frames")), "{account}");
    stats
}

/// Waits for both runs at once.
fn attend_both(at: &Path, played: Child, followed: Child, code: i32) {
    std::thread::scope(|scope| {
        let followed = scope.spawn(|| attend(at, "followed", followed, code));
        attend(at, "played", played, code);
        followed.join().expect("it ends well");
    });
}

/// Returns the fault of the video frames that a pipe received. Each must be complete, and only three pictures may
/// occur, which are the two of the hologram and the idle picture.
fn torn(frames: &[u8]) -> Option<String> {
    let all: Vec<&[u8]> = frames.chunks(FRAME).collect();
    if all.last().is_some_and(|last| last.len() != FRAME) {
        return Some("the last video frame is cut".into());
    }
    let mut kinds: Vec<&[u8]> = Vec::new();
    for frame in &all {
        if !kinds.contains(frame) {
            kinds.push(frame);
        }
    }
    (kinds.len() > 3).then(|| format!("{} different pictures in {} video frames", kinds.len(), all.len()))
}

/// A disk of 64 KiB. The user needs permission to mount it.
struct SmallDisk(PathBuf);

impl SmallDisk {
    fn mount(at: &Path) -> Option<Self> {
        std::fs::create_dir_all(at).expect("a folder");
        let options = ["-t", "tmpfs", "-o", "size=64k", "none"];
        let mounted = Command::new("mount").args(options).arg(at).stderr(Stdio::null()).status();
        mounted.is_ok_and(|end| end.success()).then(|| Self(at.to_path_buf()))
    }
}

impl Drop for SmallDisk {
    fn drop(&mut self) {
        let _ = Command::new("umount").arg("--lazy").arg(&self.0).status();
    }
}

/// A full disk ends recordings and traces with an error line, but the whole hologram is still shown. Video frames that
/// fit into a file are complete.
#[test]
fn a_disk_that_is_full() {
    let temp = place();
    let at = temp.path();
    let disk = SmallDisk::mount(&at.join("full"));
    // Without a mounted disk, no file may grow beyond 8 KiB.
    let limit = if disk.is_some() { "" } else { "ulimit -f 16;" };
    let played = start(at, "played", "--trace full/played-trace.json", limit);
    let followed = start(at, "followed", "--record full/shown --trace full/followed-trace.json", limit);
    attend_both(at, played, followed, 2);
    for picture in std::fs::read_dir(at.join("full/shown")).into_iter().flatten().flatten() {
        if picture.path().extension().is_some_and(|e| e == "png") {
            image::open(picture.path()).unwrap_or_else(|e| panic!("{}: {e}", picture.path().display()));
        }
    }
    for trace in ["played", "followed"] {
        // A trace is an array of events. Every line is complete, but the end of the array is missing.
        let text = std::fs::read_to_string(at.join(format!("full/{trace}-trace.json"))).unwrap_or_default();
        let whole = text.trim_end().trim_end_matches(',');
        assert!(text.is_empty() || serde_json::from_str::<Value>(&format!("{whole}]")).is_ok(), "{text}");
    }
    let mut shown = start(at, "played", "--output raw:full/frames.raw", limit);
    let end = shown.wait().expect("ours");
    let said = std::fs::read_to_string(at.join("played.said")).unwrap_or_default();
    assert!(end.code() == Some(2) && said.contains("the disk is full"), "{end}: {said}");
    let raw = std::fs::read(at.join("full/frames.raw")).unwrap_or_default();
    assert_eq!(torn(&raw[..raw.len() / FRAME * FRAME]), None);
}

#[test]
fn a_disk_that_is_slow() {
    let temp = place();
    let at = temp.path();
    assert!(Command::new("mkfifo").arg(at.join("pipe")).status().expect("mkfifo").success());
    let played = start(at, "played", "--output raw:pipe", "");
    let followed = start(at, "followed", "--record shown", "");
    let pipe = at.join("pipe");
    let reader = std::thread::spawn(move || {
        let (mut file, mut all, mut part) = (File::open(pipe).expect("the pipe"), Vec::new(), vec![0; 10_000]);
        loop {
            match file.read(&mut part).expect("read") {
                0 => return all,
                n => all.extend(&part[..n]),
            }
            // At most 10 kB every 10 ms is a rate of 1 MB/s.
            std::thread::sleep(Duration::from_millis(10));
        }
    });
    attend_both(at, played, followed, 0);
    assert_eq!(torn(&reader.join().expect("the reader")), None);
}

#[test]
fn a_machine_that_is_busy() {
    let temp = place();
    let at = temp.path();
    let busy = || Command::new("sh").args(["-c", "while :; do :; done"]).spawn().expect("sh starts");
    let mut all: Vec<Child> = (0..20).map(|_| busy()).collect();
    let played = start(at, "played", "--output raw:frames.raw", "");
    let followed = start(at, "followed", "", "");
    // The shells must end even if a run fails.
    let seen = std::panic::catch_unwind(|| attend_both(at, played, followed, 0));
    all.iter_mut().for_each(|child| {
        let _ = child.kill();
        let _ = child.wait();
    });
    seen.expect("both ended well");
    assert_eq!(torn(&std::fs::read(at.join("frames.raw")).expect("frames")), None);
}

/// Returns a nonsensical line of a tracker.
fn nonsense(rng: &mut fastrand::Rng, count: u64) -> String {
    let odd = ["NaN", "1e999", "-1e308", "null", "\"x\"", "[]", "1e-320", "99999999999999999999", "{}"];
    let number = |rng: &mut fastrand::Rng| match rng.u8(..4) {
        0 => odd[rng.usize(..odd.len())].to_string(),
        1 => (f64::from_bits(rng.u64(..))).to_string(),
        _ => (rng.f64() * 20.0 - 10.0).to_string(),
    };
    let time = match rng.u8(..6) {
        0 => number(rng),
        // The time goes back here, and far ahead in the next branch.
        1 => format!("{}", count as f64 * 1e-3 - rng.f64() * 10.0),
        2 => format!("{}", count as f64 + 1e9 * rng.f64()),
        _ => format!("{}", count as f64 * 1e-3),
    };
    let (x, y, diameter, confidence) = (number(rng), number(rng), number(rng), number(rng));
    match rng.u8(..8) {
        0 => std::iter::repeat_with(|| rng.char(..)).take(40).collect(),
        3 => format!("{{\"t\": {time}, \"x\": {x}, \"y\": {y}, \"vx\": {diameter}, \"vy\": {confidence}}}"),
        1 => format!("{{\"t\": {time}, \"left\": {{\"x\": {x}, \"y\": {y}}}, \"ipd_mm\": {diameter}}}"),
        2 => format!(
            "{{\"t\": {time}, \"x\": {x}, \"y\": {y}, \"unit\": \"deg\", \"what\": \"gaze\", \"focus_d\": {diameter}}}"
        ),
        _ => {
            format!("{{\"t\": {time}, \"x\": {x}, \"y\": {y}, \"diameter\": {diameter}, \"confidence\": {confidence}}}")
        }
    }
}

#[test]
fn a_tracker_gone_mad() {
    let temp = place();
    let at = temp.path();
    // The system chose this port because it was free, and it stays free with high probability.
    let port = UdpSocket::bind("127.0.0.1:0").and_then(|s| s.local_addr()).expect("a port").port();
    let followed = start(at, "followed", &format!("--tracker udp://:{port}"), "");
    let stop = AtomicBool::new(false);
    let stats = std::thread::scope(|scope| {
        scope.spawn(|| {
            let (socket, mut rng) = (UdpSocket::bind("127.0.0.1:0").expect("a socket"), fastrand::Rng::with_seed(1));
            let mut count = 0;
            while !stop.load(Relaxed) {
                // Floods of lines alternate with silence.
                for _ in 0..rng.usize(..400) {
                    count += 1;
                    let _ = socket.send_to(nonsense(&mut rng, count).as_bytes(), ("127.0.0.1", port));
                }
                // Each round ends with a valid sample, which the session can follow.
                let sound = format!("{{\"t\": {}, \"x\": 1, \"y\": 1, \"diameter\": 4}}", count as f64 * 1e-3);
                let _ = socket.send_to(sound.as_bytes(), ("127.0.0.1", port));
                std::thread::sleep(Duration::from_millis(rng.u64(..20)));
            }
        });
        let stats = std::panic::catch_unwind(|| attend(at, "followed", followed, 0));
        stop.store(true, Relaxed);
        stats
    });
    let stats = stats.expect("it ended well");
    assert!(!stats.to_string().contains("null,\"y\"") && stats["steps"].as_u64().is_some(), "{stats}");
}
