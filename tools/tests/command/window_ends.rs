//! How `eyebox show --output window` ends, or goes on: the window closed, destroyed, resized, the server ended, the process
//! stopped for a while.

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
    /// Content is on the screen, 30 video frames a second.
    fn new(more: &[&str]) -> Self {
        Self::at("30", more)
    }

    /// So many video frames a second.
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
            let tree = connection.query_tree(root).expect("asked").reply().expect("windows");
            let found = tree.children.into_iter().find(|w| shown(w).unwrap_or(false));
            if let Some(window) = found.filter(|_| screen.picture().iter().any(|b| *b != 0)) {
                break window;
            }
            std::thread::sleep(Duration::from_millis(5));
        };
        // So that some sets were shown.
        std::thread::sleep(Duration::from_millis(200));
        Self { folder, screen, process, connection, window }
    }

    fn sync(&self) {
        self.connection.get_input_focus().expect("asked").reply().expect("an answer");
    }

    fn signal(&self, signal: &str) {
        assert!(Command::new("kill").args([signal, &self.process.id().to_string()]).status().expect("kill").success());
    }

    /// Its answer, within a minute.
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

    /// It ends normally for this cause.
    fn ends_by(self, cause: &str) -> serde_json::Value {
        let (stats, _) = self.ends(0);
        assert_eq!(stats["ended_by"], cause);
        stats
    }

    /// It ends because the display is lost, with this error.
    fn loses_its_display(self, what: &str) -> String {
        let (_, answer) = self.ends(3);
        let refusal = Refusal::of(&answer);
        refusal.is(what);
        refusal.message
    }

    /// It ends with this code, without noise, and the statistics are there and add up.
    fn ends(self, code: i32) -> (serde_json::Value, Output) {
        let (answer, folder) = self.answer();
        let text = String::from_utf8_lossy(&answer.stderr).into_owned();
        assert_eq!(answer.status.code(), Some(code), "{text}");
        for noise in ["panicked", "XIO", "X connection", "validation:"] {
            assert!(!text.contains(noise), "{text}");
        }
        // What is played, where, that it flickers, two lines of what came of it, and, where it did not end well, why.
        assert!(text.lines().count() <= 6, "{text}");
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
        playing.connection.intern_atom(false, name.as_bytes()).expect("asked").reply().expect("an atom").atom
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

/// As in a suspend: nothing runs for some seconds, and then it goes on in time.
#[test]
fn the_process_stands_still_for_some_seconds() {
    let playing = Playing::new(&["--validation"]);
    playing.signal("-STOP");
    std::thread::sleep(Duration::from_secs(3));
    playing.signal("-CONT");
    std::thread::sleep(Duration::from_secs(1));
    playing.signal("-INT");
    let stats = playing.ends_by("ctrl-C");
    // 90 video frames, less what a busy machine takes longer to stop and to go on.
    assert!(stats["missed_presents"].as_u64().is_some_and(|n| n >= 60), "{stats}");
}

/// At two video frames a second the first one's idle picture takes half a second or more: the second does not wait for it.
#[test]
fn a_second_interruption_ends_it_at_once() {
    let playing = Playing::at("2", &[]);
    common::interrupt_twice(playing.process.id());
    let (answer, folder) = playing.answer();
    let text = String::from_utf8_lossy(&answer.stderr).into_owned();
    assert_eq!(answer.status.code(), Some(130), "{text}");
    // It has the content, the output and the flicker. It has no statistics except those of the running session.
    assert!(text.lines().count() <= 3, "{text}");
    let stats = std::fs::read_to_string(folder.path().join("stats.json")).unwrap_or("{}".into());
    assert!(
        serde_json::from_str::<serde_json::Value>(&stats).is_ok_and(|stats| stats["ended_by"].is_null()),
        "{stats}"
    );
}
