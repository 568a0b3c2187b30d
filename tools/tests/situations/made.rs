//! Makes the scenes of the situations and writes them.

use crate::judge::{Canon, Judge};
use eyebox::low_level::files::write_npy;
use image::{Rgb, RgbImage};
use std::fs;
use std::path::Path;
use std::sync::LazyLock;

/// Rows and columns of views.
pub const GRID: [usize; 2] = [3, 5];
/// Rows and columns of the pixels of a view.
pub const SIZE: [usize; 2] = [48, 64];

/// Movement of the wall and of the disc from view to view [pixels].
const DISPARITY: [f32; 2] = [-0.7, 0.9];

/// Returns one color of the texture of a surface.
fn texture(layer: usize, color: usize, x: f32, y: f32) -> f32 {
    let wave = |k: usize| {
        let k = (k + 7 * layer + 3 * color) as f32;
        let (turn, length) = (k * 2.4 + 0.3, 5.0 + (k * 3.7) % 9.0);
        ((x * turn.cos() + y * turn.sin()) * std::f32::consts::TAU / length + k * k).sin()
    };
    let sum: f32 = (0..9).map(wave).sum();
    (0.3 + 0.15 * color as f32 + 0.11 * sum).clamp(0.02, 0.98)
}

/// Returns the view of a disc and a bar in front of a wall, from `down` rows and `right` columns off the middle. It has
/// 8 bits by the sRGB curve.
pub fn view([down, right]: [f32; 2]) -> RgbImage {
    let [h, w] = SIZE.map(|n| n as f32);
    RgbImage::from_fn(SIZE[1] as u32, SIZE[0] as u32, |x, y| {
        let at = |layer: usize| (x as f32 + DISPARITY[layer] * right, y as f32 + DISPARITY[layer] * down);
        let ((u, v), (far_x, far_y)) = (at(1), at(0));
        let disc = 0.26 * h - (u - 0.36 * w).hypot(v - 0.45 * h);
        let bar = (0.13 * w - (u - 0.74 * w).abs()).min(0.15 * h - (v - 0.68 * h).abs());
        let share = (disc.max(bar) + 0.5).clamp(0.0, 1.0);
        let value = |c| share * texture(1, c, u, v) + (1.0 - share) * texture(0, c, far_x, far_y);
        Rgb([0, 1, 2].map(|c| (255.0 * value(c)).round() as u8))
    })
}

/// Returns the view in a row and column of a grid.
pub fn view_of([rows, columns]: [usize; 2], row: usize, column: usize) -> RgbImage {
    let off = |i: usize, n: usize| i as f32 - (n as f32 - 1.0) / 2.0;
    view([off(row, rows), off(column, columns)])
}

/// Returns all views of the usual grid, row by row. They are rendered once.
pub fn all() -> Vec<RgbImage> {
    static ALL: LazyLock<Vec<RgbImage>> =
        LazyLock::new(|| (0..GRID[0] * GRID[1]).map(|i| view_of(GRID, i / GRID[1], i % GRID[1])).collect());
    ALL.clone()
}

/// Saves the views of the usual grid in `folder` under names of their row and column.
pub fn save(folder: &Path, name: impl Fn(usize, usize) -> String) {
    for (i, view) in all().into_iter().enumerate() {
        let file = folder.join(name(i / GRID[1], i % GRID[1]));
        fs::create_dir_all(file.parent().expect("a folder")).expect("a folder");
        view.save(file).expect("a picture");
    }
}

/// Returns the linear light of an sRGB value of 8 bits.
pub fn light(value: u8) -> f32 {
    let v = f64::from(value) / 255.0;
    (if v <= 0.04045 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) }) as f32
}

/// Writes the views of a grid as one array, and returns the words for it. `value` converts a value of 8 bits to light.
pub fn array(at: &Path, [rows, columns]: [usize; 2], views: &[RgbImage], value: impl Fn(u8) -> f32) -> String {
    let values: Vec<f32> = views.iter().flat_map(|view| view.as_raw()).map(|v| value(*v)).collect();
    write_npy(&at.join("v.npy"), &[rows, columns, SIZE[0], SIZE[1], 3], &values).expect("an array");
    "v.npy --order as-named --depth=-1..1".into()
}

fn one(row: usize, column: usize) -> RgbImage {
    all().swap_remove(row * GRID[1] + column)
}

/// Writes the usual views in another order. `from` returns the view for a row and column.
fn places(at: &Path, from: impl Fn(usize, usize) -> RgbImage) -> String {
    let views: Vec<_> = (0..GRID[0] * GRID[1]).map(|i| from(i / GRID[1], i % GRID[1])).collect();
    array(at, GRID, &views, light)
}

fn right(at: &Path) -> String {
    array(at, GRID, &all(), light)
}

/// Allows no error of the format, because all lossless formats of 8 bits have the same numbers.
pub const EXACT: Judge = Judge::Like(&VIEWS, 2e-6);

/// The views of the usual grid, and every possible misreading of them.
pub static VIEWS: Canon = Canon::new(
    right,
    &[
        ("rows reversed", |at| places(at, |r, c| one(GRID[0] - 1 - r, c))),
        ("columns reversed", |at| places(at, |r, c| one(r, GRID[1] - 1 - c))),
        ("inside out", |at| places(at, |r, c| one(GRID[0] - 1 - r, GRID[1] - 1 - c))),
        ("every second row backwards", |at| places(at, |r, c| one(r, if r % 2 == 0 { GRID[1] - 1 - c } else { c }))),
        ("columns first", |at| places(at, |r, c| one((r * GRID[1] + c) % GRID[0], (r * GRID[1] + c) / GRID[0]))),
        ("mirrored", |at| places(at, |r, c| image::imageops::flip_horizontal(&one(r, c)))),
        ("upside down", |at| places(at, |r, c| image::imageops::flip_vertical(&one(r, c)))),
        ("with red and blue exchanged", |at| {
            places(at, |r, c| {
                let mut view = one(r, c);
                view.pixels_mut().for_each(|p| p.0.reverse());
                view
            })
        }),
        ("without the sRGB curve", |at| array(at, GRID, &all(), |v| f32::from(v) / 255.0)),
    ],
);
