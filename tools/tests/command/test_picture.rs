//! `eyebox display test-picture` and the check of its captures.

use crate::common::xorg::Xorg;
use crate::common::xvfb::Server;
use crate::common::{command, done, folder, json, refusal, text};
use std::path::Path;
use std::process::Stdio;
use std::time::{Duration, Instant};

/// A display of 120 x 300 pixels.
fn bench(at: &Path) {
    std::fs::write(
        at.join("bench.toml"),
        "resolution = [120, 300]\npitch_um = 8.0\nfocal_length_mm = 200.0\nwavelengths_nm = { green = 520 }\n",
    )
    .expect("written");
}

fn save(at: &Path, name: &str, [height, width]: [usize; 2], rgb: &[u8]) {
    image::save_buffer(at.join(name), rgb, width as u32, height as u32, image::ExtendedColorType::Rgb8).expect("saved");
}

#[test]
fn captures_of_the_picture_name_the_faults() {
    let temp = folder();
    let at = temp.path();
    bench(at);
    done(at, &["display", "test-picture", "bench.toml", "-o", "test.png"]);
    let exact = json(at, &["display", "check", "bench.toml", "--captured", "test.png", "--json"]);
    assert_eq!((&exact["faults"], &exact["merged_levels"]), (&serde_json::json!([]), &0.into()));
    let picture = image::open(at.join("test.png")).expect("a picture").into_rgb8();
    assert_eq!(picture.dimensions(), (300, 120));
    let limited: Vec<u8> =
        picture.as_raw().iter().map(|v| (16.0 + 219.0 * f64::from(*v) / 255.0).round() as u8).collect();
    save(at, "limited.png", [120, 300], &limited);
    let report = json(at, &["display", "check", "bench.toml", "--captured", "limited.png", "--json"]);
    assert_eq!((&report["faults"][0]["kind"], &report["merged_levels"]), (&"limited_range".into(), &36.into()));
    let words = done(at, &["display", "check", "bench.toml", "--captured", "limited.png"]);
    assert!(words.contains("Broadcast RGB") && words.contains("36"), "{words}");
    save(at, "gray.png", [120, 300], &vec![77; 3 * 120 * 300]);
    let refused = refusal(at, &["display", "check", "bench.toml", "--captured", "gray.png"]);
    assert_eq!(refused.code, "test-picture/not-a-capture");
    let missing = refusal(at, &["display", "check", "bench.toml", "--captured", "none.png"]);
    assert_eq!(missing.code, "file/read");
    std::fs::write(at.join("broken.png"), b"\x89PNG").expect("written");
    let broken = refusal(at, &["display", "check", "bench.toml", "--captured", "broken.png"]);
    assert_eq!(broken.code, "file/content/no-whole-png");
    let small = refusal(at, &["display", "test-picture", "bench.toml", "--output", "offscreen"]);
    assert_eq!(small.code, "arguments/not-shown");
}

/// The screen has exactly the bytes of the file, so a grab of it has no fault.
#[test]
fn the_picture_on_a_screen_is_the_file() {
    let temp = folder();
    let at = temp.path();
    bench(at);
    let server = Server::start(at, [120, 300], &["-noreset"]);
    let mut showing = command(at, &["display", "test-picture", "bench.toml", "-o", "test.png", "--output", "window"])
        .env("DISPLAY", &server.name)
        .env_remove("WAYLAND_DISPLAY")
        .stderr(Stdio::piped())
        .spawn()
        .expect("it starts");
    let since = Instant::now();
    let wanted = loop {
        if let Ok(picture) = image::open(at.join("test.png")) {
            break picture.into_rgb8().into_raw();
        }
        assert!(since.elapsed() < Duration::from_secs(60), "no file");
        std::thread::sleep(Duration::from_millis(10));
    };
    while server.part([0, 0], [120, 300]).rgb != wanted {
        assert!(since.elapsed() < Duration::from_secs(60), "the picture did not come");
        std::thread::sleep(Duration::from_millis(10));
    }
    save(at, "grab.png", [120, 300], &server.part([0, 0], [120, 300]).rgb);
    let kill = std::process::Command::new("kill").args(["-INT", &showing.id().to_string()]).status();
    assert!(kill.expect("kill").success());
    let mut said = String::new();
    std::io::Read::read_to_string(&mut showing.stderr.take().expect("its errors"), &mut said).expect("text");
    assert!(showing.wait().expect("it ends").success(), "{said}");
    let report = json(at, &["display", "check", "bench.toml", "--captured", "grab.png", "--json"]);
    assert_eq!(report["faults"], serde_json::json!([]));
}

/// `display check` without a controller prints the link of the monitor.
#[test]
fn check_prints_the_link_of_a_monitor() {
    let temp = folder();
    let at = temp.path();
    let xorg = Xorg::start(at);
    xorg.set_text("Broadcast RGB", "Limited 16:235");
    xorg.set_text("dither", "on");
    xorg.set_number("max bpc", 12);
    xorg.load_ramp([1.0, 0.8, 0.6]);
    std::fs::write(
        at.join("bench.toml"),
        "resolution = [64, 64]\npitch_um = 8.0\nfocal_length_mm = 200.0\nwavelengths_nm = { green = 520 }\n",
    )
    .expect("written");
    let check = |more: &[&str]| {
        let arguments = [&["display", "check", "bench.toml", "--force"], more].concat();
        let answer =
            command(at, &arguments).env("DISPLAY", &xorg.name).env_remove("WAYLAND_DISPLAY").output().expect("it runs");
        assert!(answer.status.success(), "{}", text(&answer.stderr));
        text(&answer.stdout)
    };
    let report: serde_json::Value = serde_json::from_str(&check(&["--json"])).expect("JSON");
    let link = &report["link"];
    assert_eq!((&link["system"], &link["output"]), (&"x11".into(), &"DUMMY0".into()));
    let state = |part: &str| {
        let all = link["checks"].as_array().expect("checks");
        all.iter().find(|c| c["part"] == part).unwrap_or_else(|| panic!("{part}: {link}")).clone()
    };
    assert_eq!(state("gamma_ramp")["state"], "set_while_shown");
    assert_eq!(state("gamma_ramp")["found"]["levels"], 102);
    assert_eq!(state("range")["found"]["kind"], "limited_range");
    assert_eq!(state("bit_depth")["found"]["value"], "12");
    assert_eq!(state("dithering")["found"]["wanted"], "off");
    for part in ["transform", "rotation", "mode_size", "compositor", "power_saving"] {
        assert_eq!(state(part)["state"], "right", "{part}");
    }
    assert_eq!(state("underscan")["state"], "unknown");
    // A check changes nothing.
    xorg.wait_for_ramp([1.0, 0.8, 0.6]);
    let words = check(&["--output", "window:DUMMY0"]);
    for command in ["--set 'Broadcast RGB' Full", "--set 'max bpc' 8", "--set dither off"] {
        assert!(words.contains(&format!("xrandr --output DUMMY0 {command}")), "{words}");
    }
}
