//! A virtual screen, and the command that shows holograms on it.

use super::made;
use super::xvfb::Server;
use eyebox::low_level::hologram::Hologram;
use eyebox::low_level::optics::Display;
use std::path::Path;
use std::process::{Command, Stdio};

/// Virtual screen with `size` rows and columns.
pub struct Screen {
    pub server: Server,
    size: [usize; 2],
}

impl Screen {
    pub fn new(folder: &Path, size: [usize; 2]) -> Self {
        Self { server: Server::start(folder, size, &["-noreset"]), size }
    }

    /// Returns the name of the screen in the form of `DISPLAY`.
    pub fn name(&self) -> &str {
        &self.server.name
    }

    /// Returns the pixels of the whole screen as (row, column, channel), red first.
    pub fn picture(&self) -> Vec<u8> {
        self.server.part([0, 0], self.size).rgb
    }
}

/// Makes a hologram of 36 x 64 pixels for a display and saves it as `x.zarr`.
pub fn hologram(folder: &Path, display: &Display) -> Hologram {
    let hologram = made::hologram(display, 8, 0);
    hologram.save(&folder.join("x.zarr")).expect("saved");
    hologram
}

/// Returns the command that shows `x.zarr` in a window on the screen, or in the `--output` that `more` has.
pub fn play(folder: &Path, screen: &Screen, preset: &str, more: &[&str]) -> Command {
    let mut command = Command::new(super::program());
    command
        .args(["show", "x.zarr", "--display", preset, "--size", "36x64"])
        .args(if more.contains(&"--output") { &[][..] } else { &["--output", "window"] })
        .args(more)
        .current_dir(folder)
        .env("EYEBOX_JSON_ERRORS", "1")
        .env("DISPLAY", screen.name())
        .env_remove("WAYLAND_DISPLAY")
        .env("XDG_CACHE_HOME", folder.join("cache"))
        .stdout(Stdio::piped())
        .stderr(Stdio::piped());
    command
}
