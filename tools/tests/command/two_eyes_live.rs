//! `eyebox show` on two panels with content that is made while it is shown, which is splats and frames of applications.

use super::common::{self, document, done, folder, refused, text};
use super::two_eyes::display;
use serde_json::Value;

const SPLATS: &str = "builtin:still-life-splats";
const SIMULATED: [&str; 10] = [
    "--tracker",
    "simulated",
    "--clock",
    "simulated",
    "--set",
    "show.step_time=2",
    "--engine",
    "cpu",
    "--stats",
    "s.json",
];

/// The camera walks, and both eyes show the same moment of it. A simulated clock shows the same bytes again.
#[test]
fn splats_are_drawn_for_both_eyes() {
    let temp = folder();
    let at = temp.path();
    display(at, "");
    let show = ["show", SPLATS, "--display", "two.toml", "--duration", "0.4", "--output", "raw:shown.raw"];
    let shown = |more: &[&str]| {
        done(at, &[&show[..], &SIMULATED, more].concat());
        let stats = document(&at.join("s.json"));
        let frames = std::fs::read(at.join("shown.raw")).unwrap();
        std::fs::remove_file(at.join("shown.raw")).unwrap();
        std::fs::remove_file(at.join("s.json")).unwrap();
        (stats, frames)
    };
    let walk = ["--walk", "around", "--walk-time", "2"];
    let (stats, frames) = shown(&walk);
    let both = &stats["two_eyes"];
    assert_eq!((&both["stereo"], &both["differing"]), (&"together".into(), &0.into()), "{both}");
    assert!(both["video_frames"].as_u64().unwrap() > 10, "{both}");
    let [left, right] = [&stats["content"], &both["right_eye"]["content"]].map(|eye| eye["shown"].as_u64().unwrap());
    assert!(left >= 5 && left == right, "{left} and {right} views of a camera that moves");
    assert_eq!(shown(&walk).1, frames);
    let (still, _) = shown(&[]);
    let [left, right] =
        [&still["content"], &still["two_eyes"]["right_eye"]["content"]].map(|eye| eye["shown"].as_u64().unwrap());
    assert!(left >= 1 && right >= 1 && still["two_eyes"]["differing"] == 0, "{still}");
    let fast = [&show[..], &SIMULATED, &["--quality", "fast"]].concat();
    refused(at, &fast, "s.json", "arguments/quality-of-splats");
    let untracked = ["show", SPLATS, "--display", "two.toml", "--walk", "around"];
    refused(at, &untracked, "s.json", "arguments/walk-without-splats");
}

/// Splats without a tracker are solved for each eye.
#[test]
fn splats_of_both_eyes_are_played() {
    let temp = folder();
    let at = temp.path();
    display(at, "");
    let solved = ["--quality", "fast", "--views", "3", "--engine", "cpu", "--clock", "simulated", "--stats", "s.json"];
    done(at, &[&["show", SPLATS, "--display", "two.toml", "--duration", "0.2"][..], &solved].concat());
    assert_eq!(document(&at.join("s.json"))["two_eyes"]["differing"], 0);
}

/// An application sends frames of the same time to both eyes. No video frame has frames of different times.
#[test]
fn an_application_is_shown_to_both_eyes() {
    use eyebox_live_input::{Application, Content, FrameInfo, Sample, Transfer};
    use std::time::{Duration, Instant};

    let temp = folder();
    let at = temp.path();
    display(at, "");
    let show = ["show", "live:app", "--display", "two.toml", "--engine", "cpu", "--stats", "s.json"];
    refused(at, &show, "s.json", "arguments/application-of-two-eyes");
    let simulated = [
        &show[..],
        &["--tracker", "simulated", "--clock", "simulated", "--set", "show.step_time=3", "--duration", "1"],
    ]
    .concat();
    refused(at, &simulated, "s.json", "arguments/live");
    let mut command =
        common::command(at, &[&show[..], &["--tracker", "simulated", "--set", "show.ask=depth"]].concat());
    let mut session = command.env("XDG_RUNTIME_DIR", at).spawn().expect("it starts");
    let begun = Instant::now();
    let connect = |eye: &str| loop {
        match Application::connect_in(&at.join("eyebox"), &format!("app-{eye}")) {
            Ok(application) => return application,
            Err(error) => assert!(begun.elapsed() < Duration::from_secs(120), "{error}"),
        }
        std::thread::sleep(Duration::from_millis(20));
    };
    let mut eyes = [connect("left"), connect("right")];
    let pixels = 48 * 48;
    let mut sent = 0i64;
    let content = |stats: &Value| stats["two_eyes"]["right_eye"]["content"]["shown"].as_u64();
    let frames_shown = |session: &mut std::process::Child| {
        // The statistics are written at the end.
        std::process::Command::new("kill").args(["-INT", &session.id().to_string()]).status().unwrap();
        assert!(session.wait().unwrap().success());
        document(&at.join("s.json"))
    };
    while begun.elapsed() < Duration::from_secs(6) || sent < 20 {
        assert!(begun.elapsed() < Duration::from_secs(180), "{sent} frames were sent");
        sent += 1;
        for (eye, application) in eyes.iter_mut().enumerate() {
            let info = FrameInfo {
                content_time_ns: 1_000_000 * sent,
                ..FrameInfo::new(Content::ColorAndDepth, Sample::F32, Transfer::Linear)
            };
            let light = |i: i64| ((i + 5 * sent + eye as i64) % 48) as f32 / 48.0;
            let samples: Vec<u8> = (0..pixels).flat_map(|i| light(i).to_le_bytes()).collect();
            application.send(&info, &samples, &vec![0.1; pixels as usize]).expect("sent");
        }
        std::thread::sleep(Duration::from_millis(60));
    }
    let stats = frames_shown(&mut session);
    let both = &stats["two_eyes"];
    assert_eq!((&both["stereo"], &both["differing"]), (&"together".into(), &0.into()), "{both}");
    assert!(both["video_frames"].as_u64().unwrap() >= 1, "{both}");
    assert_eq!(stats["content"]["source"], "live:app-left");
    assert!(content(&stats).unwrap() >= 2, "{both}");
}

/// The layer sends each eye of an application to its panel.
#[test]
fn an_openxr_application_is_shown_to_both_eyes() {
    let temp = folder();
    let at = temp.path();
    if !super::openxr::has_layer() || !super::openxr::build(at) {
        return;
    }
    display(at, "");
    let client = at.join("client").display().to_string();
    let show = ["show", "openxr", "--display", "two.toml", "--engine", "cpu", "--tracker", "simulated"];
    let words = ["--duration", "8", "--stats", "s.json", "--", &client, "frames=250", "depth=d16", "size=128x96"];
    let mut command = common::command(at, &[&show[..], &words].concat());
    super::openxr::with_runtime(&mut command, at).env("NULL_RUNTIME_PERIOD_US", "20000");
    let shown = command.output().expect("it starts");
    let errors = text(&shown.stderr);
    assert!(shown.status.success(), "{errors}");
    let stats = document(&at.join("s.json"));
    let both = &stats["two_eyes"];
    let sources = [&stats["content"], &both["right_eye"]["content"]].map(|eye| eye["source"].clone());
    assert_eq!(sources, ["live:openxr-left", "live:openxr-right"].map(Value::from));
    assert!(both["video_frames"].as_u64().unwrap() >= 1 && both["differing"] == 0, "{both}: {errors}");
    assert!(both["right_eye"]["content"]["shown"].as_u64().unwrap() >= 1, "{both}: {errors}");
}
