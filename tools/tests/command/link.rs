//! The link between the swapchain and the panel on X11 is set right while a hologram shows, and put back afterwards.
//!
//! `EYEBOX_LINK=full` waits a minute for the screen saver and shows 1,000 changes of the picture.

use crate::common::power::PowerSaving;
use crate::common::xorg::Xorg;
use crate::common::xvfb::Server;
use crate::common::{document, made, text};
use eyebox::low_level::encode::{Encoder, PhaseSet};
use eyebox::low_level::hologram::Hologram;
use eyebox::low_level::optics::{Color, Display};
use std::collections::BTreeSet;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};
use x11rb::protocol::screensaver::ConnectionExt as _;
use x11rb::protocol::xproto::{Blanking, ChangeWindowAttributesAux, ConnectionExt as _, Exposures};

/// A ramp as of night light.
const NIGHT: [f64; 3] = [1.0, 0.8, 0.6];
const LINEAR: [f64; 3] = [1.0; 3];

fn is_full() -> bool {
    std::env::var("EYEBOX_LINK").is_ok_and(|value| value == "full")
}

/// Saves a hologram of these rows and columns as `x.zarr`.
fn hologram(at: &Path, size: [usize; 2]) -> Hologram {
    let display = Display { height: size[0], width: size[1], ..Display::preset("planes24").expect("a preset") };
    let hologram = made::hologram_of(size, &display, 8, 0);
    hologram.save(&at.join("x.zarr")).expect("saved");
    hologram
}

/// Returns the video frames of a hologram as a grab of the screen has them.
fn video_frames(hologram: &Hologram, preset: &str) -> BTreeSet<Vec<u8>> {
    let &Hologram { height, width, .. } = hologram;
    let display = Display { height, width, ..Display::preset(preset).expect("a preset") };
    let colors: Vec<Color> = display.wavelengths.iter().map(|w| w.color).collect();
    let slices: Vec<&[f32]> = hologram.colors.iter().map(|c| &c.phases[..]).collect();
    let frames = Encoder::new(&display, &colors, 8).expect("an encoder").encode(&PhaseSet::trusted(&slices));
    let frames = frames.expect("encoded");
    let gray = frames.channels == 1;
    let pixels = |frame: &[u8]| if gray { frame.iter().flat_map(|g| [*g; 3]).collect() } else { frame.to_vec() };
    (0..frames.count()).map(|i| pixels(frames.frame(i))).collect()
}

/// Shows `x.zarr` on a server.
fn show(at: &Path, name: &str, [rows, columns]: [usize; 2], more: &[&str]) -> Child {
    Command::new(crate::common::program())
        .args(["show", "x.zarr", "--size", &format!("{rows}x{columns}")])
        .args(if more.contains(&"--output") { &[][..] } else { &["--output", "window"] })
        .args(if more.contains(&"--display") { &[][..] } else { &["--display", "planes24"] })
        .args(["--stats", "stats.json", "--display-rate", "20"])
        .args(more)
        .current_dir(at)
        .env("DISPLAY", name)
        .env_remove("WAYLAND_DISPLAY")
        .env("XDG_CACHE_HOME", at.join("cache"))
        .stderr(Stdio::piped())
        .spawn()
        .expect("it starts")
}

fn signal(process: &Child, name: &str) {
    assert!(Command::new("kill").args([name, &process.id().to_string()]).status().expect("kill").success());
}

/// Waits for the end and returns the exit code and the messages.
fn ended(process: Child) -> (Option<i32>, String) {
    let answer = process.wait_with_output().expect("it ends");
    (answer.status.code(), text(&answer.stderr))
}

#[test]
fn a_ramp_is_linear_while_a_hologram_shows_and_put_back_on_every_way_out() {
    let temp = tempfile::tempdir().expect("a folder");
    let at = temp.path();
    hologram(at, [64, 64]);
    let xorg = Xorg::start(at);
    xorg.load_ramp(NIGHT);
    let started = |more: &[&str]| {
        let process = show(at, &xorg.name, [64, 64], more);
        let window = xorg.wait_for_window().0;
        xorg.wait_for_ramp(LINEAR);
        (process, window)
    };
    // The duration ends it.
    let (process, _) = started(&["--duration", "1"]);
    let (code, said) = ended(process);
    assert_eq!(code, Some(0), "{said}");
    assert!(said.contains("102 of 255"), "{said}");
    xorg.wait_for_ramp(NIGHT);
    let stats = document(&at.join("stats.json"));
    let ramp = stats["link"]["checks"].as_array().expect("checks").iter().find(|c| c["part"] == "gamma_ramp");
    let ramp = ramp.expect("a ramp");
    assert_eq!((&ramp["state"], &ramp["found"]["levels"]), (&"set_right".into(), &102.into()));
    assert_eq!(stats["interference"], serde_json::json!([]), "it was set right before the first picture");
    // Ctrl-C.
    let (process, _) = started(&[]);
    signal(&process, "-INT");
    assert_eq!(ended(process).0, Some(0));
    xorg.wait_for_ramp(NIGHT);
    // The display is lost, because another program destroys the window or cuts the connection.
    for cut in [false, true] {
        let (process, window) = started(&[]);
        // The session presents for a while.
        std::thread::sleep(Duration::from_millis(300));
        match cut {
            true => drop(xorg.connection.kill_client(window).expect("sent")),
            false => drop(xorg.connection.destroy_window(window).expect("sent")),
        }
        xorg.connection.get_input_focus().expect("sent").reply().expect("an answer");
        assert_eq!(ended(process).0, Some(3));
        xorg.wait_for_ramp(NIGHT);
    }
    // A killed session puts nothing back, so the next start does.
    let (process, _) = started(&[]);
    signal(&process, "-KILL");
    assert_eq!(ended(process).0, None);
    xorg.wait_for_ramp(LINEAR);
    let (process, _) = started(&["--duration", "1"]);
    assert_eq!(ended(process).0, Some(0));
    xorg.wait_for_ramp(NIGHT);
    assert_eq!(document(&at.join("stats.json"))["link"]["recovered"], true);
    // A ramp that another program loads after the kill stays.
    let (process, _) = started(&[]);
    signal(&process, "-KILL");
    ended(process);
    xorg.load_ramp([0.5, 0.5, 1.0]);
    let (process, _) = started(&["--duration", "1"]);
    assert_eq!(ended(process).0, Some(0));
    xorg.wait_for_ramp([0.5, 0.5, 1.0]);
}

/// A ramp that another program loads while a hologram shows is replaced, reported, and put back at the end.
#[test]
fn night_light_that_begins_during_a_session_is_replaced_until_its_end() {
    let temp = tempfile::tempdir().expect("a folder");
    let at = temp.path();
    hologram(at, [64, 64]);
    let xorg = Xorg::start(at);
    let process = show(at, &xorg.name, [64, 64], &[]);
    xorg.wait_for_window();
    std::thread::sleep(Duration::from_millis(300));
    xorg.load_ramp(NIGHT);
    xorg.wait_for_ramp(LINEAR);
    signal(&process, "-INT");
    let (code, said) = ended(process);
    assert_eq!(code, Some(0), "{said}");
    xorg.wait_for_ramp(NIGHT);
    let found = &document(&at.join("stats.json"))["interference"];
    assert_eq!(
        (&found[0]["kind"], &found[0]["levels"], &found[0]["corrected"]),
        (&"gamma_ramp".into(), &102.into(), &true.into())
    );
}

#[test]
fn properties_of_the_output_are_reported_with_their_commands() {
    let temp = tempfile::tempdir().expect("a folder");
    let at = temp.path();
    hologram(at, [64, 64]);
    let xorg = Xorg::start(at);
    xorg.set_text("Broadcast RGB", "Limited 16:235");
    let process = show(at, &xorg.name, [64, 64], &[]);
    let (window, ..) = xorg.wait_for_window();
    std::thread::sleep(Duration::from_millis(300));
    let bypass = xorg.atom("_NET_WM_BYPASS_COMPOSITOR");
    let value =
        xorg.connection.get_property(false, window, bypass, 6_u32, 0, 1).expect("sent").reply().expect("a value");
    assert_eq!(value.value32().and_then(|mut v| v.next()), Some(1));
    // This one changes while the hologram shows.
    xorg.set_text("underscan", "on");
    std::thread::sleep(Duration::from_millis(2500));
    signal(&process, "-INT");
    let (code, said) = ended(process);
    assert_eq!(code, Some(0), "{said}");
    for command in ["xrandr --output DUMMY0 --set 'Broadcast RGB' Full", "xrandr --output DUMMY0 --set underscan off"] {
        assert_eq!(said.matches(command).count(), 1, "{said}");
    }
    let stats = document(&at.join("stats.json"));
    let kinds: Vec<_> = stats["interference"].as_array().expect("a list").iter().map(|i| i["kind"].clone()).collect();
    assert_eq!(kinds, ["limited_range", "property"]);
}

/// Returns true if the screen saver is on.
fn saver_is_on(xorg: &Xorg) -> bool {
    xorg.connection.screensaver_query_info(xorg.root).expect("sent").reply().expect("its state").state == 1
}

#[test]
fn the_screen_saver_waits_for_the_end() {
    let temp = tempfile::tempdir().expect("a folder");
    let at = temp.path();
    hologram(at, [64, 64]);
    let xorg = Xorg::start(at);
    let timeout: i16 = if is_full() { 60 } else { 4 };
    let set = xorg.connection.set_screen_saver(timeout, 0, Blanking::NOT_PREFERRED, Exposures::ALLOWED);
    set.expect("sent").check().expect("a timeout");
    let process = show(at, &xorg.name, [64, 64], &[]);
    xorg.wait_for_window();
    let since = Instant::now();
    while since.elapsed() < Duration::from_secs(timeout as u64 + 3) {
        assert!(!saver_is_on(&xorg), "after {:?}", since.elapsed());
        std::thread::sleep(Duration::from_millis(50));
    }
    signal(&process, "-INT");
    assert_eq!(ended(process).0, Some(0));
    // Without the session, the saver does come on.
    let since = Instant::now();
    while !saver_is_on(&xorg) {
        assert!(since.elapsed() < Duration::from_secs(timeout as u64 + 60), "the saver never came on");
        std::thread::sleep(Duration::from_millis(50));
    }
}

#[test]
fn timeouts_of_power_saving_are_off_while_a_hologram_shows() {
    let temp = tempfile::tempdir().expect("a folder");
    let at = temp.path();
    hologram(at, [64, 64]);
    let server = Server::start(at, [64, 64], &["-noreset"]);
    let power = PowerSaving::before(&server);
    let was = [600, 900, 1200];
    power.set_timeouts(was);
    let wait = |timeouts: [u16; 3]| {
        let since = Instant::now();
        while power.timeouts() != timeouts {
            assert!(since.elapsed() < Duration::from_secs(60), "{:?}", power.timeouts());
            std::thread::sleep(Duration::from_millis(10));
        }
    };
    let process = show(at, &power.name, [64, 64], &["--duration", "1"]);
    wait([0; 3]);
    let (code, said) = ended(process);
    assert_eq!(code, Some(0), "{said}");
    assert_eq!(power.timeouts(), was);
    // The next start puts back what a killed session left.
    let process = show(at, &power.name, [64, 64], &[]);
    wait([0; 3]);
    signal(&process, "-KILL");
    ended(process);
    assert_eq!(power.timeouts(), [0; 3]);
    let process = show(at, &power.name, [64, 64], &["--duration", "1"]);
    assert_eq!(ended(process).0, Some(0));
    assert_eq!(power.timeouts(), was);
}

#[test]
fn the_right_monitor_of_two_is_covered() {
    let temp = tempfile::tempdir().expect("a folder");
    let at = temp.path();
    let managers = if is_full() { &["", "openbox", "xfwm4", "metacity", "i3"][..] } else { &[""] };
    for manager in managers {
        let xorg = Xorg::start(at);
        xorg.light_second();
        if manager.is_empty() {
            covers_the_right_monitor(at, &xorg);
        } else if let Some(mut process) = xorg.manage(manager, at) {
            covers_the_right_monitor(at, &xorg);
            let _ = process.kill();
            let _ = process.wait();
        } else {
            eprintln!("skipped: {manager} is missing or manages nothing");
        }
    }
}

fn covers_the_right_monitor(at: &Path, xorg: &Xorg) {
    for (size, left, names) in [
        ([64, 64], 0, ["window", "window:DUMMY0", "window:0", "window:64x64"]),
        ([80, 96], 64, ["window", "window:DUMMY1", "window:1", "window:80x96"]),
    ] {
        let _ = std::fs::remove_dir_all(at.join("x.zarr"));
        let frames = video_frames(&hologram(at, size), "planes24");
        for name in names {
            let process = show(at, &xorg.name, size, &["--output", name]);
            let since = Instant::now();
            // A window may be moved before it has its place, and a window manager has windows of this size, too.
            while !frames.contains(&xorg.grab([left, 0], size.map(|n| n as u16))) {
                assert!(since.elapsed() < Duration::from_secs(60), "{name}: {:?}", xorg.windows());
                std::thread::sleep(Duration::from_millis(10));
            }
            signal(&process, "-INT");
            let (code, said) = ended(process);
            assert_eq!(code, Some(0), "{name}: {said}");
        }
    }
}

/// Every grab of the screen has the picture before the session, the idle picture, or a video frame of the hologram.
#[test]
fn no_foreign_pixel_is_on_the_screen() {
    const BEFORE: [u8; 3] = [10, 20, 30];
    let temp = tempfile::tempdir().expect("a folder");
    let at = temp.path();
    let display = Display { height: 64, width: 64, ..Display::preset("grey8").expect("a preset") };
    let hologram = made::hologram_of([64, 64], &display, 8, 0);
    hologram.save(&at.join("x.zarr")).expect("saved");
    let frames = video_frames(&hologram, "grey8");
    let xorg = Xorg::start(at);
    let [red, green, blue] = BEFORE.map(u32::from);
    let color = ChangeWindowAttributesAux::new().background_pixel(red << 16 | green << 8 | blue);
    xorg.connection.change_window_attributes(xorg.root, &color).expect("sent").check().expect("a color");
    xorg.connection.clear_area(false, xorg.root, 0, 0, 0, 0).expect("sent").check().expect("cleared");
    let before = BEFORE.repeat(64 * 64);
    assert_eq!(xorg.grab([0, 0], [64, 64]), before);
    let changes = if is_full() { 1000 } else { 60 };
    let mut process = show(at, &xorg.name, [64, 64], &["--display", "grey8"]);
    let (mut seen, mut shown, mut last, mut stopped) = (BTreeSet::new(), 0, before.clone(), false);
    let since = Instant::now();
    let code = loop {
        let picture = xorg.grab([0, 0], [64, 64]);
        let dark = picture.iter().all(|level| *level == 0);
        assert!(dark || picture == before || frames.contains(&picture), "a foreign picture after {shown} changes");
        if picture != last {
            shown += 1;
            seen.extend(frames.get(&picture).cloned());
            last = picture;
        }
        if shown >= changes && !stopped {
            stopped = true;
            signal(&process, "-INT");
        }
        assert!(since.elapsed() < Duration::from_secs(600), "{shown} changes in ten minutes");
        if let Some(status) = process.try_wait().expect("its state") {
            break status.code();
        }
    };
    assert_eq!(code, Some(0));
    assert_eq!(seen.len(), frames.len(), "each video frame is seen");
    assert_eq!(xorg.grab([0, 0], [64, 64]), before, "the desktop is back");
}
