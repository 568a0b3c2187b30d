//! A desktop disturbs an SLM while a hologram plays. Each disturbance is reported when it occurs and in the statistics.

use crate::common::Printed;
use crate::common::power::PowerSaving;
use crate::common::screen::{Screen, hologram, play};
use eyebox::low_level::optics::Display;
use serde_json::{Value, json};
use std::io::{BufRead, BufReader};
use std::process::Command;
use x11rb::connection::Connection;
use x11rb::protocol::randr::ConnectionExt as _;
use x11rb::protocol::xproto::{ConnectionExt as _, ScreenSaver};
use x11rb::rust_connection::RustConnection;

/// Loads a gamma ramp that multiplies each level by `share`.
fn load_ramp(server: &RustConnection, root: u32, share: f64) {
    let resources = server.randr_get_screen_resources_current(root).expect("sent").reply().expect("resources");
    let crtc = resources.crtcs[0];
    let size = server.randr_get_crtc_gamma_size(crtc).expect("sent").reply().expect("a size").size;
    let last = f64::from(size) - 1.0;
    let ramp: Vec<u16> = (0..size).map(|i| (share * 65535.0 * f64::from(i) / last).round() as u16).collect();
    server.randr_set_crtc_gamma(crtc, &ramp, &ramp, &ramp).expect("sent").check().expect("a ramp");
}

#[test]
fn a_changed_ramp_and_a_screen_saver_are_reported() {
    let here = tempfile::tempdir().expect("a folder");
    hologram(here.path(), &Display { height: 36, width: 64, ..Display::preset("planes24").expect("a preset") });
    let screen = Screen::new(here.path(), [36, 64]);
    let (server, number) = x11rb::connect(Some(screen.name())).expect("a connection");
    let root = server.setup().roots[number].root;
    // A linear ramp is no fault.
    load_ramp(&server, root, 1.0);
    let mut playing = play(here.path(), &screen, "planes24", &["--stats", "stats.json"]).spawn().expect("it starts");
    let mut lines = BufReader::new(playing.stderr.take().expect("standard error")).lines().map_while(Result::ok);
    // The window is open when the first line describes it.
    let mut before = vec![lines.next().expect("a line")];
    load_ramp(&server, root, 0.8);
    before.push(lines.find(|line| line.has("51 255")).expect("a line about the ramp"));
    server.force_screen_saver(ScreenSaver::ACTIVE).expect("sent").check().expect("the screen saver");
    // The remedy is a command.
    before.push(lines.find(|line| line.contains("xset s off")).expect("a line about the screen saver"));
    assert!(Command::new("kill").args(["-INT", &playing.id().to_string()]).status().expect("kill").success());
    before.extend(lines);
    assert_eq!(playing.wait().expect("it ends").code(), Some(0), "{before:?}");
    let statistics: Value =
        serde_json::from_slice(&std::fs::read(here.path().join("stats.json")).expect("statistics")).expect("JSON");
    let found = statistics["interference"].as_array().expect("a list");
    assert_eq!(found.len(), 2, "{found:?}");
    assert_eq!((&found[0]["kind"], &found[0]["levels"]), (&json!("gamma_ramp"), &json!(51)));
    assert_eq!(found[1], json!({ "kind": "screen_saver" }));
}

#[test]
fn a_monitor_that_power_saving_switches_off_is_reported_each_time() {
    let here = tempfile::tempdir().expect("a folder");
    hologram(here.path(), &Display { height: 36, width: 64, ..Display::preset("planes24").expect("a preset") });
    let screen = Screen::new(here.path(), [36, 64]);
    let power = PowerSaving::before(&screen.server);
    let mut command = play(here.path(), &screen, "planes24", &["--stats", "stats.json"]);
    let mut playing = command.env("DISPLAY", &power.name).spawn().expect("it starts");
    let mut lines = BufReader::new(playing.stderr.take().expect("standard error")).lines().map_while(Result::ok);
    let mut seen = vec![lines.next().expect("a line")];
    // Standby (1), suspended (2) and off (3) are all dark.
    for level in [3, 1] {
        power.set(level);
        seen.push(lines.find(|line| line.contains("xset -dpms")).expect("a line about the monitor"));
        power.set(0);
    }
    assert!(Command::new("kill").args(["-INT", &playing.id().to_string()]).status().expect("kill").success());
    seen.extend(lines);
    assert_eq!(playing.wait().expect("it ends").code(), Some(0), "{seen:?}");
    let statistics: Value =
        serde_json::from_slice(&std::fs::read(here.path().join("stats.json")).expect("statistics")).expect("JSON");
    let power_saving = json!({ "kind": "power_saving" });
    assert_eq!(statistics["interference"], json!([power_saving, power_saving]));
}
