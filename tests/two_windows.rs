//! A window that plays and a preview beside it, in one process, on one thread, with validation: each shows its own, and
//! neither stops the other.
//!
//! It runs itself again with a virtual X server's name, so that this process's surroundings stay as they are.

use eyebox::low_level::gpu::{Gpu, Options};
use eyebox::low_level::present::{Desktop, Presenter, RealClock, WindowEvent};
use eyebox::low_level::preview::{Overlay, Picture, PreviewWindow, places};
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// Where the server keeps its pixels; set where the windows are.
const PIXELS: &str = "EYEBOX_TEST_PIXELS";
const SCREEN: [usize; 2] = [60, 80];
const SMALL: [usize; 2] = [20, 30];

fn main() {
    // Asked for a list of tests, there is this one.
    if std::env::args().any(|a| a == "--list") {
        println!("two_windows: test");
    } else if let Some(pixels) = std::env::var_os(PIXELS) {
        windows(&PathBuf::from(pixels));
    } else if cfg!(target_os = "linux") {
        with_server();
    }
}

fn with_server() {
    let folder = tempfile::tempdir().expect("a folder");
    let [height, width] = SCREEN;
    let mut server = Command::new("Xvfb")
        .args(["-displayfd", "1", "-screen", "0", &format!("{width}x{height}x24"), "-nolisten", "tcp", "-nocursor"])
        .arg("-fbdir")
        .arg(folder.path())
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .expect("Xvfb, which tools/setup.sh installs");
    let mut number = String::new();
    BufReader::new(server.stdout.take().expect("its output")).read_line(&mut number).expect("its number");
    let status = Command::new(std::env::current_exe().expect("this program"))
        .env("DISPLAY", format!(":{}", number.trim()))
        .env(PIXELS, folder.path().join("Xvfb_screen0"))
        .env_remove("WAYLAND_DISPLAY")
        .status();
    let _ = server.kill();
    let _ = server.wait();
    assert!(status.expect("it starts").success(), "two windows");
    println!("two windows ... ok");
}

/// (row, column, channel) of the screen.
fn screen(pixels: &Path) -> Vec<[u8; 3]> {
    let bytes = std::fs::read(pixels).expect("the frame buffer");
    let word = |i: usize| u32::from_be_bytes(bytes[4 * i..4 * i + 4].try_into().expect("a word")) as usize;
    let (header, line, colors) = (word(0), word(12), word(19));
    let rows = bytes[header + 12 * colors..].chunks_exact(line).take(SCREEN[0]);
    rows.flat_map(|row| row.chunks_exact(4).take(SCREEN[1]).map(|p| [p[2], p[1], p[0]])).collect()
}

fn windows(pixels: &Path) {
    let options = Options { allow_cpu: true, present: true, validation: true, ..Options::default() };
    let gpu = Gpu::open(&options).expect("a device");
    let desktop = Desktop::open().expect("a desktop");
    let monitor = desktop.choose(None, SCREEN).expect("a monitor");
    let mut playing = desktop.fullscreen(&gpu, &monitor, RealClock::start()).expect("a window");
    let mut preview = {
        let desktop = playing.desktop().expect("its desktop");
        PreviewWindow::open(&gpu, desktop, "preview", SMALL).expect("a preview")
    };
    // One device for both.
    assert!(playing.gpu().is(&gpu) && preview.gpu().is(&gpu));
    assert_eq!(preview.size(), SMALL);
    let frame =
        |k: u64| -> Vec<u8> { (0..3 * SCREEN[0] * SCREEN[1]).map(|i| ((i as u64 * 7 + k * 31) % 251) as u8).collect() };
    let picture = |k: u64| -> Picture {
        Picture {
            size: SMALL,
            rgb: (0..3 * SMALL[0] * SMALL[1]).map(|i| ((i as u64 * 5 + k * 17) % 241) as u8).collect(),
        }
    };
    let (mut id, mut closed) = (0, false);
    // As a player does: present, and serve what is beside it in passing.
    let mut turn = |k: u64, shown: bool| {
        playing.upload(&frame(k)).expect("taken in");
        playing.present(id, 0).expect("presented");
        id += 1;
        assert!(playing.event().is_none());
        while let Some(event) = preview.event() {
            closed |= event == WindowEvent::Close;
        }
        if shown {
            let place = places(preview.size(), SMALL, 1)[0];
            preview.show(&[(place, &picture(k))], &Overlay::default());
        }
        preview.refresh().expect("refreshed")
    };
    for k in 0..=20 {
        turn(k, true);
    }
    // The last of each comes to the screen, the preview over the window that plays, while that goes on.
    let (since, under, over) = (Instant::now(), frame(20), picture(20));
    loop {
        let (done, is) = (turn(20, false), screen(pixels));
        let right = |i: usize| {
            let (row, column) = (i / SCREEN[1], i % SCREEN[1]);
            let at = 3 * (row * SMALL[1] + column);
            let inside = row < SMALL[0] && column < SMALL[1];
            let wanted = if inside { &over.rgb[at..at + 3] } else { &under[3 * i..3 * i + 3] };
            is[i][..] == *wanted
        };
        if done && (0..is.len()).all(right) {
            break;
        }
        assert!(since.elapsed() < Duration::from_secs(60), "the windows do not show what they were given");
        std::thread::sleep(Duration::from_millis(5));
    }
    assert!(!closed);
    // The preview closes, and playing goes on.
    drop(preview);
    for k in 21..25 {
        playing.upload(&frame(k)).expect("taken in");
        playing.present(1000 + k, 0).expect("presented");
        assert!(playing.event().is_none(), "the preview's end is not playing's");
    }
    playing.finish().expect("finished");
    let since = Instant::now();
    while screen(pixels).concat() != frame(24) {
        playing.event();
        assert!(since.elapsed() < Duration::from_secs(60), "playing stopped with the preview");
        std::thread::sleep(Duration::from_millis(5));
    }
    let messages = gpu.messages();
    drop((playing, gpu));
    let said = messages.lock().expect("the messages").clone();
    assert!(said.is_empty(), "{said:?}");
}
