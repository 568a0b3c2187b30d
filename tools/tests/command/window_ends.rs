//! `eyebox show --output window` when the window is closed, destroyed or resized, when the server ends, and when the
//! process stops for a while.

use crate::common::screen::{Screen, hologram, play};
use crate::common::{self, Refusal};
use eyebox::low_level::optics::Display;
use std::path::Path;
use std::process::{Child, Command, Output};
use std::time::{Duration, Instant};
use x11rb::connection::Connection;
use x11rb::protocol::xproto::{ClientMessageEvent, ConfigureWindowAux, ConnectionExt, EventMask, MapState};
use x11rb::rust_connection::RustConnection;

const SIZE: [usize; 2] = [36, 64];

struct Playing {
    folder: tempfile::TempDir,
    screen: Screen,
    process: Child,
    connection: RustConnection,
    window: u32,
}

impl Playing {
    /// Starts a show at 30 video frames per second and waits until content is on the screen.
    fn new(more: &[&str]) -> Self {
        Self::at("30", more)
    }

    /// Starts a show at `rate` video frames per second and waits until content is on the screen.
    fn at(rate: &str, more: &[&str]) -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        let display = Display { height: SIZE[0], width: SIZE[1], ..Display::preset("planes24").expect("a preset") };
        hologram(folder.path(), &display);
        let screen = Screen::new(folder.path(), SIZE);
        let more = [&["--stats", "stats.json", "--display-rate", rate], more].concat();
        let mut process = play(folder.path(), &screen, "planes24", &more).spawn().expect("it starts");
        let (connection, number) = x11rb::connect(Some(screen.name())).expect("a connection");
        let root = connection.setup().roots[number].root;
        let since = Instant::now();
        let window = loop {
            assert!(process.try_wait().expect("its state").is_none(), "it ended");
            assert!(since.elapsed() < Duration::from_secs(60), "no picture came");
            let shown = |window: &u32| {
                let state = connection.get_window_attributes(*window).ok()?.reply().ok()?.map_state;
                let is = connection.get_geometry(*window).ok()?.reply().ok()?;
                Some(state == MapState::VIEWABLE && [is.height, is.width].map(usize::from) == SIZE)
            };
            let tree = connection.query_tree(root).expect("sent").reply().expect("windows");
            let found = tree.children.into_iter().find(|w| shown(w).unwrap_or(false));
            if let Some(window) = found.filter(|_| screen.picture().iter().any(|b| *b != 0)) {
                break window;
            }
            std::thread::sleep(Duration::from_millis(5));
        };
        // Some sets are shown in this time.
        std::thread::sleep(Duration::from_millis(200));
        Self { folder, screen, process, connection, window }
    }

    fn sync(&self) {
        self.connection.get_input_focus().expect("sent").reply().expect("an answer");
    }

    fn signal(&self, signal: &str) {
        assert!(Command::new("kill").args([signal, &self.process.id().to_string()]).status().expect("kill").success());
    }

    /// Returns the output of the process, which must end within a minute.
    fn answer(mut self) -> (Output, tempfile::TempDir) {
        let since = Instant::now();
        while self.process.try_wait().expect("its state").is_none() {
            if since.elapsed() > Duration::from_secs(60) {
                let _ = self.process.kill();
                panic!("it did not end");
            }
            std::thread::sleep(Duration::from_millis(10));
        }
        (self.process.wait_with_output().expect("its output"), self.folder)
    }

    /// Asserts that the show ends normally for this cause, and returns its statistics.
    fn ends_by(self, cause: &str) -> serde_json::Value {
        let (stats, _) = self.ends(0);
        assert_eq!(stats["ended_by"], cause);
        stats
    }

    /// Asserts that the show ends with this error because the display is lost, and returns the message.
    fn loses_its_display(self, what: &str) -> String {
        let (_, answer) = self.ends(3);
        let refusal = Refusal::of(&answer);
        refusal.is(what);
        refusal.message
    }

    /// Asserts that the show ends with this code and without noise, and that its statistics exist and add up.
    fn ends(self, code: i32) -> (serde_json::Value, Output) {
        let (answer, folder) = self.answer();
        let text = String::from_utf8_lossy(&answer.stderr).into_owned();
        assert_eq!(answer.status.code(), Some(code), "{text}");
        for noise in ["panicked", "XIO", "X connection", "validation:"] {
            assert!(!text.contains(noise), "{text}");
        }
        // The lines are the content, the output, the flicker, the first light, two results and the memory. An error adds
        // its line.
        assert!(text.lines().count() <= 8, "{text}");
        (stats(folder.path()), answer)
    }
}

fn stats(folder: &Path) -> serde_json::Value {
    let stats: serde_json::Value =
        serde_json::from_slice(&std::fs::read(folder.join("stats.json")).expect("statistics")).expect("JSON");
    let number = |name: &str| stats[name].as_u64().unwrap_or_else(|| panic!("{name} in {stats}"));
    let dropped: u64 =
        stats["content_dropped"].as_object().expect("causes").values().filter_map(serde_json::Value::as_u64).sum();
    assert_eq!(number("content_due"), number("content_shown") + dropped + number("content_pending"), "{stats}");
    assert_eq!(number("video_frames"), number("sets") + number("missed_presents"), "{stats}");
    assert!(number("content_shown") > 0, "{stats}");
    stats
}

#[test]
fn a_user_closes_the_window() {
    let playing = Playing::new(&["--validation"]);
    let atom = |name: &str| {
        playing.connection.intern_atom(false, name.as_bytes()).expect("sent").reply().expect("an atom").atom
    };
    let data = [atom("WM_DELETE_WINDOW"), 0, 0, 0, 0];
    let message = ClientMessageEvent::new(32, playing.window, atom("WM_PROTOCOLS"), data);
    playing.connection.send_event(false, playing.window, EventMask::NO_EVENT, message).expect("sent");
    playing.sync();
    let stats = playing.ends_by("closed");
    assert_eq!(stats["timed_by"], "the time of acquiring");
}

#[test]
fn another_program_destroys_the_window() {
    let playing = Playing::new(&[]);
    playing.connection.destroy_window(playing.window).expect("sent");
    playing.sync();
    playing.loses_its_display("lost/display");
}

#[test]
fn another_program_resizes_the_window() {
    let playing = Playing::new(&[]);
    let less = ConfigureWindowAux::new().width(60);
    playing.connection.configure_window(playing.window, &less).expect("sent");
    playing.sync();
    playing.loses_its_display("lost/display 36x64 36x60");
}

#[test]
fn the_server_ends_or_cuts_the_connection() {
    let mut playing = Playing::new(&[]);
    playing.screen.server.process.kill().expect("killed");
    let ended = playing.loses_its_display("lost/display");
    let playing = Playing::new(&[]);
    playing.connection.kill_client(playing.window).expect("sent");
    playing.sync();
    assert_eq!(playing.loses_its_display("lost/display"), ended, "either way the server is gone");
}

/// The process stops for some seconds, as in a suspend, and then continues in time.
#[test]
fn the_process_stands_still_for_some_seconds() {
    let playing = Playing::new(&["--validation"]);
    playing.signal("-STOP");
    std::thread::sleep(Duration::from_secs(3));
    playing.signal("-CONT");
    std::thread::sleep(Duration::from_secs(1));
    playing.signal("-INT");
    let stats = playing.ends_by("ctrl-C");
    // Three seconds have 90 video frames. A slow machine takes longer to stop and to continue, which leaves fewer.
    assert!(stats["missed_presents"].as_u64().is_some_and(|n| n >= 60), "{stats}");
}

/// At two video frames per second, the idle picture of the first interruption takes half a second or more. The second
/// interruption does not wait for it.
#[test]
fn a_second_interruption_ends_it_at_once() {
    let playing = Playing::at("2", &[]);
    common::interrupt_twice(playing.process.id());
    let (answer, folder) = playing.answer();
    let text = String::from_utf8_lossy(&answer.stderr).into_owned();
    assert_eq!(answer.status.code(), Some(130), "{text}");
    // The text has the content, the output, the flicker and the first light. Only the running session can have left
    // statistics.
    assert!(text.lines().count() <= 4, "{text}");
    let stats = std::fs::read_to_string(folder.path().join("stats.json")).unwrap_or("{}".into());
    assert!(
        serde_json::from_str::<serde_json::Value>(&stats).is_ok_and(|stats| stats["ended_by"].is_null()),
        "{stats}"
    );
}
