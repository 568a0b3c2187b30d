//! Runs a window that plays and a preview in one process, on one thread, with validation. Each shows its own pictures,
//! and neither stops the other.
//!
//! The test starts itself again with the name of a virtual X server, so the environment of this process stays
//! unchanged.

use eyebox::low_level::gpu::{Gpu, Options};
use eyebox::low_level::present::{Desktop, Presenter, RealClock, WindowEvent};
use eyebox::low_level::preview::{Overlay, Picture, PreviewWindow, places};
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// The variable with the path of the server's pixels. Only the process with the windows has it.
const PIXELS: &str = "EYEBOX_TEST_PIXELS";
const SCREEN: [usize; 2] = [60, 80];
const SMALL: [usize; 2] = [20, 30];

fn main() {
    // A test runner may request the list of tests.
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

/// Returns the pixels of the screen row by row, each as red, green and blue.
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
        let mut desktop = playing.desktop().expect("its desktop");
        PreviewWindow::open(&gpu, &mut desktop, "preview", SMALL).expect("a preview")
    };
    // Both windows share one device.
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
    // Like a player, this presents a frame and then handles the events and pictures of the preview.
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
    // The last picture of each window reaches the screen while playing continues. The preview covers the other window.
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
        assert!(since.elapsed() < Duration::from_secs(60), "the windows do not show their last pictures");
        std::thread::sleep(Duration::from_millis(5));
    }
    assert!(!closed);
    // The preview closes, and playing continues.
    drop(preview);
    for k in 21..25 {
        playing.upload(&frame(k)).expect("taken in");
        playing.present(1000 + k, 0).expect("presented");
        assert!(playing.event().is_none(), "the end of the preview ended playing");
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
