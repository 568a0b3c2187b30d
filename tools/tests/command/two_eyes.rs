//! `eyebox show` with a display of two panels.

use super::common::xorg::Xorg;
use super::common::{self, document, done, refused, text};
use serde_json::Value;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};
use x11rb::protocol::xproto::ConnectionExt as _;

const PANEL: &str = "resolution = [48, 48]\npitch_um = 8.0\nfocal_length_mm = 40.0\nwavelengths_nm = { green = 520 }\n\
                     rate_hz = 60\nlevels = 2\n[encoding]\npacking = \"planes8\"\n";
const BRIEF: [&str; 12] = [
    "--clock",
    "simulated",
    "--duration",
    "1",
    "--engine",
    "cpu",
    "--quality",
    "fast",
    "--views",
    "3",
    "--stats",
    "s.json",
];
const TRACKED: [&str; 4] = ["--tracker", "simulated", "--set", "show.step_time=4"];

pub fn display(at: &Path, more: &str) {
    std::fs::write(at.join("left.toml"), PANEL).unwrap();
    std::fs::write(at.join("right.toml"), PANEL.replace("pitch_um = 8.0", "pitch_um = 8.2")).unwrap();
    std::fs::write(at.join("two.toml"), format!("left = \"left.toml\"\nright = \"right.toml\"\n{more}")).unwrap();
}

fn shown(at: &Path, what: &[&str], more: &[&str]) -> Value {
    let answer = common::eyebox(at, &[&["show"], what, &["--display", "two.toml"], &BRIEF, more].concat());
    assert!(answer.status.success(), "{what:?} {more:?}: {}", text(&answer.stderr));
    let stats: Value = serde_json::from_slice(&std::fs::read(at.join("s.json")).unwrap()).unwrap();
    std::fs::remove_file(at.join("s.json")).unwrap();
    stats
}

/// Returns the rows and columns of the first picture of a recording.
fn recorded_size(folder: &Path) -> [u32; 2] {
    let file = std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().path());
    let picture = file.into_iter().find(|f| f.extension().is_some_and(|e| e == "png")).expect("a picture");
    let (width, height) = image::image_dimensions(picture).unwrap();
    [height, width]
}

/// One scene is refined for both eyes, on each arrangement of the panels.
#[test]
fn a_scene_is_refined_for_both_eyes() {
    let temp = common::folder();
    let at = temp.path();
    for (panels, size) in [("monitors", [96, 48]), ("side-by-side", [48, 96]), ("top-bottom", [96, 48])] {
        display(at, &format!("panels = \"{panels}\"\n"));
        let stats = shown(at, &["builtin:still-life"], &[&TRACKED[..], &["--record", panels]].concat());
        let both = &stats["two_eyes"];
        assert_eq!((&both["stereo"], &both["differing"]), (&"together".into(), &0.into()), "{both}");
        assert!(both["video_frames"].as_u64().unwrap() > 30, "{both}");
        assert!(both["right_eye"]["sets_new"].as_u64().unwrap() > 20, "{both}");
        assert_eq!(recorded_size(&at.join(panels)), size);
    }
    display(at, "stereo = \"independent\"\n");
    let stats = shown(at, &["builtin:still-life"], &TRACKED);
    assert_eq!(stats["two_eyes"]["stereo"], "independent");
}

/// Scenes and holograms are also shown as they were solved.
#[test]
fn scenes_and_holograms_of_both_eyes_are_played() {
    let temp = common::folder();
    let at = temp.path();
    display(at, "");
    let stats = shown(at, &["builtin:plane?depth=0.05"], &[]);
    assert_eq!(stats["two_eyes"]["differing"], 0);
    for eye in ["left", "right"] {
        let (panel, out) = (format!("{eye}.toml"), format!("{eye}.zarr"));
        let solve = ["solve", "builtin:plane", "--display", &panel, "--steps", "2", "--frames", "8", "--views", "3"];
        done(at, &[&solve[..], &["--engine", "cpu", "-o", &out]].concat());
    }
    let answer =
        common::eyebox(
            at,
            &[
                &[
                    "show",
                    "left.zarr",
                    "right.zarr",
                    "--display",
                    "two.toml",
                    "--engine",
                    "cpu",
                    "--clock",
                    "simulated",
                ][..],
                &["--duration", "0.5", "--json"],
            ]
            .concat(),
        );
    assert!(answer.status.success(), "{}", text(&answer.stderr));
    let report: Value = serde_json::from_slice(&answer.stdout).unwrap();
    let both = &report["two_eyes"];
    assert!(both["video_frames"].as_u64().unwrap() > 20 && both["differing"] == 0, "{both}");
}

#[test]
fn what_two_panels_cannot_show_is_refused() {
    let temp = common::folder();
    let at = temp.path();
    display(at, "");
    let refusal = |args: &[&str], code| refused(at, &[args, &["--display", "two.toml"]].concat(), "a.zarr", code);
    for (args, code) in [
        (&["solve", "builtin:plane", "-o", "a.zarr"][..], "optics/display-file/two-panels"),
        (&["show", "builtin:plane", "builtin:chart"], "arguments/content-of-two-eyes"),
        (&["show", "builtin:plane", "--view"], "arguments/one-eye-option"),
        (&["show", "builtin:plane", "--tracker", "mouse"], "arguments/one-eye-option"),
    ] {
        refusal(args, code);
    }
    display(at, "ipd_mm = 10\n");
    refusal(&["show", "builtin:plane"], "optics/display-file/ipd");
}

/// Returns the seconds of a session on two monitors. `EYEBOX_LINK=full` takes a minute.
fn seconds() -> &'static str {
    if std::env::var("EYEBOX_LINK").is_ok_and(|value| value == "full") { "60" } else { "4" }
}

fn on_monitors(at: &Path, xorg: &Xorg, output: &str) -> Child {
    Command::new(common::program())
        .args(["show", "builtin:still-life", "--display", "two.toml", "--tracker", "simulated", "--output", output])
        .args(["--size", "64x64", "--duration", seconds(), "--stats", "s.json", "--display-rate", "20"])
        .args(["--quality", "fast", "--views", "3", "--engine", "cpu"])
        .current_dir(at)
        .env("DISPLAY", &xorg.name)
        .env_remove("WAYLAND_DISPLAY")
        .env("XDG_CACHE_HOME", at.join("cache"))
        .stderr(Stdio::piped())
        .spawn()
        .expect("it starts")
}

/// Waits for windows over both monitors and returns the one of the right monitor.
fn wait_for_both(xorg: &Xorg) -> u32 {
    let since = Instant::now();
    loop {
        let windows = xorg.windows();
        let at = |left: i16| windows.iter().find(|(_, place, size)| (*place, *size) == ([left, 0], [64, 64]));
        if let (Some(_), Some((right, ..))) = (at(0), at(64)) {
            return *right;
        }
        assert!(since.elapsed() < Duration::from_secs(120), "{windows:?}");
        std::thread::sleep(Duration::from_millis(20));
    }
}

/// Two windows on two monitors are two eyes. Each set of both is in the same video frame, and a window that is destroyed
/// leaves the other one showing.
#[test]
fn windows_on_two_monitors_are_two_eyes() {
    let temp = common::folder();
    let at = temp.path();
    display(at, "");
    let xorg = Xorg::start(at);
    xorg.light_second_of(64);
    for output in ["window", "window:DUMMY1,DUMMY0"] {
        let process = on_monitors(at, &xorg, output);
        wait_for_both(&xorg);
        let answer = process.wait_with_output().expect("it ends");
        let said = text(&answer.stderr);
        assert!(answer.status.success(), "{said}");
        let stats = document(&at.join("s.json"));
        let both = &stats["two_eyes"];
        let count = |value: &Value| value.as_u64().expect("a count");
        println!(
            "{output}: {} video frames, {} differing, lights {}",
            both["video_frames"], both["differing"], both["light_apart"]
        );
        assert!(count(&both["video_frames"]) > 20 && count(&both["differing"]) == 0, "{both}");
        // A driver may report the lights of few video frames.
        assert!(both["light_apart"]["video_frames"].is_u64(), "{both}");
        assert!(count(&stats["sets_new"]) > 3 && stats["sets_new"] == both["right_eye"]["sets_new"], "{stats}");
        // The link to each panel is checked.
        let outputs = [&stats["link"]["output"], &both["right_link"]["output"]];
        assert_ne!(outputs[0], outputs[1]);
    }
    let process = on_monitors(at, &xorg, "window");
    let right = wait_for_both(&xorg);
    std::thread::sleep(Duration::from_millis(500));
    xorg.connection.destroy_window(right).expect("sent");
    xorg.connection.get_input_focus().expect("sent").reply().expect("an answer");
    let answer = process.wait_with_output().expect("it ends");
    let said = text(&answer.stderr);
    assert!(answer.status.success(), "{said}");
    assert!(said.contains("right panel"), "{said}");
    assert_eq!(document(&at.join("s.json"))["ended_by"], "the duration");
    // Both eyes need monitors of their own.
    let answer = on_monitors(at, &xorg, "window:DUMMY0,DUMMY0").wait_with_output().expect("it ends");
    assert_eq!(answer.status.code(), Some(2));
    assert!(text(&answer.stderr).contains("DUMMY0"));
}
