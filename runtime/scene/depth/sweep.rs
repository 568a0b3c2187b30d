//! Sweeps planes over the views of a row and a column of the grid.
//!
//! Semi-global matching (Hirschmueller, IEEE PAMI 30, 2008) smooths the disparities.

use rayon::prelude::*;
use std::ops::Range;

/// The largest number of disparities that are compared.
pub(crate) const MOST: usize = 96;
/// Cost of a neighbor one step away, and of one farther away, in units of the square root of light.
const STEP: f32 = 0.02;
const JUMP: f32 = 0.12;
/// Larger differences than this are occlusions or highlights.
pub(crate) const OUTLIER: f32 = 0.25;
/// Views that are compared as sampled do not differ if the center has the same light within this many pixels to each
/// side. It is half a pixel, and a tenth more because the straight line between two pixels of the other view softens
/// it.
const SAMPLED: f32 = 0.6;
/// Candidates on each side of the selected one among which all differences then decide.
const AROUND: usize = 1;

/// Returns the steps to the farthest view, at most `most`, for which [`MOST`] candidates up to the central view are
/// sufficient.
pub(crate) fn reach_within(range: [f64; 2], most: usize) -> usize {
    let fits = ((MOST - 1) as f64 / (2.0 * (range[1] - range[0]))).floor();
    if fits >= 1.0 { most.min(fits as usize) } else { 1 }
}

/// The comparison of views.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Compared {
    /// All differences count, which is sharpest at the ends of surfaces.
    Exactly,
    /// Views are compared as sampled (Birchfield and Tomasi, IEEE PAMI 20, 1998), and by all differences only among the
    /// nearest disparities. Two views never sample fine detail at the same places. If the detail repeats, the
    /// difference would be mistaken for another disparity.
    AsSampled,
}

/// A view and its neighbors in its row and column.
pub(crate) struct Sweep {
    pub height: usize,
    pub width: usize,
    /// The central view in square root of light.
    pub center: Vec<f32>,
    /// Views left, right, above and below, with the steps from the center (rows, columns), in square root of light.
    pub arms: [Arm; 4],
}

/// The views on one side.
pub(crate) type Arm = Vec<(isize, isize, Vec<f32>)>;

impl Sweep {
    /// Selects the view at row and column `[r, c]`, and the views at most `reach` steps away.
    pub fn around(
        [rows, columns]: [usize; 2],
        [r, c]: [usize; 2],
        reach: usize,
        [height, width]: [usize; 2],
        view: impl Fn(usize) -> Vec<f32>,
    ) -> Self {
        let root = |index| view(index).iter().map(|v| v.max(0.0).sqrt()).collect();
        let along = |n: usize, at: usize| {
            let near = (0..n).filter(move |i| *i != at && i.abs_diff(at) <= reach);
            near.map(move |i| i as isize - at as isize)
        };
        let mut arms: [Arm; 4] = Default::default();
        for d in along(columns, c) {
            arms[usize::from(d > 0)].push((0, d, root(r * columns + (c as isize + d) as usize)));
        }
        for d in along(rows, r) {
            arms[2 + usize::from(d > 0)].push((d, 0, root((r as isize + d) as usize * columns + c)));
        }
        Self { height, width, center: root(r * columns + c), arms }
    }

    /// Returns the distance of the outermost view from the center in steps.
    pub fn reach(&self) -> f64 {
        let all = self.arms.iter().flatten();
        all.map(|(r, c, _)| r.unsigned_abs().max(c.unsigned_abs())).max().unwrap_or(0) as f64
    }

    /// Returns the disparity of each pixel in pixels between neighboring views, between the ends of `range`.
    pub fn disparities(&self, range: [f64; 2], compared: Compared) -> Vec<f32> {
        let span = range[1] - range[0];
        // The outermost view moves by half a pixel from one candidate to the next.
        let count = ((2.0 * span * self.reach()).ceil() as usize).saturating_add(1).min(MOST);
        if count < 2 || !span.is_finite() {
            return vec![(0.5 * (range[0] + range[1])) as f32; self.height * self.width];
        }
        let step = span / (count - 1) as f64;
        let path_costs = |sampled: f32| {
            let costs = self.costs(count, sampled, |d| range[0] + d as f64 * step);
            smooth(&costs, self.height, self.width, count)
        };
        let least = |sums: &[f32], among: Range<usize>| {
            let first = among.start;
            among.min_by(|&a, &b| sums[a].total_cmp(&sums[b])).unwrap_or(first)
        };
        let about: Option<Vec<usize>> = (compared == Compared::AsSampled)
            .then(|| path_costs(SAMPLED).par_chunks_exact(count).map(|sums| least(sums, 0..count)).collect());
        let best = |(pixel, sums): (usize, &[f32])| {
            let among = about
                .as_ref()
                .map_or(0..count, |about| about[pixel].saturating_sub(AROUND)..(about[pixel] + AROUND + 1).min(count));
            let d = least(sums, among);
            (range[0] + (d as f64 + lowest(sums, d)) * step) as f32
        };
        path_costs(0.0).par_chunks_exact(count).enumerate().map(best).collect()
    }

    /// Returns the mean differences, (height, width, candidates). The better of two opposite arms counts, because
    /// content that is hidden on one side is visible on the other. Light that the center has within `sampled` pixels to
    /// each side along an arm is no difference.
    pub fn costs(&self, count: usize, sampled: f32, disparity: impl Fn(usize) -> f64 + Sync) -> Vec<f32> {
        let (h, w) = (self.height, self.width);
        let mut costs = vec![0.0f32; h * w * count];
        costs.par_chunks_exact_mut(w * count).enumerate().for_each(|(y, row)| {
            let (mut arms, mut seen) = ([const { Vec::new() }; 4], vec![0.0f32; w]);
            let around = [true, false].map(|along| self.around_row(y, along, sampled));
            for d in 0..count {
                for (arm, (sums, views)) in arms.iter_mut().zip(&self.arms).enumerate() {
                    sums.clear();
                    sums.resize(w, 0.0f32);
                    for (r, c, view) in views {
                        // Content of disparity delta is displaced by -delta per step (OPTICS 3).
                        self.shifted(view, y, -disparity(d) * *r as f64, -disparity(d) * *c as f64, &mut seen);
                        for ((sum, seen), [low, high]) in sums.iter_mut().zip(&seen).zip(&around[arm / 2]) {
                            *sum += (seen - high).max(low - seen).clamp(0.0, OUTLIER);
                        }
                    }
                    let share = 1.0 / views.len().max(1) as f32;
                    sums.iter_mut().for_each(|s| *s *= share);
                }
                for pair in [0, 2] {
                    let (a, b) = (&arms[pair], &arms[pair + 1]);
                    for (x, cost) in row.iter_mut().skip(d).step_by(count).enumerate() {
                        *cost += match (self.arms[pair].is_empty(), self.arms[pair + 1].is_empty()) {
                            (false, false) => a[x].min(b[x]),
                            (true, _) => b[x],
                            (_, true) => a[x],
                        };
                    }
                }
            }
        });
        costs
    }

    /// Returns the least and the most light of the center's row `y` within `reach` pixels (at most one) of each pixel,
    /// along the row or across it.
    fn around_row(&self, y: usize, along: bool, reach: f32) -> Vec<[f32; 2]> {
        let (h, w) = (self.height, self.width);
        let ends = |x: usize| {
            let [before, after] = if along {
                [y * w + x.saturating_sub(1), y * w + (x + 1).min(w - 1)]
            } else {
                [y.saturating_sub(1) * w + x, (y + 1).min(h - 1) * w + x]
            };
            let here = self.center[y * w + x];
            let [a, b] = [before, after].map(|i| here + reach * (self.center[i] - here));
            [here.min(a).min(b), here.max(a).max(b)]
        };
        (0..w).map(ends).collect()
    }

    /// Returns the growth of a match's cost per pixel that it is off, (height, width), along the axes that have views.
    /// It is at most as large as a cost.
    pub fn slopes(&self) -> Vec<f32> {
        let (h, w) = (self.height, self.width);
        let has = |pair: usize| !(self.arms[pair].is_empty() && self.arms[pair + 1].is_empty());
        let (across, down) = (has(0), has(2));
        let slope = |i: usize| {
            let (y, x) = (i / w, i % w);
            let apart = |a: usize, b: usize| (0.5 * (self.center[a] - self.center[b]).abs()).min(OUTLIER);
            let mut sum = 0.0;
            if across {
                sum += apart(y * w + (x + 1).min(w - 1), y * w + x.saturating_sub(1));
            }
            if down {
                sum += apart((y + 1).min(h - 1) * w + x, y.saturating_sub(1) * w + x);
            }
            sum
        };
        (0..h * w).into_par_iter().map(slope).collect()
    }

    /// Computes row `y` of a view that is moved by a fractional number of pixels along one axis. Pixels beyond its edge
    /// repeat the edge.
    fn shifted(&self, view: &[f32], y: usize, down: f64, across: f64, out: &mut [f32]) {
        let (h, w) = (self.height as i64, self.width as i64);
        let row = |j: i64| &view[j.clamp(0, h - 1) as usize * self.width..][..self.width];
        if across == 0.0 {
            let first = down.floor();
            let part = (down - first) as f32;
            // Both rows are the same beyond the edge.
            let (top, bottom) = (row(y as i64 + first as i64), row(y as i64 + first as i64 + 1));
            for ((out, a), b) in out.iter_mut().zip(top).zip(bottom) {
                *out = a + part * (b - a);
            }
            return;
        }
        let first = across.floor();
        let (part, first) = ((across - first) as f32, first as i64);
        let line = row(y as i64);
        let at = |x: i64| line[x.clamp(0, w - 1) as usize];
        let inner = (-first).clamp(0, w)..(w - 1 - first).clamp(0, w);
        for x in (0..inner.start).chain(inner.end.max(inner.start)..w) {
            let (a, b) = (at(x + first), at(x + first + 1));
            out[x as usize] = a + part * (b - a);
        }
        if inner.start < inner.end {
            let from = &line[(inner.start + first) as usize..=(inner.end + first) as usize];
            for (out, pair) in out[inner.start as usize..inner.end as usize].iter_mut().zip(from.windows(2)) {
                *out = pair[0] + part * (pair[1] - pair[0]);
            }
        }
    }
}

/// Returns the position of the minimum of a parabola through `costs[d]` and its two neighbors, -0.5 to 0.5 relative to
/// `d`.
pub(crate) fn lowest(costs: &[f32], d: usize) -> f64 {
    if d == 0 || d + 1 >= costs.len() {
        return 0.0;
    }
    let [a, b, c] = [costs[d - 1], costs[d], costs[d + 1]].map(f64::from);
    if a - 2.0 * b + c > 1e-12 { (0.5 * (a - c) / (a - 2.0 * b + c)).clamp(-0.5, 0.5) } else { 0.0 }
}

/// Returns the sums of the path costs from four sides.
fn smooth(costs: &[f32], height: usize, width: usize, count: usize) -> Vec<f32> {
    let mut total = vec![0.0f32; costs.len()];
    // Along rows, in both directions.
    total.par_chunks_exact_mut(width * count).zip(costs.par_chunks_exact(width * count)).for_each(|(total, costs)| {
        for forward in [true, false] {
            let mut path = vec![0.0f32; count];
            for i in 0..width {
                let x = if forward { i } else { width - 1 - i };
                extend(&mut path, &costs[x * count..][..count], i == 0);
                total[x * count..][..count].iter_mut().zip(&path).for_each(|(t, p)| *t += p);
            }
        }
    });
    // Along columns, in both directions.
    for forward in [true, false] {
        let mut paths = vec![0.0f32; width * count];
        for i in 0..height {
            let y = if forward { i } else { height - 1 - i };
            let line = y * width * count..(y + 1) * width * count;
            let parts = paths.par_chunks_exact_mut(count).zip(total[line.clone()].par_chunks_exact_mut(count));
            parts.zip(costs[line].par_chunks_exact(count)).for_each(|((path, total), costs)| {
                extend(path, costs, i == 0);
                total.iter_mut().zip(&*path).for_each(|(t, p)| *t += p);
            });
        }
    }
    total
}

/// Extends a path by one pixel.
fn extend(path: &mut [f32], costs: &[f32], first: bool) {
    if first {
        path.copy_from_slice(costs);
        return;
    }
    let least = path.iter().copied().fold(f32::INFINITY, f32::min);
    let mut before = f32::INFINITY;
    for d in 0..path.len() {
        let here = path[d];
        let after = path.get(d + 1).copied().unwrap_or(f32::INFINITY);
        path[d] = costs[d] + here.min(before.min(after) + STEP).min(least + JUMP) - least;
        before = here;
    }
}
