//! Windows on Wayland, under Weston without a display. Without Weston, these tests print a line and pass.

use crate::common::{command, document, folder, made, text};
use eyebox::low_level::optics::Display;
use std::os::unix::fs::PermissionsExt as _;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// Running compositor with an output, which ends when the value is dropped.
struct Weston {
    process: Child,
    runtime: PathBuf,
}

impl Weston {
    /// Starts a compositor whose output has these rows and columns. Returns nothing if there is no Weston.
    fn start(at: &Path, [rows, columns]: [usize; 2]) -> Option<Self> {
        let runtime = at.join("run");
        std::fs::create_dir(&runtime).expect("a folder");
        std::fs::set_permissions(&runtime, std::fs::Permissions::from_mode(0o700)).expect("a mode");
        let started = Command::new("weston")
            .args(["--backend=headless-backend.so", "--use-pixman", "--debug", "--no-config", "--idle-time=0"])
            .args(["--socket=eyebox", &format!("--width={columns}"), &format!("--height={rows}")])
            .env("XDG_RUNTIME_DIR", &runtime)
            .env_remove("WAYLAND_DISPLAY")
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn();
        let Ok(process) = started else {
            eprintln!("skipped: weston is missing, which tools/setup.sh installs");
            return None;
        };
        let weston = Self { process, runtime };
        let since = Instant::now();
        while !weston.runtime.join("eyebox").exists() {
            assert!(since.elapsed() < Duration::from_secs(60), "weston did not start");
            std::thread::sleep(Duration::from_millis(20));
        }
        Some(weston)
    }

    /// Returns a command of eyebox on this compositor.
    fn command(&self, at: &Path, args: &[&str]) -> Command {
        let mut command = command(at, args);
        command.env("XDG_RUNTIME_DIR", &self.runtime).env("WAYLAND_DISPLAY", "eyebox").env_remove("DISPLAY");
        command
    }
}

impl Drop for Weston {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

#[test]
fn a_hologram_is_shown_and_the_link_is_unknown() {
    let temp = folder();
    let at = temp.path();
    let Some(weston) = Weston::start(at, [36, 64]) else { return };
    let display = Display { height: 36, width: 64, ..Display::preset("planes24").expect("a preset") };
    made::hologram(&display, 8, 0).save(&at.join("x.zarr")).expect("saved");
    let show = ["show", "x.zarr", "--display", "planes24", "--size", "36x64", "--output", "window", "--duration", "1"];
    let more = ["--validation", "--stats", "stats.json", "--loop"];
    let answer = weston.command(at, &[&show[..], &more].concat()).output().expect("it runs");
    let said = text(&answer.stderr);
    assert_eq!(answer.status.code(), Some(0), "{said}");
    assert!(said.contains("Wayland") && !said.contains("validation:"), "{said}");
    let stats = document(&at.join("stats.json"));
    assert_eq!(stats["ended_by"], "the duration");
    assert!(stats["content_shown"].as_u64() > Some(0) && stats["sets"].as_u64() > Some(0), "{stats}");
    assert_eq!((&stats["link"]["system"], &stats["link"]["output"]), (&"wayland".into(), &"headless".into()));
    let checks = stats["link"]["checks"].as_array().expect("checks");
    assert!(checks.iter().all(|check| check["state"] == "unknown") && checks.len() > 5, "{stats}");
    assert_eq!(stats["interference"], serde_json::json!([]));
}
