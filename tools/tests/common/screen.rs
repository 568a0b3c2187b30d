//! A virtual X server, and a hologram to show on it.

#![allow(dead_code, reason = "each test file uses what it needs")]

use eyebox::hologram::{ColorHologram, Hologram};
use eyebox::optics::Display;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

/// A virtual screen whose pixels lie in a file; gone with the value.
pub struct Screen {
    pub server: Child,
    /// As DISPLAY has it.
    pub name: String,
    pixels: PathBuf,
}

impl Screen {
    /// Of so many rows and columns.
    pub fn new(folder: &Path, [height, width]: [usize; 2]) -> Self {
        let mut server = Command::new("Xvfb")
            .args([
                "-displayfd",
                "1",
                "-screen",
                "0",
                &format!("{width}x{height}x24"),
                "-nolisten",
                "tcp",
                "-noreset",
                "-fbdir",
            ])
            .arg(folder)
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .expect("Xvfb, which tools/setup.sh installs");
        let mut number = String::new();
        BufReader::new(server.stdout.take().expect("its output")).read_line(&mut number).expect("its number");
        Self { server, name: format!(":{}", number.trim()), pixels: folder.join("Xvfb_screen0") }
    }

    /// (row, column, channel), red first.
    pub fn picture(&self) -> Vec<u8> {
        let bytes = std::fs::read(&self.pixels).expect("the frame buffer");
        let word = |i: usize| u32::from_be_bytes(bytes[4 * i..4 * i + 4].try_into().expect("a word")) as usize;
        let (header, width, height, line, colors) = (word(0), word(4), word(5), word(12), word(19));
        assert_eq!((word(7), word(11)), (0, 32), "little-endian, 32 bits");
        let rows = bytes[header + 12 * colors..].chunks_exact(line).take(height);
        rows.flat_map(|row| row.chunks_exact(4).take(width).flat_map(|p| [p[2], p[1], p[0]])).collect()
    }
}

impl Drop for Screen {
    fn drop(&mut self) {
        let _ = self.server.kill();
        let _ = self.server.wait();
    }
}

/// A hologram of 36 x 64 for a display, as x.zarr.
pub fn hologram(folder: &Path, display: &Display) -> Hologram {
    let color = |(i, w): (usize, &eyebox::optics::Wavelength)| ColorHologram {
        color: Some(w.color),
        wavelength: w.wavelength,
        exposure: 0.4,
        efficiency: 0.4,
        phases: (0..8 * 36 * 64).map(|k| ((k * 7919 + i * 31) % 6283) as f32 * 1e-3 - 3.0).collect(),
    };
    let hologram = Hologram {
        frames: 8,
        height: 36,
        width: 64,
        pitch: display.pitch,
        focal_length: display.focal_length,
        geometry: display.geometry,
        colors: display.wavelengths.iter().enumerate().map(color).collect(),
        seed: 0,
        version: String::new(),
        display: display.name.clone(),
        display_wavelengths: display.wavelengths.clone(),
        scene: String::new(),
        settings: serde_json::Value::Null,
    };
    hologram.save(&folder.join("x.zarr")).expect("saved");
    hologram
}

/// Plays it in a window on the screen.
pub fn play(folder: &Path, screen: &Screen, preset: &str, more: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_eyebox"));
    command
        .args(["play", "x.zarr", "--display", preset, "--size", "36x64", "--output", "window"])
        .args(more)
        .current_dir(folder)
        .env("DISPLAY", &screen.name)
        .env_remove("WAYLAND_DISPLAY")
        .env("XDG_CACHE_HOME", folder.join("cache"))
        .stdout(Stdio::piped())
        .stderr(Stdio::piped());
    command
}
