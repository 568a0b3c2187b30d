//! `eyebox feed`, an application for tests, as a display receives it.

use super::common::{self, done, refused, text};
use eyebox::low_level::optics::{Color, Display as Optics};
use eyebox::low_level::scene::{self, Request};
use eyebox_live_input::{Content, Display, Kind, Latest, Offer};
use std::path::Path;
use std::process::Stdio;
use std::time::Duration;

fn display(runtime: &Path) -> Display {
    let offer = Offer {
        size: [16, 24],
        colors: [false, true, true],
        kinds: vec![Kind::Views],
        views: [3, 3],
        layers: 1,
        slots: 3,
        pixel_angle: 2e-5,
        eyebox_mm: [20.0, 20.0],
    };
    Display::open_in(&runtime.join("eyebox"), "show", offer).unwrap()
}

/// Each received frame is bit-identical to the light field of its place on the path.
#[test]
fn a_path_is_fed_as_it_is_loaded() {
    let temp = common::folder();
    let mut display = display(temp.path());
    let mut frame = display.frame();
    let args = ["feed", "builtin:plane?brightness=0.5", "--name", "show", "--rate", "200", "--move=depth=-1..1"];
    let mut command = common::command(temp.path(), &args);
    command
        .args(["--display", "small", "--move-frames", "3", "--count", "9", "--json"])
        .env("XDG_RUNTIME_DIR", temp.path());
    let mut feed = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let optics = Optics { height: 16, width: 24, ..Optics::preset("small").unwrap() };
    let request = Request { views: 3, ..Request::new(&optics, &[Color::Green, Color::Blue]) };
    let mut taken = 0;
    loop {
        let ended = feed.try_wait().unwrap().is_some();
        match display.latest(&mut frame) {
            Latest::New => {
                taken += 1;
                let depth = ["-1", "0", "1", "0"][(frame.number() as usize - 1) % 4];
                let field = scene::load(&format!("builtin:plane?brightness=0.5&depth={depth}"), &request).unwrap();
                let pitch_mm = field.cell(&optics) * 1e3;
                assert_eq!(frame.info().content, Content::Views { grid: [3, 3], pitch_mm });
                for (channel, views) in field.planes.iter().enumerate() {
                    assert!(frame.channel(channel) == views.concat(), "frame {}, channel {channel}", frame.number());
                }
            }
            Latest::Gone if ended => break,
            Latest::Late | Latest::Gone => drop(display.wait(Duration::from_millis(10))),
            other => panic!("{other:?}"),
        }
    }
    let output = feed.wait_with_output().unwrap();
    assert!(output.status.success() && taken >= 1 && frame.number() == 9, "{}", text(&output.stderr));
    let account: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!((account["given"].as_u64(), account["ended"].as_str()), (Some(9), Some("all given")));
}

#[test]
fn mistakes_are_one_line() {
    let temp = common::folder();
    let at = temp.path();
    refused(at, &["feed", "builtin:plane", "--name", "../x"], "x", "live 64");
    refused(at, &["feed", "builtin:plane", "--name", "x", "--move=depth"], "x", "usage/value-validation KEY=A..B");
    refused(at, &["feed", "a", "b", "--name", "x", "--move=depth=0..1"], "x", "arguments/path-of-many --move");
    refused(at, &["feed", "builtin:plane", "--name", "nobody-takes-this"], "x", "live");
    assert!(done(at, &["feed", "--help"]).contains("--rate"));
}
