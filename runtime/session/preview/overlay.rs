//! Draws lines of text and a small map over a picture.

use super::font::{HEIGHT, WIDTH, ink};
use super::picture::Picture;

/// The text and the map over a picture.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Overlay {
    /// Lines of help in the middle of the picture.
    pub help: Vec<String>,
    /// The status line at the bottom.
    pub line: Option<String>,
    /// The center of the pupil (x, y) from the axis and its diameter, as shares of the side of the eyebox. The map is
    /// in the upper right corner.
    pub map: Option<[f64; 3]>,
}

const INK: [u8; 3] = [255, 255, 255];
/// The rows from line to line and the columns from letter to letter.
const PITCH: [usize; 2] = [HEIGHT + 3, WIDTH + 1];
/// The margin around a block of text (dots).
const MARGIN: usize = 3;

/// Draws an overlay. Its letters are as large as the picture allows, with at most three pixels per dot.
pub fn draw_overlay(picture: &mut Picture, overlay: &Overlay) {
    let [rows, columns] = picture.size;
    let scale_of = |lines: &[&str]| {
        let [high, wide] = extent(lines);
        (rows / high).min(columns / wide).clamp(1, 3)
    };
    if let Some(map) = overlay.map {
        draw_map(picture, map);
    }
    if let Some(line) = &overlay.line {
        let scale = scale_of(&[line]).min(2);
        // In a narrow window the line breaks between its parts.
        let room = (columns / scale).saturating_sub(2 * MARGIN) / PITCH[1];
        let lines = broken(line, room);
        let high = extent(&lines)[0] * scale;
        block(picture, rows.saturating_sub(high), 0, &lines, scale);
    }
    if !overlay.help.is_empty() {
        let lines: Vec<&str> = overlay.help.iter().map(String::as_str).collect();
        let scale = scale_of(&lines);
        let [high, wide] = extent(&lines).map(|n| n * scale);
        let (top, left) = (rows.saturating_sub(high) / 2, columns.saturating_sub(wide) / 2);
        block(picture, top, left, &lines, scale);
    }
}

/// Splits a line at its commas, so that no piece is longer than `room` letters if possible.
fn broken(line: &str, room: usize) -> Vec<&str> {
    let (mut lines, mut start, mut end) = (Vec::new(), 0, 0);
    for (at, _) in line.match_indices(", ").chain([(line.len(), "")]) {
        if end > start && line[start..at].chars().count() > room {
            lines.push(&line[start..end]);
            start = (end + 2).min(at);
        }
        end = at;
    }
    lines.push(&line[start..]);
    lines
}

fn extent(lines: &[&str]) -> [usize; 2] {
    let widest = lines.iter().map(|l| l.chars().count()).max().unwrap_or(0);
    [lines.len() * PITCH[0] + 2 * MARGIN, widest * PITCH[1] + 2 * MARGIN]
}

/// Draws lines on a darkened background.
fn block(picture: &mut Picture, top: usize, left: usize, lines: &[&str], scale: usize) {
    let [high, wide] = extent(lines);
    for row in top..top + high * scale {
        for column in left..left + wide * scale {
            change(picture, row, column, |v, _| v / 5);
        }
    }
    for (i, line) in lines.iter().enumerate() {
        for (j, letter) in line.chars().enumerate() {
            let (y, x) = (MARGIN + 1 + i * PITCH[0], MARGIN + j * PITCH[1]);
            for dot in (0..HEIGHT * WIDTH).filter(|dot| ink(letter, dot / WIDTH, dot % WIDTH)) {
                let (y, x) = (top + (y + dot / WIDTH) * scale, left + (x + dot % WIDTH) * scale);
                for k in 0..scale * scale {
                    change(picture, y + k / scale, x + k % scale, |_, channel| INK[channel]);
                }
            }
        }
    }
}

/// Draws the eyebox as a square, and the pupil in it.
fn draw_map(picture: &mut Picture, [x, y, diameter]: [f64; 3]) {
    let [rows, columns] = picture.size;
    let side = (rows.min(columns) / 5).clamp(24, 160);
    let (top, left) = (MARGIN, columns.saturating_sub(side + MARGIN));
    for row in 0..side {
        for column in 0..side {
            let along = |i: usize| (i as f64 + 0.5) / side as f64 - 0.5;
            let (dx, dy) = (along(column) - x, along(row) - y);
            let edge = row == 0 || column == 0 || row + 1 == side || column + 1 == side;
            // The edge of the pupil is drawn as a ring.
            let ring = (dx.hypot(dy) - diameter / 2.0).abs() < 0.75 / side as f64;
            let inside = dx.hypot(dy) < diameter / 2.0;
            change(picture, top + row, left + column, |v, channel| match (edge || ring, inside) {
                (true, _) => INK[channel],
                (false, true) => v / 2 + 96,
                (false, false) => v / 3,
            });
        }
    }
}

/// Changes a pixel if it is inside the picture.
fn change(picture: &mut Picture, row: usize, column: usize, to: impl Fn(u8, usize) -> u8) {
    if row >= picture.size[0] || column >= picture.size[1] {
        return;
    }
    let at = 3 * (row * picture.size[1] + column);
    for channel in 0..3 {
        picture.rgb[at + channel] = to(picture.rgb[at + channel], channel);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grey(size: [usize; 2]) -> Picture {
        Picture { size, rgb: vec![100; 3 * size[0] * size[1]] }
    }

    #[test]
    fn nothing_changes_nothing_and_nothing_leaves_the_picture() {
        let mut picture = grey([20, 30]);
        draw_overlay(&mut picture, &Overlay::default());
        assert_eq!(picture, grey([20, 30]));
        let all = Overlay {
            help: vec!["a long line of help".into(); 9],
            line: Some("x, y, z".into()),
            map: Some([0.5, -0.5, 2.0]),
        };
        for size in [[0, 0], [1, 1], [3, 200], [200, 3], [400, 600]] {
            draw_overlay(&mut grey(size), &all);
        }
    }

    #[test]
    fn words_can_be_read_where_they_stand() {
        let mut picture = grey([60, 100]);
        draw_overlay(&mut picture, &Overlay { line: Some("F".into()), ..Overlay::default() });
        // A dot has two pixels. The block is as high as its line and is at the bottom.
        let at = |row: usize, column: usize| picture.rgb[3 * (row * 100 + column)];
        let top = 60 - 2 * (PITCH[0] + 2 * MARGIN);
        assert_eq!((at(top - 1, 0), at(top, 0)), (100, 20));
        let dot = |row: usize, column: usize| at(top + 2 * (MARGIN + 1 + row), 2 * (MARGIN + column)) == 255;
        for row in 0..HEIGHT {
            for column in 0..WIDTH {
                assert_eq!(dot(row, column), ink('F', row, column), "{row} {column}");
            }
        }
    }

    #[test]
    fn long_lines_break_between_their_parts() {
        assert_eq!(broken("one, two, three", 100), ["one, two, three"]);
        assert_eq!(broken("one, two, three", 8), ["one, two", "three"]);
        assert_eq!(broken("one, two, three", 1), ["one", "two", "three"]);
        assert_eq!(broken("", 0), [""]);
    }

    #[test]
    fn the_map_shows_the_pupil_in_the_eyebox() {
        let mut picture = grey([200, 300]);
        draw_overlay(&mut picture, &Overlay { map: Some([0.25, -0.25, 0.2]), ..Overlay::default() });
        let at = |row: usize, column: usize| picture.rgb[3 * (row * 300 + column)];
        let (top, left) = (MARGIN, 300 - 40 - MARGIN);
        // The frame, the inside of the pupil up and to the right, and the dark area elsewhere.
        assert_eq!((at(top, left), at(top + 10, left + 30), at(top + 30, left + 10)), (255, 146, 33));
    }
}
