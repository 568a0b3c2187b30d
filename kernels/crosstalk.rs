//! Applies the crosstalk between pixels along one axis after the other (OPTICS 10). The phase of each sub-pixel is a
//! sum over the drives of the pixels around it. The sub-pixels at the same place in all pixels form a plane. A plane
//! follows from the pixels by an ordinary convolution with its own weights. One frame.

use crate::{modulate, simd};
use bytemuck::{Pod, Zeroable};
use rayon::prelude::*;

/// Reach of the crosstalk.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
pub struct Args {
    /// Position of the SLM in the grid. A line that moves past the edge of the grid enters on the other side. Nothing
    /// is driven around the SLM.
    pub place: modulate::Args,
    /// Sub-pixels of a pixel along an axis.
    pub subpixels: u32,
    /// Reach of the crosstalk in pixels along y, at most half the grid.
    pub reach_y: u32,
    /// Reach of the crosstalk in pixels along x, at most half the grid.
    pub reach_x: u32,
}

impl Args {
    /// Splits the weights into those along y and those along x. Each sub-pixel has one weight per pixel, from the pixel
    /// `reach` before it to the pixel `reach` after it.
    pub fn weights<'a>(&self, weights: &'a [f32]) -> [&'a [f32]; 2] {
        weights.split_at((self.subpixels * (2 * self.reach_y + 1)) as usize).into()
    }
}

/// Rows that a thread computes at once.
const ROWS: usize = 32;
/// Neighboring values that are summed together.
const LANES: usize = 64;

/// Returns the index of the pixel `offset` from the first, on a grid of `whole` points that wraps. `count` pixels begin
/// at the point `first`. Returns `None` if the point is not a pixel.
#[inline(always)]
fn place(offset: isize, [first, count, whole]: [u32; 3]) -> Option<usize> {
    let at = (offset + first as isize).rem_euclid(whole as isize) - first as isize;
    (0..count as isize).contains(&at).then_some(at as usize)
}

/// Adds `weight` times `line` to `out`, which has the same length.
#[inline(always)]
fn add(out: &mut [f32], weight: f32, line: &[f32]) {
    out.iter_mut().zip(line).for_each(|(o, v)| *o += weight * v);
}

/// Sums `lines[i]` times `weights[i]` into `out`, `LANES` values at a time.
#[inline(always)]
fn sum<'a>(out: &mut [f32], adds: bool, lines: impl Iterator<Item = (f32, &'a [f32])> + Clone) {
    for (block, out) in out.chunks_mut(LANES).enumerate() {
        let (from, count) = (block * LANES, out.len());
        let mut lanes = [0.0f32; LANES];
        if adds {
            lanes[..count].copy_from_slice(out);
        }
        for (weight, line) in lines.clone() {
            match line[from..][..count].first_chunk::<LANES>() {
                Some(line) => add(&mut lanes, weight, line),
                None => add(&mut lanes[..count], weight, &line[from..][..count]),
            }
        }
        out.copy_from_slice(&lanes[..count]);
    }
}

/// Applies the crosstalk along rows, from `pixels` (height, width) to `planes` (subpixels, height, width).
pub fn rows(args: &Args, weights: &[f32], pixels: &[f32], planes: &mut [f32]) {
    let count = (args.place.height * args.place.width) as usize;
    for (plane, weights) in planes.chunks_exact_mut(count).zip(weights.chunks_exact(2 * args.reach_x as usize + 1)) {
        along_rows(args, weights.iter().copied(), pixels, plane, false);
    }
}

/// Applies the transpose of [`rows`].
pub fn rows_back(args: &Args, weights: &[f32], planes: &[f32], pixels: &mut [f32]) {
    let count = (args.place.height * args.place.width) as usize;
    let all = planes.chunks_exact(count).zip(weights.chunks_exact(2 * args.reach_x as usize + 1));
    for (i, (plane, weights)) in all.enumerate() {
        along_rows(args, weights.iter().rev().copied(), plane, pixels, i > 0);
    }
}

fn along_rows(
    args: &Args,
    weights: impl Iterator<Item = f32> + Clone + Sync,
    from: &[f32],
    to: &mut [f32],
    adds: bool,
) {
    let (width, reach) = (args.place.width as usize, args.reach_x as usize);
    let side = [args.place.left, args.place.width, args.place.grid_width];
    to.par_chunks_mut(width * ROWS).zip(from.par_chunks(width * ROWS)).for_each(|(to, from)| {
        let mut line = vec![0.0; width + 2 * reach];
        simd(
            #[inline(always)]
            || {
                for (to, from) in to.chunks_exact_mut(width).zip(from.chunks_exact(width)) {
                    line[reach..][..width].copy_from_slice(from);
                    for i in 0..reach {
                        let value = |offset: isize| place(offset, side).map_or(0.0, |at| from[at]);
                        line[i] = value(i as isize - reach as isize);
                        line[reach + width + i] = value((width + i) as isize);
                    }
                    sum(to, adds, weights.clone().enumerate().map(|(j, weight)| (weight, &line[j..][..width])));
                }
            },
        );
    });
}

/// Applies the crosstalk along columns, from `planes` (subpixels, height, width) to `wave` (subpixels, subpixels,
/// height, width). The planes are ordered by their place along x, and `wave` by the place along y, then x.
pub fn columns(args: &Args, weights: &[f32], planes: &[f32], wave: &mut [f32]) {
    let (count, p) = ((args.place.height * args.place.width) as usize, args.subpixels as usize);
    let taps = 2 * args.reach_y as usize + 1;
    for (i, to) in wave.chunks_exact_mut(count).enumerate() {
        let weights = &weights[i / p * taps..][..taps];
        along_columns(args, weights.iter().copied(), &planes[i % p * count..][..count], to, false);
    }
}

/// Applies the transpose of [`columns`].
pub fn columns_back(args: &Args, weights: &[f32], wave: &[f32], planes: &mut [f32]) {
    let (count, p) = ((args.place.height * args.place.width) as usize, args.subpixels as usize);
    let taps = 2 * args.reach_y as usize + 1;
    for (i, from) in wave.chunks_exact(count).enumerate() {
        let weights = &weights[i / p * taps..][..taps];
        along_columns(args, weights.iter().rev().copied(), from, &mut planes[i % p * count..][..count], i >= p);
    }
}

fn along_columns(
    args: &Args,
    weights: impl Iterator<Item = f32> + Clone + Sync,
    from: &[f32],
    to: &mut [f32],
    adds: bool,
) {
    let (width, reach) = (args.place.width as usize, args.reach_y as isize);
    let side = [args.place.top, args.place.height, args.place.grid_height];
    to.par_chunks_mut(width * ROWS).enumerate().for_each(|(part, to)| {
        let mut lines: Vec<(f32, &[f32])> = Vec::with_capacity(2 * reach as usize + 1);
        simd(
            #[inline(always)]
            || {
                for (y, to) in to.chunks_exact_mut(width).enumerate() {
                    let first = (part * ROWS + y) as isize - reach;
                    lines.clear();
                    lines.extend(weights.clone().enumerate().filter_map(|(j, weight)| {
                        place(first + j as isize, side).map(|row| (weight, &from[row * width..][..width]))
                    }));
                    sum(to, adds, lines.iter().copied());
                }
            },
        );
    });
}
