//! Situations with all views of a scene in one picture.

use crate::frame::{Case, Chapter, Remedy, Situation, case, change, mended};
use crate::judge::Canon;
use crate::judge::Judge;
use crate::made::{EXACT, GRID, SIZE, VIEWS, all, array, light, view};
use crate::write::{exr_of, file, jpeg, png};
use image::{ImageBuffer, RgbImage, imageops};
use std::path::Path;
use std::sync::LazyLock;

const H: u32 = SIZE[0] as u32;
const W: u32 = SIZE[1] as u32;

/// Returns a picture of views next to each other, with `apart` pixels between them.
fn mosaic(views: &[RgbImage], columns: u32, apart: u32) -> RgbImage {
    let rows = views.len() as u32 / columns;
    let mut out = RgbImage::new(columns * (W + apart) - apart, rows * (H + apart) - apart);
    for (i, view) in (0..).zip(views) {
        imageops::replace(&mut out, view, (i % columns * (W + apart)).into(), (i / columns * (H + apart)).into());
    }
    out
}

fn usual() -> RgbImage {
    mosaic(&all(), GRID[1] as u32, 0)
}

/// Returns a picture with one pixel of each view under each lens.
fn lenslets() -> RgbImage {
    let (views, [rows, columns]) = (all(), GRID.map(|n| n as u32));
    RgbImage::from_fn(W * columns, H * rows, |x, y| {
        *views[(y % rows * columns + x % columns) as usize].get_pixel(x / columns, y / rows)
    })
}

/// Returns the views of one row of 15 cameras. Content moves less between neighboring views than in the usual grid.
pub fn row() -> Vec<RgbImage> {
    static ROW: LazyLock<Vec<RgbImage>> =
        LazyLock::new(|| (0..15).map(|i| view([0.0, (i as f32 - 7.0) / 3.0])).collect());
    ROW.clone()
}

fn row_of(at: &Path, views: &[RgbImage]) -> String {
    array(at, [1, 15], views, light)
}

static ROW: Canon = Canon::new(
    |at| row_of(at, &row()),
    &[
        ("the row backwards", |at| {
            let mut views = row();
            views.reverse();
            row_of(at, &views)
        }),
        ("the tiles from the top", |at| {
            let views: Vec<_> = [2, 1, 0].iter().flat_map(|r| row()[5 * r..5 * r + 5].to_vec()).collect();
            row_of(at, &views)
        }),
        ("a grid", |at| {
            let views: Vec<_> = [2, 1, 0].iter().flat_map(|r| row()[5 * r..5 * r + 5].to_vec()).collect();
            array(at, [3, 5], &views, light)
        }),
        ("every second row of tiles backwards", |at| {
            let mut views = row();
            views[..5].reverse();
            views[10..].reverse();
            row_of(at, &views)
        }),
    ],
);

/// Returns the views of the row as tiles, from the bottom left.
fn quilt() -> RgbImage {
    let views: Vec<_> = [2, 1, 0].iter().flat_map(|r| row()[5 * r..5 * r + 5].to_vec()).collect();
    mosaic(&views, 5, 0)
}

pub const OF_ROW: Judge = Judge::Like(&ROW, 2e-6);

fn one(
    have: &str,
    words: &'static str,
    name: &'static str,
    bytes: impl Fn() -> Vec<u8> + Send + Sync + 'static,
) -> Case {
    case(have, format!("render {words}"), move |at| file(&at.join(name), bytes()))
}

pub fn chapter() -> Chapter {
    let mut situations = vec![
        one("Views are next to each other in one picture, row by row.", "all.png?grid=3x5", "all.png", || png(usual()))
            .right(EXACT),
        one("Views are next to each other, and eyebox finds their number.", "all.png?mosaic", "all.png", || {
            png(usual())
        })
        .right(EXACT),
        one("Views are next to each other in an EXR file.", "all.exr?mosaic", "all.exr", || exr_of(&usual(), light))
            .right(EXACT),
        one("Views are next to each other in a JPEG file.", "all.jpg?grid=3x5", "all.jpg", || jpeg(&usual(), 1))
            .right(Judge::Like(&VIEWS, 0.015)),
        one("Views are next to each other in a PNG file of 16 bits.", "all.png?mosaic", "all.png", || {
            let picture = usual();
            png(ImageBuffer::from_fn(picture.width(), picture.height(), |x, y| {
                image::Rgb(picture.get_pixel(x, y).0.map(|v| u16::from(v) * 257))
            }))
        })
        .right(EXACT),
        one(
            "A rectified light-field picture has a pixel of each view under each lens.",
            "lf_eslf.png?lenslets&grid=3x5",
            "lf_eslf.png",
            || png(lenslets()),
        )
        .right(EXACT),
        one(
            "A rectified light-field picture does not state the number of pixels per lens.",
            "lf.png?lenslets",
            "lf.png",
            || png(lenslets()),
        )
        .right(EXACT),
        one(
            "A quilt of a Looking Glass display has a name in the form of its makers.",
            "scene_qs5x3a1.3333.png",
            "scene_qs5x3a1.3333.png",
            || png(quilt()),
        )
        .right(OF_ROW),
    ];
    situations.extend(refused());
    Chapter {
        title: "Pictures of many views",
        about: "The same views in one picture. A quilt is one row of 15 cameras in 3 rows of tiles.",
        situations,
    }
}

fn refused() -> Vec<Situation> {
    vec![
        one("Views are next to each other, and the command does not state it.", "all.png", "all.png", || png(usual()))
            .refused("scene/no-depth-map", Remedy::Replace("all.png", "all.png?mosaic"), EXACT),
        one("The command has rows and columns exchanged.", "all.png?grid=5x3", "all.png", || png(usual())).refused(
            "scene/corrupt/mosaic-remedy 144 320",
            Remedy::As("grid", "grid=5x3", "grid=3x5"),
            EXACT,
        ),
        one("Views have two pixels of border between them.", "all.png?grid=3x5", "all.png", || {
            png(mosaic(&all(), 5, 2))
        })
        .refused(
            "scene/corrupt/mosaic-remedy 148 328",
            mended("cut off its border", |at| file(&at.join("all.png"), png(usual()))),
            EXACT,
        ),
        one("The picture of all views was scaled to another size.", "all.png?mosaic", "all.png", || {
            png(imageops::resize(&usual(), 322, 144, imageops::FilterType::Triangle))
        })
        .refused(
            "scene/corrupt/mosaic-size 144 322",
            change("144 320", |at| file(&at.join("all.png"), png(usual()))),
            EXACT,
        ),
        one(
            "The picture of all views was scaled so that their rows differ more than usual.",
            "all.png?mosaic",
            "all.png",
            || png(imageops::resize(&usual(), 322, 145, imageops::FilterType::Nearest)),
        )
        .refused(
            "scene/not-a-grid/mosaic-two-grids",
            change("?grid=3x5", |at| file(&at.join("all.png"), png(usual()))),
            EXACT,
        ),
        one("A quilt has a name without its layout.", "quilt.png?mosaic", "quilt.png", || png(quilt())).refused(
            "scene/cameras 15",
            Remedy::State("lightfield.toml", "tiles = [3, 5]\nfirst = \"bottom-left\""),
            OF_ROW,
        ),
        one("The columns of views run from right to left.", "all.png?grid=3x5", "all.png", || {
            let views: Vec<_> = all().chunks(5).flat_map(|row| row.iter().rev().cloned().collect::<Vec<_>>()).collect();
            png(mosaic(&views, 5, 0))
        })
        .refused("scene/order/moves-otherwise", Remedy::Add("--order flip-columns"), EXACT),
        one("The command misspells an option of the picture.", "all.png?mosiac", "all.png", || png(usual())).refused(
            "scene/options/option",
            Remedy::As("mosaic", "mosiac", "mosaic"),
            EXACT,
        ),
    ]
}
