//! Draws the projected splats of one view, tile by tile and front to back.
//!
//! A splat is a Gaussian of constant color in the picture. Every pixel takes the splats of its tile in their order. It
//! stops as soon as it is opaque. 3D Gaussian splatting has the same rules (Kerbl et al. 2023).

use bytemuck::{Pod, Zeroable};
use rayon::prelude::*;

/// Rows, and columns, of a tile in pixels.
pub const SIDE: u32 = 16;
/// The smallest opacity at a pixel that is drawn.
pub const FAINTEST: f32 = 1.0 / 255.0;
/// The largest opacity at a pixel.
pub const OPAQUE: f32 = 0.99;
/// A pixel is opaque when its transmittance would fall below this value.
pub const CLOSED: f32 = 1e-4;
/// Values of a pixel in the output, which are three colors, the inverse distance and the coverage.
pub const VALUES: usize = 5;

/// Added to a number of small magnitude, it leaves the nearest integer in the low bits.
pub const ROUND: f32 = 12_582_912.0;
/// The series of 2^x at 0, after the 1. The remainder is 1.2e-7 for a magnitude up to 0.5.
pub const EXP: [f32; 6] =
    [std::f32::consts::LN_2, 0.240_226_5, 0.055_504_11, 0.009_618_129, 0.001_333_355_8, 1.540_353e-4];

/// Pixels along a tile.
const N: usize = SIDE as usize;
/// Pixels of a row that are computed together.
pub const LANES: usize = 8;
/// Groups of pixels in a tile that are computed together.
const GROUPS: usize = N * N / LANES;
/// Values of all pixels of a tile, row by row.
type Tile = [[f32; LANES]; GROUPS];
/// Words of 4 bytes of a splat.
pub const WORDS: usize = size_of::<Splat>() / 4;
/// Splats that are read together. Then the tile may be completely opaque.
const CHECKED: usize = 16;

/// Size of the picture.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
pub struct Args {
    /// Number of pixel rows.
    pub height: u32,
    /// Number of pixel columns.
    pub width: u32,
    /// Tiles along a row.
    pub across: u32,
}

impl Args {
    /// Returns the arguments for a picture of this size.
    pub fn new(height: usize, width: usize) -> Self {
        Self { height: height as u32, width: width as u32, across: (width as u32).div_ceil(SIDE) }
    }

    /// Returns the number of tiles.
    pub fn tiles(&self) -> usize {
        (self.across * self.height.div_ceil(SIDE)) as usize
    }
}

/// One splat in a view.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, PartialEq, Pod, Zeroable)]
pub struct Splat {
    /// Center in pixels, with x to the right. The middle of the first pixel is 0.
    pub x: f32,
    /// Center in pixels downwards.
    pub y: f32,
    /// The inverse of the covariance (xx, xy, yy) per square pixel.
    pub conic: [f32; 3],
    /// Opacity at the center.
    pub opacity: f32,
    /// Color in the transfer function of the splats.
    pub color: [f32; 3],
    /// Inverse of the distance along the optical axis.
    pub inverse: f32,
    /// First column in the low 16 bits, and the column after the last one in the high bits.
    pub columns: u32,
    /// First row, and the row after the last one.
    pub rows: u32,
}

impl Splat {
    /// Returns the first pixel and the pixel after the last one along an axis.
    fn ends(span: u32) -> [usize; 2] {
        [span & 0xffff, span >> 16].map(|n| n as usize)
    }

    /// Returns the tiles that the splat touches, row by row.
    pub fn tiles(&self, across: u32) -> impl Iterator<Item = usize> + use<> {
        let [[left, right], [top, bottom]] = [self.columns, self.rows].map(Self::ends);
        let along = move |first: usize, end: usize| first / N..end.div_ceil(N);
        let columns = along(left, right);
        along(top, bottom).flat_map(move |row| columns.clone().map(move |column| row * across as usize + column))
    }
}

/// Draws a picture. `first` has the place of the first entry of each tile and the number of entries. `entries` has the
/// indices of splats, with the nearest first. `picture` has [`VALUES`] planes of pixels.
pub fn draw_splats(args: &Args, splats: &[Splat], first: &[u32], entries: &[u32], picture: &mut [f32]) {
    let (height, width, across) = (args.height as usize, args.width as usize, args.across as usize);
    let mut strips: Vec<Vec<&mut [f32]>> = (0..height.div_ceil(N)).map(|_| Vec::with_capacity(VALUES)).collect();
    for plane in picture.chunks_mut((height * width).max(1)).take(VALUES) {
        for (strip, rows) in strips.iter_mut().zip(plane.chunks_mut((N * width).max(1))) {
            strip.push(rows);
        }
    }
    strips.par_iter_mut().enumerate().for_each(|(row, planes)| {
        for column in 0..across {
            let tile = row * across + column;
            let list = &entries[first[tile] as usize..first[tile + 1] as usize];
            let drawn = crate::simd(
                #[inline(always)]
                || draw_tile(splats, list, [column * N, row * N]),
            );
            let (left, wide) = (column * N, N.min(width - column * N));
            for (plane, values) in planes.iter_mut().zip(&drawn) {
                for (line, values) in plane.chunks_mut(width).zip(values.as_flattened().chunks(N)) {
                    line[left..left + wide].copy_from_slice(&values[..wide]);
                }
            }
        }
    });
}

/// Draws a tile whose first pixel is at (`left`, `top`).
#[inline(always)]
fn draw_tile(splats: &[Splat], list: &[u32], [left, top]: [usize; 2]) -> [Tile; VALUES] {
    let mut drawn = [[[0.0; LANES]; GROUPS]; VALUES];
    // The transmittance, and 1 for pixels that are not opaque yet.
    let mut clear = [[1.0f32; LANES]; GROUPS];
    let mut open = [[1.0f32; LANES]; GROUPS];
    let mut some = [Splat::default(); CHECKED];
    for entries in list.chunks(CHECKED) {
        if open.iter().all(|group| *group == [0.0; LANES]) {
            break;
        }
        // They are read together, so that the memory's delays are not waited for in turn.
        some.iter_mut().zip(entries).for_each(|(splat, entry)| *splat = splats[*entry as usize]);
        for splat in &some[..entries.len()] {
            let inside = |span: u32, from: usize| Splat::ends(span).map(|end| end.clamp(from, from + N) - from);
            let ([x0, x1], [y0, y1]) = (inside(splat.columns, left), inside(splat.rows, top));
            let values = [splat.color[0], splat.color[1], splat.color[2], splat.inverse, 1.0];
            for y in y0..y1 {
                let dy = (top + y) as f32 - splat.y;
                for x in (x0 / LANES * LANES..x1).step_by(LANES) {
                    let group = (y * N + x) / LANES;
                    let share = shares(splat, [(left + x) as f32, dy], &mut clear[group], &mut open[group]);
                    for (plane, value) in drawn.iter_mut().zip(values) {
                        plane[group].iter_mut().zip(share).for_each(|(sum, share)| *sum += share * value);
                    }
                }
            }
        }
    }
    drawn
}

/// Returns the share of a splat in the light of pixels in a row, and takes it from their transmittance. The first pixel
/// is in column `x`, and the row is `dy` below the splat's center. All lengths are constant, so that the compiler uses
/// vectors.
#[inline(always)]
fn shares(splat: &Splat, [x, dy]: [f32; 2], clear: &mut [f32; LANES], open: &mut [f32; LANES]) -> [f32; LANES] {
    let [a, b, c] = splat.conic;
    let mut share = [0.0; LANES];
    for i in 0..LANES {
        let dx = x + i as f32 - splat.x;
        let power = -0.5 * (a * dx * dx + c * dy * dy) - b * dx * dy;
        let alpha = (splat.opacity * exp(power)).min(OPAQUE);
        let seen = alpha >= FAINTEST && power <= 0.0;
        let alpha = if seen { alpha * open[i] } else { 0.0 };
        let next = clear[i] * (1.0 - alpha);
        let closes = next < CLOSED;
        share[i] = if closes { 0.0 } else { alpha * clear[i] };
        clear[i] = if closes { clear[i] } else { next };
        open[i] = if closes { 0.0 } else { open[i] };
    }
    share
}

/// Returns the exponential of a number from -80 to 0. It is the same series in the shader.
#[inline(always)]
fn exp(power: f32) -> f32 {
    let turns = (power * std::f32::consts::LOG2_E).max(-120.0);
    let rounded = turns + ROUND;
    let rest = turns - (rounded - ROUND);
    let [c1, c2, c3, c4, c5, c6] = EXP;
    let series = 1.0 + rest * (c1 + rest * (c2 + rest * (c3 + rest * (c4 + rest * (c5 + rest * c6)))));
    series * f32::from_bits((rounded.to_bits() << 23).wrapping_add(0x3f80_0000))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_exponential_is_that_of_float64() {
        for i in 0..=8000 {
            let power = -(i as f32) * 0.01;
            let exact = f64::from(power).exp();
            assert!((f64::from(exp(power)) / exact - 1.0).abs() < 1e-5, "{power}");
            assert!(power < -8.0 || (f64::from(exp(power)) / exact - 1.0).abs() < 1.5e-6, "{power}");
        }
    }

    /// Two splats of a known opacity, whose pixels are computed by hand.
    #[test]
    fn a_pixel_is_the_sum_of_its_splats_by_their_transmittance() {
        let args = Args::new(17, 18);
        let one = |x: f32, opacity: f32, color: [f32; 3], inverse: f32| Splat {
            x,
            y: 8.0,
            conic: [0.5, 0.0, 0.5],
            opacity,
            color,
            inverse,
            columns: 18 << 16,
            rows: 17 << 16,
        };
        let splats = [one(8.0, 0.5, [1.0, 0.0, 0.0], 0.5), one(9.0, 0.8, [0.0, 1.0, 0.0], 0.25)];
        assert_eq!((args.tiles(), splats[0].tiles(args.across).count()), (4, 4));
        let (first, entries) = ([0, 2, 4, 6, 8], [0, 1].repeat(4));
        let mut picture = vec![9.0; VALUES * 17 * 18];
        draw_splats(&args, &splats, &first, &entries, &mut picture);
        let at = |plane: usize, y: usize, x: usize| f64::from(picture[(plane * 17 + y) * 18 + x]);
        // At (8, 8) the nearer one has 0.5, and the farther one 0.8 exp(-0.25) of the remaining half.
        let (near, far) = (0.5, 0.5 * 0.8 * (-0.25f64).exp());
        for (value, exact) in [(0, near), (1, far), (2, 0.0), (3, 0.5 * near + 0.25 * far), (4, near + far)] {
            assert!((at(value, 8, 8) - exact).abs() < 1e-6, "{value}: {} {exact}", at(value, 8, 8));
        }
        // In the next tile, at (16, 17), both are below 1 / 255.
        assert!((0..VALUES).all(|plane| at(plane, 16, 17) == 0.0));
        // The fainter one ends where its opacity falls below 1 / 255, at a distance of sqrt(4 ln(127.5)) = 4.4 pixels.
        assert!(at(0, 8, 4) > 0.0 && at(0, 8, 3) == 0.0);
    }

    /// A pixel with a transmittance that would fall below 1e-4 takes no further splat.
    #[test]
    fn an_opaque_pixel_is_closed() {
        let args = Args::new(1, 1);
        let middle = Splat { conic: [1.0, 0.0, 1.0], columns: 1 << 16, rows: 1 << 16, ..Splat::default() };
        let splats = [(1.0, 0.5), (0.95, 0.25), (0.9, 0.125), (0.01, 8.0)].map(|(opacity, color)| Splat {
            opacity,
            color: [color; 3],
            ..middle
        });
        let mut picture = vec![0.0; VALUES];
        draw_splats(&args, &splats, &[0, 4], &[0, 1, 2, 3], &mut picture);
        // The opacity is at most 0.99, so the second leaves 5e-4 of the light. The third would leave 5e-5, which closes
        // the pixel. The fourth would leave more than 1e-4, and is not seen because the pixel is closed.
        let exact = 0.99f32 * 0.5 + 0.01 * 0.95 * 0.25;
        assert!((picture[0] - exact).abs() < 1e-6, "{} {exact}", picture[0]);
        assert!(picture[4] < 1.0);
    }
}
