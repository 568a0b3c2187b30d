//! Finds patches of one view again in other views, which shows the positions of their cameras.
//!
//! Between two cameras, content moves along the line that joins them. Patches are searched in both directions of the
//! picture at once. They are therefore found for any positions of the cameras, and for any stated depths.

use crate::LightField;
use crate::light_field::resize::{Fit, Resize};
use rayon::prelude::*;
use std::ops::Range;

/// Pixels along the longer side of the compared pictures.
const LONGEST: usize = 128;
/// Pixels from the middle of a patch to its edge, and along its side.
const HALF: usize = 3;
const SIDE: usize = 2 * HALF + 1;
/// Least distance of patches in pixels.
const PATCH_STEP_PX: usize = 6;
/// The largest number of patches.
const PATCHES: usize = 48;
/// Least mean square slope of a patch along its weaker direction, in square root of light. A weaker slope shows no
/// movement.
const SLOPE: f32 = 1e-4;
/// Pixels around its place in which a patch is searched, as a share of the shorter side.
const REACH: f64 = 0.3;
/// Differences over a patch as a share of its own variance, up to which it is found again, and above which it is
/// absent.
const ALIKE: f32 = 0.25;
const UNLIKE: f32 = 0.5;
/// Any other place must differ by at least this factor, and by at least this much more.
const UNIQUE: [f32; 2] = [2.0, 0.1];

/// A patch is alike in two opposite views if this share of its pixels differs from one of them by at most this share of
/// the patch's standard deviation.
const ONE_OF_TWO: [f32; 2] = [0.65, 0.12];

/// A small copy of a view, in square root of light.
pub(crate) type Small = Vec<f32>;

/// Small copies of views, and patches of one of them.
pub(crate) struct Patches {
    size: [usize; 2],
    /// Rows and columns that have light in any view.
    lit: [Range<usize>; 2],
    reach: i64,
    /// Pixels of the light field per pixel of the copies.
    pub scale: f64,
    center: Small,
    /// Middle (row, column) of each patch.
    at: Vec<[usize; 2]>,
}

/// The result of the search for a patch in another view.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Found {
    /// The patch moved by this number of pixels of the small copies (x, y).
    Moved([f64; 2]),
    /// Several places are alike.
    Anywhere,
    /// No place is alike.
    Nowhere,
}

impl Patches {
    /// Selects the patches of the view of this index. It returns `None` if the views are too small.
    pub(crate) fn of(field: &LightField, center: usize) -> Option<Self> {
        let longest = field.height.max(field.width);
        let times = longest.div_ceil(LONGEST).max(1);
        let size = [field.height, field.width].map(|n| n.div_ceil(times));
        let black = field.black();
        let inner = |before: usize, after: usize, n: usize| {
            let (first, last) = (before.div_ceil(times), n - after.div_ceil(times).min(n));
            // The resampling mixes margins into the picture.
            let first = if before > 0 { first + 2 } else { 0 };
            first..if after > 0 { last.saturating_sub(2) } else { last }
        };
        let lit = [inner(black.top, black.bottom, size[0]), inner(black.left, black.right, size[1])];
        let shorter = lit[0].len().min(lit[1].len());
        if shorter < 8 * HALF {
            return None;
        }
        let mut patches = Self {
            size,
            lit,
            reach: (REACH * shorter as f64) as i64,
            scale: times as f64,
            center: Vec::new(),
            at: Vec::new(),
        };
        patches.center = patches.small(field, center);
        patches.at = patches.textured();
        Some(patches)
    }

    /// Returns a small and softened copy of a view, in square root of light.
    pub(crate) fn small(&self, field: &LightField, view: usize) -> Small {
        let resize = Resize::new([field.height, field.width], self.size, Fit::Stretch);
        let mut sum = vec![0.0f32; self.size[0] * self.size[1]];
        for plane in &field.planes {
            sum.iter_mut().zip(resize.apply(&plane[view])).for_each(|(s, v)| *s += v);
        }
        let root: Vec<f32> = sum.into_iter().map(|v| v.max(0.0).sqrt()).collect();
        crate::depth::subpixel::soften(&root, self.size[0], self.size[1])
    }

    /// Returns the places at which the picture changes in every direction, with the clearest first.
    fn textured(&self) -> Vec<[usize; 2]> {
        let width = self.size[1];
        let brightest = self.center.iter().copied().fold(0.0, f32::max).max(f32::MIN_POSITIVE);
        let value = |y: usize, x: usize| self.center[y * width + x] / brightest;
        let weaker = |y: usize, x: usize| {
            let (mut xx, mut yy, mut xy) = (0.0, 0.0, 0.0);
            for j in y - HALF..=y + HALF {
                for i in x - HALF..=x + HALF {
                    let (dx, dy) = (value(j, i + 1) - value(j, i - 1), value(j + 1, i) - value(j - 1, i));
                    (xx, yy, xy) = (xx + dx * dx, yy + dy * dy, xy + dx * dy);
                }
            }
            let count = 4.0 * (SIDE * SIDE) as f32;
            0.5 * (xx + yy - ((xx - yy).powi(2) + 4.0 * xy * xy).sqrt()) / count
        };
        // Content near the edge leaves the picture from view to view.
        let inner = |range: &Range<usize>| {
            let margin = (range.len() / 8).max(HALF + 1);
            range.start + margin..range.end - margin
        };
        let columns = inner(&self.lit[1]);
        let mut all: Vec<(f32, [usize; 2])> = inner(&self.lit[0])
            .into_par_iter()
            .flat_map_iter(|y| columns.clone().map(move |x| (y, x)))
            .map(|(y, x)| (weaker(y, x), [y, x]))
            .filter(|(slope, _)| *slope > SLOPE)
            .collect();
        all.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        let mut kept: Vec<[usize; 2]> = Vec::new();
        for (_, [y, x]) in all {
            if kept.len() < PATCHES
                && kept.iter().all(|[j, i]| y.abs_diff(*j) >= PATCH_STEP_PX || x.abs_diff(*i) >= PATCH_STEP_PX)
            {
                kept.push([y, x]);
            }
        }
        kept
    }

    /// Returns the variance at the place of each patch in another view, divided by the patch's own variance.
    pub(crate) fn contrast(&self, field: &LightField, view: usize) -> Vec<f32> {
        let other = self.small(field, view);
        let variance = |values: &[f32], at: [usize; 2]| variance(&patch(values, self.size[1], at));
        self.at.iter().map(|at| variance(&other, *at) / variance(&self.center, *at)).collect()
    }

    /// Returns the number of patches.
    pub(crate) fn count(&self) -> usize {
        self.at.len()
    }

    /// Searches each patch in another view.
    pub(crate) fn found(&self, other: &Small) -> Vec<Found> {
        self.at.par_iter().map(|at| self.find(other, *at)).collect()
    }

    /// Returns true if a patch is alike in two opposite views that moved along x (0) or y (1), with each of its pixels
    /// in one of them. At the ends of surfaces, moving content covers other content, and the corners of both seem to
    /// move elsewhere.
    pub(crate) fn alike_along(&self, patch: usize, axis: usize, [there, opposite]: [&Small; 2]) -> bool {
        let ([y, x], width) = (self.at[patch], self.size[1]);
        let (at, step) = if axis == 0 { (x, 1) } else { (y, width) };
        let lit = &self.lit[1 - axis];
        let middle = y * width + x;
        let rows = || (0..SIDE).flat_map(|j| (0..SIDE).map(move |i| middle + j * width + i - HALF * (width + 1)));
        let count = (SIDE * SIDE) as f32;
        let mean = rows().map(|i| self.center[i]).sum::<f32>() / count;
        let variance = rows().map(|i| (self.center[i] - mean).powi(2)).sum::<f32>() / count;
        let tolerance = ONE_OF_TWO[1] * variance.sqrt();
        // The limit keeps every pixel inside the picture on both sides, in half pixels.
        let most = (at - lit.start - HALF).min(lit.end - 1 - HALF - at).min(self.reach as usize) as isize;
        let moved = |small: &Small, i: usize, half: isize| {
            let [a, b] = [half.div_euclid(2), half.div_euclid(2) + half.rem_euclid(2)];
            let value = |by: isize| small[i.saturating_add_signed(by * step as isize)];
            0.5 * (value(a) + value(b))
        };
        (-2 * most..=2 * most).any(|half| {
            let is_alike = |i: &usize| {
                let [a, b] = [moved(there, *i, half), moved(opposite, *i, -half)].map(|v| (v - self.center[*i]).abs());
                a.min(b) <= tolerance
            };
            rows().filter(is_alike).count() as f32 >= ONE_OF_TWO[0] * count
        })
    }

    fn find(&self, other: &[f32], [y, x]: [usize; 2]) -> Found {
        let width = self.size[1];
        let own = patch(&self.center, width, [y, x]);
        let variance = variance(&own);
        let range = |at: usize, lit: &Range<usize>| {
            let (first, last) = ((lit.start + HALF) as i64, (lit.end - HALF) as i64 - 1);
            (at as i64 - self.reach).max(first)..=(at as i64 + self.reach).min(last)
        };
        let (rows, columns) = (range(y, &self.lit[0]), range(x, &self.lit[1]));
        let wide = (columns.end() - columns.start() + 1) as usize;
        let mut costs = Vec::with_capacity(wide * wide);
        for j in rows.clone() {
            for i in columns.clone() {
                let there = patch(other, width, [j as usize, i as usize]);
                costs.push(own.iter().zip(&there).map(|(a, b)| (a - b) * (a - b)).sum::<f32>() / variance);
            }
        }
        let Some(best) = (0..costs.len()).min_by(|&a, &b| costs[a].total_cmp(&costs[b])) else {
            return Found::Nowhere;
        };
        let (row, column) = (best / wide, best % wide);
        let away = |k: usize| (k / wide).abs_diff(row).max((k % wide).abs_diff(column)) > 2;
        let second = (0..costs.len()).filter(|k| away(*k)).map(|k| costs[k]).fold(f32::INFINITY, f32::min);
        match costs[best] {
            cost if cost > UNLIKE => Found::Nowhere,
            cost if cost > ALIKE || second < (UNIQUE[0] * cost).max(cost + UNIQUE[1]) => Found::Anywhere,
            _ => {
                let between = |step: usize, at: usize, n: usize| {
                    let ends = at > 0 && at + 1 < n;
                    let line = [best - step * usize::from(ends), best, best + step * usize::from(ends)];
                    if ends { crate::depth::sweep::lowest(&line.map(|k| costs[k]), 1) } else { 0.0 }
                };
                let down = row as f64 + *rows.start() as f64 - y as f64 + between(wide, row, costs.len() / wide);
                let right = column as f64 + *columns.start() as f64 - x as f64 + between(1, column, wide);
                Found::Moved([right, down])
            }
        }
    }
}

/// Returns the pixels around a place.
fn patch(values: &[f32], width: usize, [y, x]: [usize; 2]) -> [f32; SIDE * SIDE] {
    let mut patch = [0.0; SIDE * SIDE];
    for (row, out) in patch.chunks_exact_mut(SIDE).enumerate() {
        out.copy_from_slice(&values[(y + row - HALF) * width + x - HALF..][..SIDE]);
    }
    patch
}

/// Returns the variance of a patch times its number of pixels.
fn variance(patch: &[f32]) -> f32 {
    let mean = patch.iter().sum::<f32>() / patch.len() as f32;
    patch.iter().map(|v| (v - mean).powi(2)).sum::<f32>().max(f32::MIN_POSITIVE)
}
