//! Makes the built-in scene of splats from the still life, and checks that the stored file shows the still life.
//!
//! `EYEBOX_WRITE=1` writes the file. Each splat is a disc on a surface that some view sees. Discs are small where the
//! picture has details, and have the mean color of their texture. The colors are then fitted to the views in several
//! sizes, because neighboring splats blur each other.

use super::render::{Canvas, Item};
use super::shape::Blade;
use super::still_life::{Mood, items};
use crate::splats::cloud::Cloud;
use crate::splats::format::{Format, read};
use crate::splats::picture::{TiledSplats, draw, tiled};
use crate::splats::project::{Displaced, Ordered};
use crate::splats::{camera::Camera, format::BUILTIN, options::Options};
use eyebox_base::files::linear_to_srgb;
use eyebox_kernels::draw_splats::{CLOSED, FAINTEST, OPAQUE, SIDE};
use eyebox_kernels::splat_colors::C0;
use eyebox_optics::Color;
use rayon::prelude::*;
use std::io::Write;
use std::path::Path;

/// The largest number of splats.
const MOST: usize = 19_800;
/// Pixels along a side of the pictures whose details decide the sizes of discs.
const SIZE: usize = 240;
/// Sizes of the pictures to which colors are fitted. With one size, another size shows the pattern of the discs.
const SIZES: [usize; 3] = [200, 256, 336];
/// Sides of the largest and the smallest square of a disc in pixels of [`SIZE`].
const COARSEST: f32 = 4.0;
const FINEST: f32 = 1.0;
/// Samples along a side of a square.
const SAMPLES: usize = 4;
/// Largest tilt of the views, in scene units per unit of depth.
const TILT: f32 = 0.08;
/// Inverse distance of the plane without parallax, and its change per unit of depth, per unit of the splats.
const DISTANCE: [f32; 2] = [1.0, 0.2];
/// Fractional bits of the positions.
const BITS: u8 = 14;
/// Distance by which a disc is farther than its surface, in proportion to its distance, per scene unit of its width.
/// Otherwise large discs would cover the small ones next to them.
const BEHIND: f32 = 0.06;
/// Deviation of a disc in sides of its square. Narrower discs leave gaps at the corners of squares, which show as a grid.
const WIDTH: f32 = 0.65;
/// Rounds of the fit of colors.
const ROUNDS: usize = 80;
/// Weight of the colors of the textures in the fit, and of dark pixels.
const NEAR: f32 = 1e-3;
const DARK: f32 = 0.03;

/// A disc with its place in the middle view.
#[derive(Debug, Clone, Copy)]
struct Disc {
    x: f32,
    y: f32,
    depth: f32,
    /// Half its width and half its height, in scene units.
    half: [f32; 2],
    /// Red, green and blue in sRGB.
    color: [f32; 3],
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

/// A square of the middle view on an item, and the same square in four parts.
struct Square {
    /// The disc of the whole square, if the item covers it.
    disc: Option<Disc>,
    /// Variance of the pictures in the square times its pixels. It is infinite at the outline of the item.
    error: f32,
    parts: Vec<Square>,
}

/// The items, and the views that the splats are to show.
struct Goal<'a> {
    items: &'a [Item],
    views: Vec<Vec<[f32; 3]>>,
}

impl Goal<'_> {
    /// Returns a square with its middle at (x, y), of `side` pixels. It is `None` if no view sees it.
    fn square(&self, item: usize, [x, y]: [f32; 2], side: f32) -> Option<Square> {
        let pixel = 2.0 / SIZE as f32;
        let step = side * pixel / SAMPLES as f32;
        let offset = |i: usize| (i as f32 - (SAMPLES - 1) as f32 / 2.0) * step;
        let samples = (0..SAMPLES * SAMPLES).map(|i| [x + offset(i % SAMPLES), y + offset(i / SAMPLES)]);
        let (mut depth, mut light, mut covered, mut seen) = (0.0, [0.0; 3], 0.0, [false; 9]);
        for [x, y] in samples {
            let Some((z, paint, share)) = at(&self.items[item], x, y, [0.0; 2], step) else { continue };
            if share <= 0.5 {
                continue;
            }
            covered += 1.0;
            depth += z;
            (0..3).for_each(|k| light[k] += paint[k]);
            for (seen, tilt) in seen.iter_mut().zip(tilts()) {
                let [u, v] = [x - z * tilt[0], y - z * tilt[1]];
                let inside = u.abs() < 1.0 + pixel && v.abs() < 1.0 + pixel;
                *seen = *seen || inside && topmost(self.items, u, v, tilt, step) == Some(item);
            }
        }
        if !seen.contains(&true) {
            return None;
        }
        depth /= covered;
        let color = light.map(|v| coded(v / covered));
        let share = covered / (SAMPLES * SAMPLES) as f32;
        let half = [WIDTH * side * pixel; 2];
        let variances =
            tilts().into_iter().zip(&self.views).zip(seen).filter(|(_, seen)| *seen).map(|((tilt, view), _)| {
                let [u, v] = [x - depth * tilt[0], y - depth * tilt[1]];
                variance(view, [u, v], side) * side * side
            });
        let error = if share < 1.0 { f32::INFINITY } else { variances.fold(0.0, f32::max) };
        let next = side * pixel / 4.0;
        let corners = [[-next, -next], [next, -next], [-next, next], [next, next]];
        let part = |[dx, dy]: [f32; 2]| self.square(item, [x + dx, y + dy], side / 2.0);
        let parts = if side > FINEST { corners.into_iter().filter_map(part).collect() } else { Vec::new() };
        let disc = (share > 0.5).then_some(Disc { x, y, depth, half, color });
        Some(Square { disc, error, parts })
    }

    /// Returns the discs that some view sees, at most [`MOST`].
    fn discs(&self) -> Vec<Disc> {
        let pixel = 2.0 / SIZE as f32;
        let reach = ((1.0 + 1.2 * TILT) / (COARSEST * pixel)).ceil() as i32;
        let middle = |i: i32| (i as f32 + 0.5) * COARSEST * pixel;
        let places: Vec<[f32; 2]> =
            (-reach..reach).flat_map(|j| (-reach..reach).map(move |i| [middle(i), middle(j)])).collect();
        let squares: Vec<Square> = (0..self.items.len())
            .into_par_iter()
            .flat_map_iter(|item| places.iter().filter_map(move |place| self.square(item, *place, COARSEST)))
            .collect();
        let taken = |limit: f32| {
            let mut discs = Vec::new();
            squares.iter().for_each(|square| square.take(limit, &mut discs));
            discs
        };
        // The finest that is not too many, by halving the interval of the logarithm.
        let (mut low, mut high) = (-20.0f32, 10.0f32);
        for _ in 0..24 {
            let limit = 0.5 * (low + high);
            if taken(limit.exp()).len() > MOST { low = limit } else { high = limit }
        }
        taken(high.exp())
    }
}

impl Square {
    /// Adds the disc of the square if its error is small, otherwise the discs of its parts.
    fn take(&self, limit: f32, discs: &mut Vec<Disc>) {
        if self.error > limit && !self.parts.is_empty() {
            self.parts.iter().for_each(|part| part.take(limit, discs));
        } else {
            discs.extend(self.disc);
        }
    }
}

/// Returns the variance of a view around (u, v), as far as a disc of a square of `side` pixels reaches, summed over the
/// colors.
fn variance(view: &[[f32; 3]], [u, v]: [f32; 2], side: f32) -> f32 {
    let span = |middle: f32| {
        let at = (middle + 1.0) * SIZE as f32 / 2.0;
        let [first, end] = [at - 0.75 * side - 0.5, at + 0.75 * side + 0.5].map(|v| v.clamp(0.0, SIZE as f32) as usize);
        first..end
    };
    let pixels: Vec<[f32; 3]> = span(v).flat_map(|row| span(u).map(move |column| view[row * SIZE + column])).collect();
    let mean = |power: i32, k: usize| pixels.iter().map(|p| p[k].powi(power)).sum::<f32>() / pixels.len().max(1) as f32;
    (0..3).map(|k| (mean(2, k) - mean(1, k).powi(2)).max(0.0)).sum()
}

/// Returns the splats of discs.
fn cloud(discs: &[Disc]) -> Cloud {
    let mut cloud = Cloud::with_room(discs.len(), 0);
    for disc in discs {
        let z = (1.0 + BEHIND * disc.half[0]) / (DISTANCE[0] + DISTANCE[1] * disc.depth);
        let scale = z * tangent();
        cloud.places.push([disc.x * scale, disc.y * scale, z]);
        let [wide, high] = disc.half.map(|v| (v * scale).powi(2));
        cloud.spreads.push([wide, 0.0, 0.0, high, 0.0, 1e-8]);
        cloud.opacities.push(1.0);
        cloud.colors.push(disc.color);
    }
    cloud
}

/// Returns the splats in the order of the camera, and the displacement of each view.
fn seen(cloud: &Cloud, size: usize) -> (Ordered, Vec<Displaced>) {
    let camera = Camera::of(Path::new(BUILTIN), &Options::parse("").unwrap().of_builtin(), cloud).unwrap().0;
    let ordered = Ordered::of(cloud, &camera, [size, size]);
    let one = |tilt: [f32; 2]| {
        // A tilt moves content by its depth in scene units, which is in proportion to the inverse distance.
        let by = tilt.map(|t| t / DISTANCE[1] * tangent());
        let moved = tilt.map(|t| t * DISTANCE[0] / DISTANCE[1] * size as f32 / 2.0);
        Displaced { by, moved }
    };
    (ordered, tilts().into_iter().map(one).collect())
}

/// Returns the views of the splats in sRGB, as (view, pixel, color).
fn views(cloud: &Cloud, size: usize) -> Vec<Vec<[f32; 3]>> {
    let (ordered, places) = seen(cloud, size);
    let pixels = size * size;
    let one = |place: &Displaced| {
        let drawn = draw(&ordered, place, None);
        (0..pixels).map(|i| [0, 1, 2].map(|k| drawn[k * pixels + i])).collect()
    };
    places.iter().map(one).collect()
}

/// Returns the views of the still life in sRGB.
fn wanted(items: &[Item], size: usize) -> Vec<Vec<[f32; 3]>> {
    let canvas = Canvas { height: size, width: size };
    let planes = super::render::render(canvas, items, &tilts(), &[Color::Red, Color::Green, Color::Blue]);
    let pixel = |view: usize, i: usize| [0, 1, 2].map(|k: usize| coded(planes[k][view][i]));
    (0..9).map(|view| (0..size * size).map(|i| pixel(view, i)).collect()).collect()
}

/// Returns the splats of each pixel with their weights in its color.
fn weights(cloud: &Cloud, size: usize) -> Vec<Vec<(u32, f32)>> {
    // The index of a splat takes the place of its color, because drawing leaves out splats and changes their order.
    let colors = (0..cloud.len()).map(|i| [i as f32, 0.0, 0.0]).collect();
    let (ordered, places) = seen(&Cloud { colors, ..cloud.clone() }, size);
    let across = ordered.args().across as usize;
    let of_view = |place: &Displaced| {
        let TiledSplats { splats, first, entries } = tiled(&ordered, place);
        let pixel = move |i: usize| {
            let (x, y, side) = (i % size, i / size, SIDE as usize);
            let tile = y / side * across + x / side;
            let (mut clear, mut all) = (1.0f32, Vec::new());
            for entry in &entries[first[tile] as usize..first[tile + 1] as usize] {
                let splat = &splats[*entry as usize];
                let (dx, dy, [a, b, c]) = (x as f32 - splat.x, y as f32 - splat.y, splat.conic);
                let alpha = (splat.opacity * (-0.5 * (a * dx * dx + c * dy * dy) - b * dx * dy).exp()).min(OPAQUE);
                if alpha < FAINTEST {
                    continue;
                }
                if clear * (1.0 - alpha) < CLOSED {
                    break;
                }
                all.push((splat.color[0] as u32, alpha * clear));
                clear *= 1.0 - alpha;
            }
            all
        };
        (0..size * size).map(pixel).collect::<Vec<_>>()
    };
    places.par_iter().flat_map_iter(of_view).collect()
}

/// Returns the colors with the smallest error of the light in the views, by conjugate gradients.
fn fitted(cloud: &Cloud, items: &[Item]) -> Vec<[f32; 3]> {
    let rows: Vec<_> = SIZES.iter().flat_map(|size| weights(cloud, *size)).collect();
    let wanted: Vec<[f32; 3]> = SIZES.iter().flat_map(|size| wanted(items, *size)).flatten().collect();
    // The square of the slope of the curve, because errors count in linear light. Dark pixels count a little, too.
    let counts: Vec<[f32; 3]> = wanted.iter().map(|v| v.map(|v| v.max(0.0).powf(2.4) + DARK)).collect();
    let mut colors = cloud.colors.clone();
    for k in 0..3 {
        let apply = |colors: &[f32]| -> Vec<f32> {
            let one = |(row, count): (&Vec<(u32, f32)>, &[f32; 3])| {
                count[k] * row.iter().map(|(i, weight)| weight * colors[*i as usize]).sum::<f32>()
            };
            rows.par_iter().zip(&counts).map(one).collect()
        };
        let back = |pixels: &[f32]| -> Vec<f32> {
            let mut sums = vec![0.0f32; cloud.len()];
            let all = rows.iter().zip(pixels);
            all.for_each(|(row, v)| row.iter().for_each(|(i, weight)| sums[*i as usize] += weight * v));
            sums
        };
        let dot = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| f64::from(a * b)).sum::<f64>();
        let begun: Vec<f32> = cloud.colors.iter().map(|color| color[k]).collect();
        let shown = apply(&begun);
        let off: Vec<f32> =
            wanted.iter().zip(&counts).zip(&shown).map(|((v, count), shown)| count[k] * v[k] - shown).collect();
        let mut change = vec![0.0f32; cloud.len()];
        let mut rest = back(&off);
        let (mut way, mut size) = (rest.clone(), dot(&rest, &rest));
        for _ in 0..ROUNDS {
            let mut image = back(&apply(&way));
            image.iter_mut().zip(&way).for_each(|(v, way)| *v += NEAR * way);
            let step = (size / dot(&way, &image).max(1e-30)) as f32;
            change.iter_mut().zip(&way).for_each(|(v, way)| *v += step * way);
            rest.iter_mut().zip(&image).for_each(|(v, image)| *v -= step * image);
            let new = dot(&rest, &rest);
            let turn = (new / size.max(1e-30)) as f32;
            way.iter_mut().zip(&rest).for_each(|(v, rest)| *v = rest + turn * *v);
            size = new;
        }
        colors.iter_mut().zip(&change).for_each(|(color, change)| color[k] = (color[k] + change).clamp(-0.4, 1.4));
    }
    colors
}

/// Writes discs as `.spz` of version 3.
fn written(discs: &[Disc], cloud: &Cloud) -> Vec<u8> {
    let byte = |v: f32| v.round().clamp(0.0, 255.0) as u8;
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
        let discs = Goal { items: &items, views: wanted(&items, SIZE) }.discs();
        std::fs::write(&file, written(&discs, &cloud(&discs))).unwrap();
        // The colors fit the places and sizes as the file stores them.
        let stored = read(&file, Format::Spz).unwrap();
        let colors = fitted(&stored, &items);
        std::fs::write(&file, written(&discs, &Cloud { colors, ..cloud(&discs) })).unwrap();
    }
    // The file is a part of this program, which has the old one until it is built again.
    let cloud = read(&file, Format::Spz).unwrap();
    assert!((2_000..=20_000).contains(&cloud.len()) && std::fs::metadata(&file).unwrap().len() < 1 << 20);
    // The colors were not fitted to the second size.
    for size in [SIZES[1], 300] {
        for (view, (found, wanted)) in views(&cloud, size).iter().zip(wanted(&items, size)).enumerate() {
            let differences =
                found.iter().flatten().zip(wanted.iter().flatten()).map(|(a, b)| f64::from(a - b).powi(2));
            let psnr = -10.0 * (differences.sum::<f64>() / (3 * size * size) as f64).log10();
            println!("{size}, view {view}: {psnr:.1} dB");
            assert!(psnr > 24.5, "{size}, view {view}: {psnr:.1} dB");
        }
    }
}
