//! Crosstalk between pixels, along one axis after the other: each sub-pixel's phase is a sum over the drives of the pixels
//! around it (OPTICS 10). The sub-pixels of all pixels that lie at one place in them are a plane; a plane follows from the pixels
//! by an ordinary convolution, with weights of its own. One frame.

use crate::{modulate, simd};
use bytemuck::{Pod, Zeroable};
use rayon::prelude::*;

/// How far crosstalk reaches.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
pub struct Args {
    /// Where the SLM lies in the grid: what is moved over the grid's edge comes in on the other side, and around the SLM
    /// nothing is driven.
    pub place: modulate::Args,
    /// Sub-pixels of a pixel along an axis.
    pub subpixels: u32,
    /// Pixels that crosstalk reaches along y, at most half the grid,
    pub reach_y: u32,
    /// and along x.
    pub reach_x: u32,
}

impl Args {
    /// Weights along y, then along x: of each sub-pixel from the pixel `reach` before it to that behind it.
    pub fn weights<'a>(&self, weights: &'a [f32]) -> [&'a [f32]; 2] {
        weights.split_at((self.subpixels * (2 * self.reach_y + 1)) as usize).into()
    }
}

/// Rows that a thread takes at once.
const ROWS: usize = 32;
/// Values that are summed side by side.
const LANES: usize = 64;

/// Place among `count` pixels, which begin at `first` of a grid of `whole`, of the one `offset` from the first; none around
/// them.
#[inline(always)]
fn place(offset: isize, [first, count, whole]: [u32; 3]) -> Option<usize> {
    let at = (offset + first as isize).rem_euclid(whole as isize) - first as isize;
    (0..count as isize).contains(&at).then_some(at as usize)
}

/// `out += weight line`, over the same values.
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

/// Along rows: `pixels` (height, width) to `planes` (subpixels, height, width).
pub fn rows(args: &Args, weights: &[f32], pixels: &[f32], planes: &mut [f32]) {
    let count = (args.place.height * args.place.width) as usize;
    for (plane, weights) in planes.chunks_exact_mut(count).zip(weights.chunks_exact(2 * args.reach_x as usize + 1)) {
        along_rows(args, weights.iter().copied(), pixels, plane, false);
    }
}

/// The same transposed.
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

/// Along columns: `planes` (subpixels, height, width), by their place along x, to `wave` (subpixels, subpixels, height,
/// width), by that along y and along x.
pub fn columns(args: &Args, weights: &[f32], planes: &[f32], wave: &mut [f32]) {
    let (count, p) = ((args.place.height * args.place.width) as usize, args.subpixels as usize);
    let taps = 2 * args.reach_y as usize + 1;
    for (i, to) in wave.chunks_exact_mut(count).enumerate() {
        let weights = &weights[i / p * taps..][..taps];
        along_columns(args, weights.iter().copied(), &planes[i % p * count..][..count], to, false);
    }
}

/// The same transposed.
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
