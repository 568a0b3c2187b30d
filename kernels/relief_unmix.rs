//! Continues a picture beyond its frame, and removes the near side's color from pixels on the far rim of a tear, where
//! pictures are smooth and maps are not.
//!
//! The removed share becomes a piece of the near surface that covers the same share of the pixel, which is its fringe.
//! The picture from the center stays the same.

use crate::relief::{ABSENT, AROUND, Args, COLORS, color};
use crate::relief_jump::{HERE, NOWHERE};
use rayon::prelude::*;

/// Values of a pixel in a fringe, which are the disparity, the covered share of the pixel and the colors. The first two
/// are planes.
pub const VALUES: usize = 2 + COLORS;

/// Writes the surface `front` and its `fringe` from the colors (height, width, color) and the disparities (height,
/// width) of a picture. `nearest` becomes the start of [`relief_jump`](crate::relief_jump::relief_jump).
pub fn relief_unmix(
    args: &Args,
    colors: &[f32],
    disparity: &[f32],
    front: &mut [f32],
    fringe: &mut [f32],
    nearest: &mut [u32],
) {
    let plane = args.plane as usize;
    let (depths, pure) = front.split_at_mut(plane);
    let source = Mirrored::new(args, colors, disparity, depths);
    let (levels, rest) = fringe.split_at_mut(plane);
    let (shares, near) = rest.split_at_mut(plane);
    let (any, own) = nearest.split_at_mut(plane);
    let surface = pure.par_chunks_exact_mut(COLORS);
    let mixed = levels.par_iter_mut().zip(shares).zip(near.par_chunks_exact_mut(COLORS));
    let rims = any.par_iter_mut().zip(own);
    surface.zip(mixed).zip(rims).take(args.pixels()).enumerate().for_each(|(p, ((surface, mixed), rims))| {
        let (x, y) = args.place(p);
        let nearest = source.disparity[p] + args.tear;
        let rises = |&(dx, dy): &(i64, i64)| args.at(x + dx, y + dy).filter(|&q| source.disparity[q] > nearest);
        let rise = AROUND.iter().find_map(|d| Some((*d, rises(d)?)));
        let found = rise.and_then(|(along, near)| source.fringe(p, along, near));
        let ((level, share), color) = mixed;
        (*level, *share) = found.map_or((ABSENT, 0.0), |found| (found.level, found.share));
        color.copy_from_slice(&found.map_or([0.0; COLORS], |found| found.front));
        surface.copy_from_slice(&found.map_or_else(|| source.color(p), |found| found.back));
        (*rims.0, *rims.1) = (if rise.is_some() { HERE } else { NOWHERE }, NOWHERE);
    });
}

/// A picture that is continued by mirroring.
struct Mirrored<'a> {
    args: &'a Args,
    colors: &'a [f32],
    /// The disparities of the continued picture.
    disparity: &'a [f32],
    /// The columns and rows of the picture itself.
    columns: Vec<usize>,
    rows: Vec<usize>,
}

/// The near part of a pixel.
#[derive(Clone, Copy)]
struct Fringe {
    level: f32,
    share: f32,
    front: [f32; COLORS],
    /// The color of the other part.
    back: [f32; COLORS],
}

impl<'a> Mirrored<'a> {
    /// Continues a picture, and writes its disparities.
    fn new(args: &'a Args, colors: &'a [f32], disparity: &[f32], depths: &'a mut [f32]) -> Self {
        let mirror = |at: usize, length: u32| {
            let period = 2 * i64::from(length);
            let at = (at as i64 - i64::from(args.pad)).rem_euclid(period);
            at.min(period - 1 - at) as usize
        };
        let [tall, wide] = args.size();
        let columns: Vec<usize> = (0..wide).map(|x| mirror(x, args.width)).collect();
        let rows: Vec<usize> = (0..tall).map(|y| mirror(y, args.height) * args.width as usize).collect();
        depths.par_chunks_mut(wide).zip(&rows).for_each(|(line, row)| {
            line.iter_mut().zip(&columns).for_each(|(to, column)| *to = disparity[row + column]);
        });
        Self { args, colors, disparity: depths, columns, rows }
    }

    fn color(&self, pixel: usize) -> [f32; COLORS] {
        let wide = self.columns.len();
        color(self.colors, self.rows[pixel / wide] + self.columns[pixel % wide])
    }

    /// Returns the near part of a pixel whose neighbor `near`, in this direction, is on the near side of a tear.
    fn fringe(&self, p: usize, (dx, dy): (i64, i64), near: usize) -> Option<Fringe> {
        let (args, (x, y)) = (self.args, self.args.place(p));
        let (here, level) = (self.disparity[p], self.disparity[near]);
        let alike = |q: &usize, depth: f32| (self.disparity[*q] - depth).abs() <= args.tear;
        // Pure colors are one pixel further in, and two pixels further out.
        let front = self.color(args.at(x + 2 * dx, y + 2 * dy).filter(|q| alike(q, level)).unwrap_or(near));
        let clean = |k: i64| args.at(x - k * dx, y - k * dy).filter(|q| alike(q, here));
        let back = self.color(clean(2).or_else(|| clean(1))?);
        let color = self.color(p);
        // This color is approximated by back + share (front - back).
        let (mut dot, mut norm) = (0.0, 0.0);
        for k in 0..COLORS {
            dot += (color[k] - back[k]) * (front[k] - back[k]);
            norm += (front[k] - back[k]) * (front[k] - back[k]);
        }
        // Less than half of the pixel is near, because otherwise the map would show that. The color must also be such a
        // mixture, which excludes texture.
        let share = (dot / norm.max(1e-6)).min(0.6);
        let rest = |k: usize| color[k] - back[k] - share * (front[k] - back[k]);
        let strange: f32 = (0..COLORS).map(|k| rest(k) * rest(k)).sum();
        let mixed = share >= 0.03 && strange <= 0.05 * share * share * norm;
        mixed.then_some(Fringe { level, share, front, back })
    }
}
