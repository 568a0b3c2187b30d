//! Makes the built-in scene of splats from the still life, and checks that the stored file shows the still life.
//!
//! `EYEBOX_WRITE=1` writes the file. Each splat is a disc on a surface that some view sees, with one disc per sample of
//! a grid. Its color is then corrected by the difference of the views, because neighboring splats blur each other.

use super::render::{Canvas, Item};
use super::shape::Blade;
use super::still_life::{Mood, items};
use crate::splats::cloud::Cloud;
use crate::splats::format::{Format, read};
use crate::splats::harmonics::C0;
use crate::splats::picture::draw;
use crate::splats::project::{Displaced, Ordered};
use crate::splats::{camera::Camera, format::BUILTIN, options::Options};
use eyebox_base::files::linear_to_srgb;
use eyebox_optics::Color;
use std::io::Write;
use std::path::Path;

/// Samples of the grid along an axis.
const GRID: usize = 120;
/// Pixels of the pictures in which colors are corrected.
const SIZE: usize = 240;
/// Largest tilt of the views, in scene units per unit of depth.
const TILT: f32 = 0.08;
/// Inverse distance of the plane without parallax, and its change per unit of depth, per unit of the splats.
const DISTANCE: [f32; 2] = [1.0, 0.2];
/// Fractional bits of the positions.
const BITS: u8 = 14;
/// Deviation of a disc in samples of the grid.
const WIDTH: f32 = 0.5;
/// Corrections of the colors.
const ROUNDS: usize = 12;

/// A disc with its place in the middle view.
struct Disc {
    x: f32,
    y: f32,
    depth: f32,
    /// Half its width and half its height, in scene units.
    half: [f32; 2],
    /// Red, green and blue in sRGB.
    color: [f32; 3],
    /// Index of its item.
    item: usize,
}

/// Returns a light in sRGB, up to 1.
fn coded(light: f32) -> f32 {
    linear_to_srgb(f64::from(light.clamp(0.0, 1.0))) as f32
}

fn tangent() -> f32 {
    20f32.to_radians().tan()
}

/// Returns the depth, the light and the coverage of an item at a place of a view.
fn at(item: &Item, x: f32, y: f32, tilt: [f32; 2], pixel: f32) -> Option<(f32, [f32; 3], f32)> {
    match item {
        Item::Surface { shape, area, texture } => {
            let hit = shape.meet(x, y, tilt, pixel)?;
            let inside = (area[0]..area[2]).contains(&hit.x) && (area[1]..area[3]).contains(&hit.y);
            let paint = if inside { texture(hit.x, hit.y) } else { [0.0; 4] };
            // A ray that is tilted a little farther shows the depth.
            let more = 2e-3;
            let beside = shape.meet(x, y, [tilt[0] + more, tilt[1]], pixel)?;
            let depth = (beside.x - hit.x) / more;
            Some((depth, [paint[0], paint[1], paint[2]], paint[3] * hit.coverage))
        }
        Item::Blade(blade) => on_blade(blade, x, y, tilt, pixel),
    }
}

fn on_blade(blade: &Blade, x: f32, y: f32, tilt: [f32; 2], pixel: f32) -> Option<(f32, [f32; 3], f32)> {
    let row = blade.row(y, tilt)?;
    let coverage = ((row.half - (x - row.x).abs()) / pixel + 0.5).clamp(0.0, 1.0);
    let depth = blade.root[2] + (blade.tip[2] - blade.root[2]) * row.along;
    let side = ((x - row.x) / row.half.max(pixel)).clamp(-1.0, 1.0);
    let light = 0.8 - 0.35 * (side * 4.0).clamp(-1.0, 1.0) + 0.15 * side;
    let [root, tip] = blade.colors;
    Some((depth, [0, 1, 2].map(|k| (root[k] + (tip[k] - root[k]) * row.along) * light), coverage))
}

/// Returns the index of the nearest item that covers a place of a view.
fn topmost(items: &[Item], x: f32, y: f32, tilt: [f32; 2], pixel: f32) -> Option<usize> {
    (0..items.len()).rev().find(|i| at(&items[*i], x, y, tilt, pixel).is_some_and(|(_, _, covered)| covered > 0.5))
}

fn tilts() -> Vec<[f32; 2]> {
    let steps = [-TILT, 0.0, TILT];
    steps.iter().flat_map(|y| steps.map(|x| [x, *y])).collect()
}

/// Returns the discs that some view sees.
fn discs(items: &[Item]) -> Vec<Disc> {
    let pixel = 2.0 / GRID as f32;
    let margin = (1.2 * TILT / pixel).ceil() as i32;
    let place = |i: i32| (i as f32 + 0.5) * pixel - 1.0;
    let mut found = Vec::new();
    for (index, item) in items.iter().enumerate() {
        for j in -margin..GRID as i32 + margin {
            for i in -margin..GRID as i32 + margin {
                let (x, y) = (place(i), place(j));
                let Some((depth, light, covered)) = at(item, x, y, [0.0; 2], pixel) else { continue };
                let is_seen = |tilt: &[f32; 2]| {
                    let [u, v] = [x - depth * tilt[0], y - depth * tilt[1]];
                    u.abs() < 1.0 + pixel && v.abs() < 1.0 + pixel && topmost(items, u, v, *tilt, pixel) == Some(index)
                };
                if covered > 0.5 && tilts().iter().any(is_seen) {
                    let color = light.map(coded);
                    let half = [WIDTH * pixel; 2];
                    found.push(Disc { x, y, depth, half, color, item: index });
                }
            }
        }
    }
    found
}

/// Returns the splats of discs.
fn cloud(discs: &[Disc]) -> Cloud {
    let mut cloud = Cloud::with_room(discs.len(), 0);
    for disc in discs {
        let z = 1.0 / (DISTANCE[0] + DISTANCE[1] * disc.depth);
        let scale = z * tangent();
        cloud.places.push([disc.x * scale, disc.y * scale, z]);
        let [wide, high] = disc.half.map(|v| (v * scale).powi(2));
        cloud.spreads.push([wide, 0.0, 0.0, high, 0.0, 1e-8]);
        cloud.opacities.push(1.0);
        cloud.colors.push(disc.color);
    }
    cloud
}

/// Returns the views of the splats in sRGB, as (view, pixel, color).
fn views(cloud: &Cloud) -> Vec<Vec<[f32; 3]>> {
    let camera = Camera::of(Path::new(BUILTIN), &Options::parse("").unwrap().of_builtin(), cloud).unwrap().0;
    let ordered = Ordered::new(cloud.clone(), &camera, [SIZE, SIZE]);
    let pixels = SIZE * SIZE;
    let one = |tilt: &[f32; 2]| {
        // A tilt moves content by its depth in scene units, which is in proportion to the inverse distance.
        let by = tilt.map(|t| t / DISTANCE[1] * tangent());
        let moved = tilt.map(|t| t * DISTANCE[0] / DISTANCE[1] * SIZE as f32 / 2.0);
        let drawn = draw(&ordered, &Displaced { by, moved });
        (0..pixels).map(|i| [0, 1, 2].map(|k| drawn[k * pixels + i])).collect()
    };
    tilts().iter().map(one).collect()
}

/// Returns the views of the still life in sRGB.
fn wanted(items: &[Item]) -> Vec<Vec<[f32; 3]>> {
    let canvas = Canvas { height: SIZE, width: SIZE };
    let planes = super::render::render(canvas, items, &tilts(), &[Color::Red, Color::Green, Color::Blue]);
    let pixel = |view: usize, i: usize| [0, 1, 2].map(|k: usize| coded(planes[k][view][i]));
    (0..9).map(|view| (0..SIZE * SIZE).map(|i| pixel(view, i)).collect()).collect()
}

/// Corrects the colors of discs by the differences where views see them.
fn correct(items: &[Item], discs: &mut [Disc]) {
    let wanted = wanted(items);
    let fine = 2.0 / SIZE as f32;
    let seen: Vec<Vec<usize>> = (discs.iter())
        .map(|disc| {
            let place = |tilt: &[f32; 2]| {
                let [u, v] = [disc.x - disc.depth * tilt[0], disc.y - disc.depth * tilt[1]];
                let [i, j] = [u, v].map(|v| ((v + 1.0) / fine).floor());
                let inside = (0.0..SIZE as f32).contains(&i) && (0.0..SIZE as f32).contains(&j);
                let is_top = inside && topmost(items, u, v, *tilt, fine) == Some(disc.item);
                if is_top { j as usize * SIZE + i as usize } else { usize::MAX }
            };
            tilts().iter().map(place).collect()
        })
        .collect();
    for _ in 0..ROUNDS {
        let found = views(&cloud(discs));
        for (disc, places) in discs.iter_mut().zip(&seen) {
            let (mut sum, mut count) = ([0.0f32; 3], 0.0);
            for (view, at) in places.iter().enumerate().filter(|(_, at)| **at != usize::MAX) {
                // The mean over the four pixels of a sample of the grid.
                for step in [0, 1, SIZE, SIZE + 1] {
                    let at = (at + step).min(SIZE * SIZE - 1);
                    (0..3).for_each(|k| sum[k] += wanted[view][at][k] - found[view][at][k]);
                    count += 1.0;
                }
            }
            if count > 0.0 {
                (0..3).for_each(|k| disc.color[k] = (disc.color[k] + 0.7 * sum[k] / count).clamp(-0.5, 1.5));
            }
        }
    }
}

/// Writes discs as `.spz` of version 3.
fn written(discs: &[Disc]) -> Vec<u8> {
    let byte = |v: f32| v.round().clamp(0.0, 255.0) as u8;
    let cloud = cloud(discs);
    let mut out = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::best());
    let mut put = |bytes: &[u8]| out.write_all(bytes).unwrap();
    put(b"NGSP");
    put(&3u32.to_le_bytes());
    put(&(discs.len() as u32).to_le_bytes());
    put(&[0, BITS, 1, 0]);
    for [x, y, z] in &cloud.places {
        [*x, -y, -z].iter().for_each(|v| put(&((v * f32::from(1u16 << BITS)).round() as i32).to_le_bytes()[..3]));
    }
    discs.iter().for_each(|_| put(&[255]));
    cloud.colors.iter().for_each(|color| put(&color.map(|v| byte(((v - 0.5) / C0 * 0.15 + 0.5) * 255.0))));
    for [wide, _, _, high, _, thin] in &cloud.spreads {
        put(&[*wide, *high, *thin].map(|v| byte((0.5 * v.ln() + 10.0) * 16.0)));
    }
    // The largest component is the last one, and the others are 0.
    discs.iter().for_each(|_| put(&[0, 0, 0, 0xc0]));
    out.finish().unwrap()
}

#[test]
fn the_splats_show_the_still_life() {
    let items = items([1.0, 1.0], Mood::Day, 0.0);
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("splats/still-life.spz");
    if std::env::var_os("EYEBOX_WRITE").is_some() {
        let mut discs = discs(&items);
        correct(&items, &mut discs);
        std::fs::write(&file, written(&discs)).unwrap();
    }
    // The file is a part of this program, which has the old one until it is built again.
    let cloud = read(&file, Format::Spz).unwrap();
    assert!((2_000..=20_000).contains(&cloud.len()) && std::fs::metadata(&file).unwrap().len() < 1 << 20);
    for (view, (found, wanted)) in views(&cloud).iter().zip(wanted(&items)).enumerate() {
        let differences = found.iter().flatten().zip(wanted.iter().flatten()).map(|(a, b)| f64::from(a - b).powi(2));
        let psnr = -10.0 * (differences.sum::<f64>() / (3 * SIZE * SIZE) as f64).log10();
        println!("view {view}: {psnr:.1} dB");
        assert!(psnr > 20.0, "view {view}: {psnr:.1} dB");
    }
}
