//! `eyebox show --output window` on a virtual X server, whose screen is compared byte for byte.

use crate::common::screen::{Screen, hologram, play};
use crate::common::{Refusal, document};
use eyebox::low_level::encode::{Encoder, PhaseSet};
use eyebox::low_level::optics::{Color, Display};
use std::collections::BTreeSet;
use std::process::{Command, Output};
use std::time::{Duration, Instant};

fn said(answer: &Output) -> String {
    String::from_utf8_lossy(&answer.stderr).into_owned()
}

#[test]
fn the_screen_shows_every_packing_byte_for_byte() {
    for preset in ["grey8", "fields", "planes8", "planes24", "plm"] {
        let here = tempfile::tempdir().expect("a folder");
        let display = Display { height: 36, width: 64, ..Display::preset(preset).expect("a preset") };
        let hologram = hologram(here.path(), &display);
        let colors = [Color::Red, Color::Green, Color::Blue];
        let slices: Vec<&[f32]> = hologram.colors.iter().map(|c| &c.phases[..]).collect();
        let frames = Encoder::new(&display, &colors, 8)
            .expect("an encoder")
            .encode(&PhaseSet::trusted(&slices))
            .expect("encoded");
        let expected: Vec<Vec<u8>> = (0..frames.count())
            .map(|i| match frames.channels {
                1 => frames.frame(i).iter().flat_map(|g| [*g; 3]).collect(),
                _ => frames.frame(i).to_vec(),
            })
            .collect();
        let screen = Screen::new(here.path(), [frames.height, frames.width]);
        // The rate is low enough for a slow machine to see every video frame.
        let mut playing =
            play(here.path(), &screen, preset, &["--validation", "--display-rate", "20", "--stats", "s.json"])
                .spawn()
                .expect("it starts");
        let (since, mut seen) = (Instant::now(), BTreeSet::new());
        while seen.len() < expected.len() && since.elapsed() < Duration::from_secs(60) {
            let picture = screen.picture();
            seen.extend(expected.iter().position(|e| *e == picture));
            assert!(playing.try_wait().expect("its state").is_none(), "{preset}: it ended");
            std::thread::sleep(Duration::from_millis(3));
        }
        // Ctrl-C sends this signal.
        let killed = Command::new("kill").args(["-INT", &playing.id().to_string()]).status().expect("kill");
        assert!(killed.success());
        let answer = playing.wait_with_output().expect("it ends");
        assert_eq!(answer.status.code(), Some(0), "{preset}: {}", said(&answer));
        assert_eq!(document(&here.path().join("s.json"))["ended_by"], "ctrl-C");
        assert!(!said(&answer).contains("validation:"), "{}", said(&answer));
        assert_eq!(seen.len(), expected.len(), "{preset}: of {} video frames", expected.len());
    }
}

#[test]
fn a_monitor_of_another_size_and_no_desktop_are_refused_in_a_sentence() {
    let here = tempfile::tempdir().expect("a folder");
    let display = Display { height: 36, width: 64, ..Display::preset("planes24").expect("a preset") };
    hologram(here.path(), &display);
    let screen = Screen::new(here.path(), [60, 80]);
    for (more, what) in [
        (&[][..], "present/display/monitor 36x64 60x80"),
        (&["--output", "window:0"], "present/display/monitor 36x64 60x80"),
        (&["--output", "window:60x80"], "present/display/monitor 36x64 60x80"),
        (&["--output", "window:SLM"], "present/display/no-such-monitor SLM"),
        (&["--clock", "simulated", "--duration", "1"], "arguments/without-offscreen offscreen"),
    ] {
        let answer = play(here.path(), &screen, "planes24", more).output().expect("it runs");
        let text = said(&answer);
        assert_eq!((answer.status.code(), text.trim().lines().count()), (Some(2), 1), "{text}");
        Refusal::of(&answer).is(what);
    }
    let monitors = Command::new(crate::common::program())
        .args(["display", "monitors", "--json"])
        .env("DISPLAY", screen.name())
        .env_remove("WAYLAND_DISPLAY")
        .output()
        .expect("it runs");
    let list: serde_json::Value = serde_json::from_slice(&monitors.stdout).expect("JSON");
    assert_eq!((&list["monitors"][0]["rows"], &list["monitors"][0]["columns"]), (&60.into(), &80.into()));
    let nowhere = Command::new(crate::common::program())
        .args(["display", "monitors"])
        .env_remove("DISPLAY")
        .env_remove("WAYLAND_DISPLAY")
        .output()
        .expect("it runs");
    assert!(nowhere.status.code() == Some(2) && said(&nowhere).contains("DISPLAY"), "{}", said(&nowhere));
}
