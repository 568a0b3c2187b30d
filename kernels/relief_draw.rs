//! Draws a view of a relief, from near to far.

use crate::relief::{ABSENT, Args, COLORS, color};
use crate::relief_surfaces::Surfaces;
use rayon::prelude::*;

/// The factor by which pieces are larger, because they do not tile exactly where a surface bends both ways.
pub const LARGER: f32 = 1.01;
/// The farthest columns or rows between a pixel and a piece that covers it, in the view. A piece covers one pixel, and
/// its edges differ from its middle by half of a tear, which opens [`TEAR`](crate::relief::TEAR) pixels at most.
pub const NEAR: f32 = 1.8;
/// The most pieces of a pixel and a level of disparity that the shader draws, which are the nearest ones. They cover the
/// pixel several times, except if a map consists of noise.
pub const PIECES: u32 = 16;

/// The piece of surface of one pixel.
#[derive(Clone, Copy)]
pub struct Piece {
    x: f32,
    y: f32,
    disparity: f32,
    /// Disparities of its left, right, upper and lower edge.
    edges: [f32; 4],
    /// Covered share of its area.
    opacity: f32,
    color: [f32; COLORS],
}

/// The light and the coverage of a pixel of a view by the pieces until now.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Pixel {
    /// Sum of the colors, in proportion to the coverage.
    pub color: [f32; COLORS],
    /// Covered share of the pixel.
    pub covered: f32,
    /// Disparity, in proportion to the coverage.
    pub depth: f32,
}

/// Returns the pieces of a relief, from near to far.
pub fn pieces(surfaces: &Surfaces) -> Vec<Piece> {
    let Surfaces { args, front, fringe, hidden } = surfaces;
    let plane = args.plane as usize;
    let mixed = |p: usize| {
        let (level, opacity) = (fringe[p], fringe[plane + p]);
        let [x, y] = args.picture_place(p);
        (level > ABSENT).then(|| Piece {
            x,
            y,
            disparity: level,
            edges: [level; 4],
            opacity,
            color: color(&fringe[2 * plane..], p),
        })
    };
    let mut pieces: Vec<Piece> = (0..args.pixels()).into_par_iter().filter_map(mixed).collect();
    let surface = |p: usize| cut(args, |q| front[q], &front[plane..], p);
    pieces.par_extend((0..args.pixels()).into_par_iter().map(surface));
    // The far layer is the picture where nothing is in front, and its continuation behind content in front.
    let far = |q: usize| if hidden[q] > ABSENT { hidden[q] } else { front[q] };
    let behind = |p: usize| (hidden[p] > ABSENT).then(|| cut(args, far, &hidden[plane..], p));
    pieces.par_extend((0..args.pixels()).into_par_iter().filter_map(behind));
    from_near_to_far(&pieces)
}

/// Cuts a pixel of a surface into a piece, which is joined to its neighbors.
fn cut(args: &Args, disparity: impl Fn(usize) -> f32, colors: &[f32], p: usize) -> Piece {
    let (x, y) = args.place(p);
    let here = disparity(p);
    let edge = |(dx, dy): (i64, i64)| {
        let joined = args.at(x + dx, y + dy).map(&disparity).filter(|there| (there - here).abs() <= args.tear);
        joined.map_or(here, |there| 0.5 * (there + here))
    };
    let edges = [(-1, 0), (1, 0), (0, -1), (0, 1)].map(edge);
    let [x, y] = args.picture_place(p);
    Piece { x, y, disparity: here, edges, opacity: 1.0, color: color(colors, p) }
}

/// Sorts pieces from near to far. Pieces of one depth stay in their order.
fn from_near_to_far(pieces: &[Piece]) -> Vec<Piece> {
    // The bits have the order of `f32::total_cmp`. Numbers are shorter than pieces, and so they sort faster.
    let key = |disparity: f32| {
        let bits = disparity.to_bits();
        if bits >> 31 == 0 { !(bits | 1 << 31) } else { bits }
    };
    let number = |(i, piece): (usize, &Piece)| u64::from(key(piece.disparity)) << 32 | i as u64;
    let mut order: Vec<u64> = pieces.par_iter().enumerate().map(number).collect();
    order.par_sort_unstable();
    order.par_iter().map(|number| pieces[*number as u32 as usize]).collect()
}

/// Draws the view from `u` columns and `v` rows of views from the center, with (height, width) pixels.
pub fn relief_draw(args: &Args, pieces: &[Piece], [u, v]: [f32; 2]) -> Vec<Pixel> {
    let (h, w) = (args.height as usize, args.width as usize);
    let mut pixels = vec![Pixel::default(); h * w];
    for piece in pieces {
        let left = (piece.x - u * piece.edges[0]).max(0.0);
        let right = (piece.x + 1.0 - u * piece.edges[1]).min(w as f32);
        let top = (piece.y - v * piece.edges[2]).max(0.0);
        let bottom = (piece.y + 1.0 - v * piece.edges[3]).min(h as f32);
        if right <= left || bottom <= top {
            continue;
        }
        for j in top as usize..(bottom.ceil() as usize).min(h) {
            let tall = bottom.min(j as f32 + 1.0) - top.max(j as f32);
            let row = &mut pixels[j * w..(j + 1) * w];
            for (i, pixel) in row.iter_mut().enumerate().take(right.ceil() as usize).skip(left as usize) {
                let free = 1.0 - pixel.covered;
                if free <= 0.0 {
                    continue;
                }
                let area = tall * (right.min(i as f32 + 1.0) - left.max(i as f32)) * piece.opacity;
                let share = (area * LARGER).min(free);
                pixel.covered += share;
                pixel.depth += share * piece.disparity;
                pixel.color.iter_mut().zip(piece.color).for_each(|(c, k)| *c += share * k);
            }
        }
    }
    pixels
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Numbers of all signs, with equal ones in their order.
    #[test]
    fn pieces_come_from_near_to_far() {
        let disparities = [0.5, -0.0, 2.0, -3.0, 0.0, 2.0, -0.25, f32::INFINITY];
        let piece = |(i, disparity): (usize, &f32)| Piece {
            x: i as f32,
            y: 0.0,
            disparity: *disparity,
            edges: [0.0; 4],
            opacity: 1.0,
            color: [0.0; COLORS],
        };
        let pieces: Vec<Piece> = disparities.iter().enumerate().map(piece).collect();
        let mut wanted = pieces.clone();
        wanted.sort_by(|a, b| b.disparity.total_cmp(&a.disparity));
        let places = |pieces: &[Piece]| pieces.iter().map(|piece| piece.x).collect::<Vec<_>>();
        assert_eq!(places(&from_near_to_far(&pieces)), places(&wanted));
        assert_eq!(places(&wanted), [7.0, 2.0, 5.0, 0.0, 4.0, 1.0, 6.0, 3.0]);
    }
}
