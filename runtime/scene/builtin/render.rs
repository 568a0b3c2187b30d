//! Renders the views of a scene, with each surface in its own projection and near covering far.
//!
//! The texture of a surface is made once. It is averaged over the area of a pixel and stored at half a pixel's spacing,
//! so that every view can interpolate between its texels. The outline of a surface, the point at which a ray meets it,
//! and the width of a blade are computed per view and pixel.

use super::{
    shape::{Blade, Shape},
    texture::{Paint, lit},
};
use crate::light_field::field::by_color;
use eyebox_optics::Color;
use rayon::prelude::*;

/// A texture gives the paint at a place of the surface.
pub(super) type Texture = Box<dyn Fn(f32, f32) -> Paint + Send + Sync>;

/// One item of a scene.
pub(super) enum Item {
    /// A textured surface inside the box left, top, right, bottom (from the axis).
    Surface { shape: Shape, area: [f32; 4], texture: Texture },
    /// A strip of one color.
    Blade(Blade),
}

impl Item {
    /// Multiplies the light of the item.
    pub fn brighten(&mut self, factor: f32) {
        match self {
            Self::Surface { texture, .. } if factor != 1.0 => {
                let inner = std::mem::replace(texture, Box::new(|_, _| [0.0; 4]));
                *texture = Box::new(move |x, y| lit(inner(x, y), factor));
            }
            Self::Blade(blade) => blade.colors = blade.colors.map(|c| c.map(|v| v * factor)),
            Self::Surface { .. } => {}
        }
    }

    /// Returns the farthest and the nearest depth of the part between the heights -`half` and `half`.
    pub fn depths(&self, half: f32) -> [f32; 2] {
        match self {
            Self::Surface { shape, area, .. } => shape.depths(area[1].max(-half), area[3].min(half)),
            Self::Blade(b) => [b.root[2].min(b.tip[2]), b.root[2].max(b.tip[2])],
        }
    }
}

/// The picture that all views share, with its pixels and their places in scene units.
#[derive(Debug, Clone, Copy)]
pub(super) struct Canvas {
    pub height: usize,
    pub width: usize,
}

impl Canvas {
    /// Returns the width of a pixel in scene units.
    pub fn pixel(&self) -> f32 {
        2.0 / self.height.min(self.width) as f32
    }

    /// Returns half the width and half the height in scene units. The smaller one is 1.
    pub fn half(&self) -> [f32; 2] {
        [self.width, self.height].map(|n| n as f32 * self.pixel() / 2.0)
    }

    /// Returns the middle of pixel column `i`.
    fn x(&self, i: usize) -> f32 {
        (i as f32 + 0.5) * self.pixel() - self.half()[0]
    }

    /// Returns the middle of pixel row `j`.
    fn y(&self, j: usize) -> f32 {
        (j as f32 + 0.5) * self.pixel() - self.half()[1]
    }

    /// Returns the pixels whose area touches `from..to` along an axis of `n` pixels.
    fn span(&self, from: f32, to: f32, n: usize) -> std::ops::Range<usize> {
        let place = |v: f32| (v / self.pixel() + n as f32 / 2.0).clamp(0.0, n as f32);
        place(from).floor() as usize..place(to).ceil() as usize
    }
}

/// A baked texture with N - 1 colors, which are multiplied by the coverage, and the coverage last.
struct Skin<const N: usize> {
    left: f32,
    top: f32,
    per_unit: f32,
    rows: usize,
    columns: usize,
    texels: Vec<[f32; N]>,
}

impl<const N: usize> Skin<N> {
    /// Bakes the part of `area` that some view can see.
    fn bake(canvas: &Canvas, area: [f32; 4], texture: &Texture, channels: &[usize], margin: f32) -> Self {
        let half = canvas.half();
        let pixel = canvas.pixel();
        let left = area[0].max(-half[0] - margin) - pixel;
        let top = area[1].max(-half[1] - margin) - pixel;
        let right = (area[2].min(half[0] + margin) + pixel).max(left + pixel);
        let bottom = (area[3].min(half[1] + margin) + pixel).max(top + pixel);
        // Cells are half a pixel wide, with two samples each on alternating diagonals.
        let cell = pixel / 2.0;
        let columns = ((right - left) / cell).ceil() as usize + 1;
        let rows = ((bottom - top) / cell).ceil() as usize + 1;
        let mut cells = vec![[0.0f32; N]; rows * columns];
        cells.par_chunks_mut(columns).enumerate().for_each(|(j, row)| {
            for (i, out) in row.iter_mut().enumerate() {
                let turn = if (i + j) % 2 == 0 { 0.0 } else { 0.5 };
                for (dx, dy) in [(0.25, 0.25 + turn), (0.75, 0.75 - turn)] {
                    let (x, y) = (left + (i as f32 + dx) * cell, top + (j as f32 + dy) * cell);
                    let outside = x < area[0] || x > area[2] || y < area[1] || y > area[3];
                    let paint = if outside { [0.0; 4] } else { texture(x, y) };
                    for (k, &channel) in channels.iter().enumerate() {
                        out[k] += 0.5 * paint[channel].max(0.0) * paint[3];
                    }
                    out[N - 1] += 0.5 * paint[3];
                }
            }
        });
        // A texel is the average of the four cells around a corner, which is the area of a pixel.
        let texels = (0..(rows - 1) * (columns - 1))
            .into_par_iter()
            .map(|k| {
                let at = k / (columns - 1) * columns + k % (columns - 1);
                let [a, b] = [&cells[at..at + 2], &cells[at + columns..at + columns + 2]];
                std::array::from_fn(|n| 0.25 * (a[0][n] + a[1][n] + b[0][n] + b[1][n]))
            })
            .collect();
        Self { left: left + cell, top: top + cell, per_unit: 1.0 / cell, rows: rows - 1, columns: columns - 1, texels }
    }

    /// Interpolates between the texels. Places beyond the last texel take the last one.
    #[inline]
    fn at(&self, x: f32, y: f32) -> [f32; N] {
        let u = ((x - self.left) * self.per_unit).clamp(0.0, (self.columns - 1) as f32);
        let v = ((y - self.top) * self.per_unit).clamp(0.0, (self.rows - 1) as f32);
        let (i, j) = (u as usize, v as usize);
        let (tx, ty) = (u - i as f32, v - j as f32);
        let right = usize::from(i + 1 < self.columns);
        let below = if j + 1 < self.rows { self.columns } else { 0 };
        let at = j * self.columns + i;
        let [a, b, c, d] = [at, at + right, at + below, at + below + right].map(|k| &self.texels[k]);
        let [wa, wb, wc, wd] = [(1.0 - tx) * (1.0 - ty), tx * (1.0 - ty), (1.0 - tx) * ty, tx * ty];
        std::array::from_fn(|n| a[n] * wa + b[n] * wb + c[n] * wc + d[n] * wd)
    }
}

/// Transmission below this counts as none. It is a tenth of the last bit of an 8-bit picture.
const OPAQUE: f32 = 4e-4;

/// Renders `items`, which come from far to near, once for each tilt as `[color][view][pixel]` in linear light.
pub(super) fn render(canvas: Canvas, items: &[Item], tilts: &[[f32; 2]], colors: &[Color]) -> Vec<Vec<Vec<f32>>> {
    let channels: Vec<usize> = colors.iter().map(|c| c.channel()).collect();
    match channels.len() {
        1 => render_channels::<2>(canvas, items, tilts, &channels),
        2 => render_channels::<3>(canvas, items, tilts, &channels),
        _ => render_channels::<4>(canvas, items, tilts, &channels),
    }
}

/// The textures of a scene's surfaces, made once for all views up to a largest tilt. Blades have no texture.
pub(super) struct Skins<const N: usize>(Vec<Option<Skin<N>>>);

impl<const N: usize> Skins<N> {
    /// Bakes the textures for views tilted by at most `tilt`, with these channels (N - 1 of them).
    pub fn bake(canvas: Canvas, items: &[Item], tilt: f32, channels: &[usize]) -> Self {
        // The largest tilt moves content at the ends of the depth span by this distance.
        let margin = tilt * 1.1;
        let bake = |item: &Item| match item {
            Item::Surface { area, texture, .. } => Some(Skin::bake(&canvas, *area, texture, channels, margin)),
            Item::Blade(_) => None,
        };
        Self(items.iter().map(bake).collect())
    }

    /// Renders one view as `[channel][pixel]`.
    pub fn view(&self, canvas: Canvas, items: &[Item], m: [f32; 2], channels: &[usize]) -> Vec<Vec<f32>> {
        // The picture has the colors up to now, and the transmission of light from behind. The order is from near to
        // far, so covered content costs nothing.
        let clear: [f32; N] = std::array::from_fn(|k| f32::from(u8::from(k == N - 1)));
        let mut picture = vec![clear; canvas.height * canvas.width];
        for (item, skin) in items.iter().zip(&self.0).rev() {
            match (item, skin) {
                (Item::Surface { shape, area, .. }, Some(skin)) => {
                    draw_surface(&canvas, &mut picture, shape, area, skin, m);
                }
                (Item::Blade(blade), _) => draw_blade(&canvas, &mut picture, blade, channels, m),
                (Item::Surface { .. }, None) => {}
            }
        }
        (0..channels.len()).map(|k| picture.iter().map(|p| p[k]).collect()).collect()
    }
}

fn render_channels<const N: usize>(
    canvas: Canvas,
    items: &[Item],
    tilts: &[[f32; 2]],
    channels: &[usize],
) -> Vec<Vec<Vec<f32>>> {
    let tilt = tilts.iter().flatten().fold(0.0f32, |a, b| a.max(b.abs()));
    let skins = Skins::<N>::bake(canvas, items, tilt, channels);
    let views: Vec<Vec<Vec<f32>>> = tilts.par_iter().map(|&m| skins.view(canvas, items, m, channels)).collect();
    by_color(views, channels.len())
}

fn draw_surface<const N: usize>(
    canvas: &Canvas,
    picture: &mut [[f32; N]],
    shape: &Shape,
    area: &[f32; 4],
    skin: &Skin<N>,
    m: [f32; 2],
) {
    // The area can appear here, displaced by its depths, and a pixel farther.
    let [far, near] = shape.depths(area[1], area[3]);
    let reach = |k: usize| {
        let (a, b) = (-far * m[k], -near * m[k]);
        let slack = canvas.pixel() + 0.2 * m[k].abs();
        (area[k] + a.min(b) - slack, area[k + 2] + a.max(b) + slack)
    };
    let (left, right) = reach(0);
    let (top, bottom) = reach(1);
    let columns = canvas.span(left, right, canvas.width);
    for j in canvas.span(top, bottom, canvas.height) {
        let y = canvas.y(j);
        let row = &mut picture[j * canvas.width..][..canvas.width];
        for i in columns.clone() {
            let through = row[i][N - 1];
            if through < OPAQUE {
                continue;
            }
            let Some(hit) = shape.meet(canvas.x(i), y, m, canvas.pixel()) else { continue };
            let paint = skin.at(hit.x, hit.y);
            for (seen, paint) in row[i].iter_mut().zip(paint).take(N - 1) {
                *seen += paint * hit.coverage * through;
            }
            row[i][N - 1] = through * (1.0 - paint[N - 1] * hit.coverage);
        }
    }
}

fn draw_blade<const N: usize>(
    canvas: &Canvas,
    picture: &mut [[f32; N]],
    blade: &Blade,
    channels: &[usize],
    m: [f32; 2],
) {
    let pixel = canvas.pixel();
    let [top, bottom] = blade.rows(m);
    for j in canvas.span(top, bottom, canvas.height) {
        let Some(row) = blade.row(canvas.y(j), m) else { continue };
        let (left, right) = (row.x - row.half, row.x + row.half);
        for i in canvas.span(left, right, canvas.width) {
            let x = canvas.x(i);
            // The coverage is exactly the share of the pixel's width between the edges of the blade.
            let coverage = ((right.min(x + pixel / 2.0) - left.max(x - pixel / 2.0)) / pixel).clamp(0.0, 1.0);
            // The blade is folded along its middle, and the side towards the light is brighter.
            let side = ((x - row.x) / row.half.max(pixel)).clamp(-1.0, 1.0);
            let light = 0.8 - 0.35 * (side * 4.0).clamp(-1.0, 1.0) + 0.15 * side;
            let seen = &mut picture[j * canvas.width + i];
            let share = coverage * seen[N - 1];
            for (k, &channel) in channels.iter().enumerate() {
                let [root, tip] = blade.colors.map(|color| color[channel]);
                seen[k] += (root + (tip - root) * row.along) * light * share;
            }
            seen[N - 1] -= share;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::builtin::texture::rgb;

    /// Describes a white strip at z = 1 from x = -0.25 to 0.25 in front of a gray wall at z = -1, half of which is
    /// bright.
    fn strip() -> Vec<Item> {
        let wall = |x: f32, _| if x < 0.0 { rgb(0.1, 0.1, 0.1) } else { rgb(0.3, 0.3, 0.3) };
        let everywhere = [-9.0, -9.0, 9.0, 9.0];
        vec![
            Item::Surface { shape: Shape::Card { z: -1.0 }, area: everywhere, texture: Box::new(wall) },
            Item::Surface {
                shape: Shape::Card { z: 1.0 },
                area: [-0.25, -9.0, 0.25, 9.0],
                texture: Box::new(|_, _| rgb(1.0, 1.0, 1.0)),
            },
        ]
    }

    #[test]
    fn nearer_covers_farther_and_each_moves_by_its_depth() {
        let canvas = Canvas { height: 40, width: 60 };
        // One scene unit is 20 pixels. A tilt of 0.2 moves the strip by -4 and the wall by +4 pixels.
        for (tilt, moved) in [(0.0, 0i32), (0.2, -4), (-0.2, 4)] {
            let view = &render(canvas, &strip(), &[[tilt, 0.0]], &[Color::Green])[0][0];
            let row = &view[20 * 60..21 * 60];
            for (i, &value) in row.iter().enumerate() {
                let x = i as i32;
                let inside = (25 + moved..35 + moved).contains(&x);
                // The edges of the texture take a pixel, and the edges of the strip and the wall are skipped.
                if [25 + moved, 35 + moved, 30 - moved].iter().any(|e| (x - e).abs() <= 1) {
                    continue;
                }
                let wanted = if inside {
                    1.0
                } else if x < 30 - moved {
                    0.1
                } else {
                    0.3
                };
                assert!((value - wanted).abs() < 1e-4, "tilt {tilt}, column {i}: {value}, not {wanted}");
            }
            // No light is lost or added at the edges.
            let strip: f32 = row.iter().zip(0i32..).map(|(v, x)| if x < 30 - moved { v - 0.1 } else { v - 0.3 }).sum();
            let over = (25 + moved..35 + moved).map(|x| if x < 30 - moved { 0.9 } else { 0.7 }).sum::<f32>();
            assert!((strip - over).abs() < 0.05, "{strip} {over}");
        }
        let rows = &render(canvas, &strip(), &[[0.0, 0.2]], &[Color::Green])[0][0];
        let same = rows[..60].iter().zip(&rows[60 * 20..]).all(|(a, b)| (a - b).abs() < 1e-5);
        assert!(same, "a tilt along y moves nothing along x");
    }

    #[test]
    fn fine_texture_is_averaged_not_aliased() {
        let fine = |x: f32, _| if (x * 27.2).rem_euclid(1.0) < 0.5 { rgb(1.0, 1.0, 1.0) } else { rgb(0.0, 0.0, 0.0) };
        let item =
            Item::Surface { shape: Shape::Card { z: 0.0 }, area: [-9.0, -9.0, 9.0, 9.0], texture: Box::new(fine) };
        let view = &render(Canvas { height: 32, width: 32 }, &[item], &[[0.0; 2]], &[Color::Red])[0][0];
        assert!(view.iter().all(|v| (0.1..0.9).contains(v)), "{:?}", &view[..32]);
    }
}
