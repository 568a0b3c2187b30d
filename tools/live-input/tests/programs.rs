//! Runs the examples in C and Python against the display. They are accepted, refused, killed and started again.
#![cfg(target_os = "linux")]

use eyebox_live_input::{Content, Display, Frame, Kind, Latest, Offer, Pupil, Request, Wanted};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::Duration;

/// The dioptres of near content in the examples, which is 4 pixels of movement across the eyebox of `Runtime::display`.
const NEAR: f32 = 4e-3;

/// A runtime folder that ends with the test.
struct Runtime(PathBuf);

impl Runtime {
    fn new(name: &str) -> Self {
        let path = std::env::temp_dir().join(format!("eyebox-programs-{}-{name}", std::process::id()));
        std::fs::create_dir(&path).unwrap();
        Self(path)
    }

    fn display(&self) -> Display {
        let offer = Offer {
            size: [24, 32],
            colors: [true, true, false],
            kinds: vec![Kind::ColorAndDepth, Kind::Layers],
            views: [1, 1],
            layers: 2,
            slots: 3,
            pixel_angle: 2e-5,
            eyebox_mm: [20.0, 18.0],
        };
        Display::open_in(&self.0.join("eyebox"), "demo", offer).unwrap()
    }

    fn start(&self, program: &Path, words: &[&str]) -> Child {
        let mut command = Command::new(program);
        command.args(words).env("XDG_RUNTIME_DIR", &self.0).env("PYTHONDONTWRITEBYTECODE", "1");
        command.stderr(Stdio::piped()).spawn().unwrap_or_else(|e| panic!("{}: {e}", program.display()))
    }
}

impl Drop for Runtime {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

fn here(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(path)
}

/// Requests a set at each call, and looks for frames until one arrives or the program ends.
fn next(display: &mut Display, frame: &mut Frame, program: &mut Child) -> Latest {
    loop {
        let lit_ns = 500_000_000 + 1_000_000 * i64::try_from(display.counts().frames).unwrap();
        let pupil = Pupil {
            center_mm: [0.0; 2],
            diameter_mm: 4.0,
            focus_dioptres: 0.0,
            velocity_mm_s: [0.0; 2],
            tracked: false,
        };
        let wanted = Wanted { kind: Kind::Layers, views: [1, 1], pitch_mm: 1.0, center_mm: [0.0; 2] };
        display.ask(&Request { number: 0, lit_ns, period_ns: 1_000_000, pupil, wanted });
        let ended = program.try_wait().unwrap().is_some();
        match display.latest(frame) {
            Latest::Late => {}
            Latest::Gone if !ended => {}
            found => return found,
        }
        display.wait(Duration::from_millis(10));
    }
}

fn ended(program: Child) -> (Option<i32>, String) {
    let output = program.wait_with_output().unwrap();
    (output.status.code(), String::from_utf8(output.stderr).unwrap())
}

/// Builds the example in C with the command of its first line and with all warnings.
fn ball(runtime: &Runtime) -> PathBuf {
    let program = runtime.0.join("ball");
    for standard in ["c99", "gnu17"] {
        let mut cc = Command::new("cc");
        cc.args([&format!("-std={standard}"), "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-O1", "-I"]);
        let built = cc.arg(here("")).arg(here("examples/ball.c")).arg("-o").arg(&program).status().unwrap();
        assert!(built.success());
    }
    program
}

#[test]
fn the_ball_in_c() {
    let runtime = Runtime::new("c");
    let program = ball(&runtime);
    let (code, line) = ended(runtime.start(&program, &["demo", "4"]));
    assert_eq!((code, &line[..]), (Some(2), "ball: no display takes frames there: No such file or directory\n"));

    let mut display = runtime.display();
    let mut frame = display.frame();
    let mut running = runtime.start(&program, &["demo", "4"]);
    let mut taken = 0;
    while next(&mut display, &mut frame, &mut running) == Latest::New {
        taken += 1;
        let info = frame.info();
        assert!(info.content == Content::ColorAndDepth && info.request > 0 && info.content_time_ns >= 500_000_000);
        // The ball is bright and near. The background is dark and far, and the picture's last row is there.
        let x = (info.content_time_ns / 1_000_000) as f32 / 2000.0 * 32.0;
        for (i, dioptres) in frame.dioptres().iter().enumerate() {
            let (dx, dy) = ((i % 32) as f32 - x, (i / 32) as f32 - 12.0);
            let (near, light) = if dx * dx + dy * dy < 36.0 { (NEAR, 1.0) } else { (0.0, 0.014_443_844) };
            let same = frame.channel(0)[i] == frame.channel(1)[i] && (frame.channel(0)[i] - light).abs() < 1e-6;
            assert!(*dioptres == near && same, "pixel {i}: {dioptres} D, {}", frame.channel(0)[i]);
        }
    }
    // There are fewer frames if several arrived between two looks.
    assert!((1..=4).contains(&taken) && frame.number() == 4 && display.counts().refused == 0);
    assert_eq!(ended(running), (Some(0), String::new()));

    // The second application is refused. The first is killed in the middle, and a third takes its place.
    let mut first = runtime.start(&program, &["demo"]);
    assert_eq!(next(&mut display, &mut frame, &mut first), Latest::New);
    let mut second = runtime.start(&program, &["demo"]);
    while second.try_wait().unwrap().is_none() {
        next(&mut display, &mut frame, &mut first);
    }
    let refused = "ball: the display refused: it already has an application, and accepts one at a time\n";
    assert_eq!(ended(second), (Some(2), refused.into()));
    first.kill().unwrap();
    first.wait().unwrap();
    while next(&mut display, &mut frame, &mut first) != Latest::Gone {}
    let last = frame.clone();
    assert_eq!(display.latest(&mut frame), Latest::Gone);
    assert_eq!((frame.number(), frame.channel(0)), (last.number(), last.channel(0)));
    let mut third = runtime.start(&program, &["demo", "2"]);
    while next(&mut display, &mut frame, &mut third) == Latest::New {}
    assert_eq!((frame.number(), ended(third)), (2, (Some(0), String::new())));

    // The display ends first.
    let mut left = runtime.start(&program, &["demo"]);
    assert_eq!(next(&mut display, &mut frame, &mut left), Latest::New);
    drop(display);
    assert_eq!(ended(left), (Some(3), "ball: the display is gone\n".into()));
}

#[test]
fn the_stripes_in_python() {
    if Command::new("python3").arg("--version").output().is_err() {
        return eprintln!("no python3, so the example is not run");
    }
    let runtime = Runtime::new("python");
    let program = here("examples/stripes.py");
    let (code, line) = ended(runtime.start(&program, &["demo", "3"]));
    let none = "stripes: no display takes frames there: [Errno 2] No such file or directory\n";
    assert_eq!((code, &line[..]), (Some(1), none));
    assert!(ended(runtime.start(&program, &["../demo"])).1.contains("a name has 1 to 64 letters"));

    let mut display = runtime.display();
    let mut frame = display.frame();
    let mut running = runtime.start(&program, &["demo", "3"]);
    while next(&mut display, &mut frame, &mut running) == Latest::New {
        let Content::Layers(dioptres) = frame.info().content else { panic!("{:?}", frame.info()) };
        assert_eq!(dioptres.as_slice(), [0.0, NEAR]);
        let shift = frame.info().content_time_ns * 20 / 1_000_000_000;
        let opacity = frame.channel(2);
        assert!(opacity[..24 * 32].iter().all(|v| *v == 1.0));
        for (i, near) in opacity[24 * 32..].iter().enumerate() {
            let bright = (i as i64 % 32 + shift) / 8 % 2 == 1;
            assert_eq!((*near, frame.channel(1)[24 * 32 + i]), if bright { (1.0, 1.0) } else { (0.0, 0.0) });
        }
    }
    assert_eq!((frame.number(), display.counts().refused), (3, 0));
    assert_eq!(ended(running), (Some(0), String::new()));
    let mut left = runtime.start(&program, &["demo"]);
    assert_eq!(next(&mut display, &mut frame, &mut left), Latest::New);
    let second = runtime.start(&program, &["demo"]);
    let refused = std::thread::spawn(move || ended(second));
    while !refused.is_finished() {
        next(&mut display, &mut frame, &mut left);
    }
    let line = "stripes: the display refused: it already has an application, and accepts one at a time\n";
    assert_eq!(refused.join().unwrap(), (Some(1), line.into()));
    drop(display);
    assert_eq!(ended(left), (Some(1), "stripes: the display is gone\n".into()));
}

/// A wait lasts as long as requested, even if the other side often sends bytes without news.
#[test]
fn waits_end_in_their_time_in_c() {
    let runtime = Runtime::new("waits");
    let program = runtime.0.join("waits");
    let mut cc = Command::new("cc");
    cc.args(["-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-O1", "-I"]);
    let built = cc.arg(here("")).arg(here("tests/waits.c")).arg("-o").arg(&program).status().unwrap();
    assert!(built.success());
    assert_eq!(ended(runtime.start(&program, &[])), (Some(0), String::new()));
}

#[test]
fn waits_end_in_their_time_in_python() {
    if Command::new("python3").arg("--version").output().is_err() {
        return eprintln!("no python3, so the waits are not run");
    }
    let code = r#"
import mmap, socket, sys, threading, time
sys.path.insert(0, sys.argv[1])
import eyebox_live
live = object.__new__(eyebox_live.Live)
live.socket, other = socket.socketpair()
live.socket.setblocking(False)
other.setblocking(False)
live._map, live._seen = mmap.mmap(-1, 8192), 0
done = threading.Event()
def look():
    while not done.wait(0.01):
        try:
            other.send(b"\0")
        except BlockingIOError:
            pass
thread = threading.Thread(target=look)
thread.start()
for seconds in (0.3, 0.1, 0.0):
    begun = time.monotonic()
    assert live.wait(seconds) is None
    assert time.monotonic() - begun >= seconds, "it ended before its time"
done.set()
thread.join()
"#;
    let mut python = Command::new("python3");
    let output = python.args(["-c", code]).arg(here("")).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}
