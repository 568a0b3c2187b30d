//! A virtual X server that keeps its pixels in a file.

use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

/// Running server, which ends when the value is dropped.
pub struct Server {
    pub process: Child,
    /// Name of the display in the form of `DISPLAY`.
    pub name: String,
    pixels: PathBuf,
}

/// Part of the screen with its rows and columns. The values are (row, column, channel), red first.
#[derive(Debug, Clone, PartialEq)]
pub struct Part {
    pub size: [usize; 2],
    pub rgb: Vec<u8>,
}

impl Server {
    /// Starts a server with one screen of `height` rows and `width` columns.
    pub fn start(folder: &Path, [height, width]: [usize; 2], more: &[&str]) -> Self {
        let mut process = Command::new("Xvfb")
            .args(["-displayfd", "1", "-screen", "0", &format!("{width}x{height}x24"), "-nolisten", "tcp", "-fbdir"])
            .arg(folder)
            .args(more)
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .expect("Xvfb, which tools/setup.sh installs");
        let mut number = String::new();
        BufReader::new(process.stdout.take().expect("its output")).read_line(&mut number).expect("its number");
        Self { process, name: format!(":{}", number.trim()), pixels: folder.join("Xvfb_screen0") }
    }

    /// Returns the part of the screen that begins at a row and a column. The screen's edge can make it smaller than
    /// `size`.
    pub fn part(&self, [top, left]: [usize; 2], size: [usize; 2]) -> Part {
        let bytes = std::fs::read(&self.pixels).expect("the frame buffer");
        let word = |i: usize| u32::from_be_bytes(bytes[4 * i..4 * i + 4].try_into().expect("a word")) as usize;
        let (header, width, height, line, colors) = (word(0), word(4), word(5), word(12), word(19));
        assert_eq!((word(7), word(11)), (0, 32), "little-endian, 32 bits");
        let size = [size[0].min(height - top), size[1].min(width - left)];
        let rows = bytes[header + 12 * colors..].chunks_exact(line).skip(top).take(size[0]);
        let pixels = |row: &'_ [u8]| -> Vec<u8> {
            row.chunks_exact(4).skip(left).take(size[1]).flat_map(|p| [p[2], p[1], p[0]]).collect()
        };
        Part { size, rgb: rows.flat_map(pixels).collect() }
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}
