//! A plane sweep over the views of a row and a column of the grid, smoothed by semi-global matching (Hirschmueller, IEEE
//! PAMI 30, 2008).

use rayon::prelude::*;
use std::ops::Range;

/// Disparities that are tried, at most.
pub(crate) const MOST: usize = 96;
/// Cost of a neighbor one step away, and of one further away, in units of the square root of light.
const STEP: f32 = 0.02;
const JUMP: f32 = 0.12;
/// Differences beyond this are occlusions or highlights.
pub(crate) const OUTLIER: f32 = 0.25;
/// Of views that are compared as they are sampled, what the center shows within so many pixels to each side is no difference: half a pixel,
/// and a tenth more, for the straight line between two pixels of the other view softens it.
const SAMPLED: f32 = 0.6;
/// Candidates to each side of the one that is chosen then, among which all that differs decides.
const AROUND: usize = 1;

/// Steps to the farthest view, of no more than `most`, between which and the central one [`MOST`] candidates suffice.
pub(crate) fn reach_within(range: [f64; 2], most: usize) -> usize {
    let fits = ((MOST - 1) as f64 / (2.0 * (range[1] - range[0]))).floor();
    if fits >= 1.0 { most.min(fits as usize) } else { 1 }
}

/// How views are compared.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Compared {
    /// By all that differs: sharpest where surfaces end.
    Exactly,
    /// As they are sampled (Birchfield and Tomasi, IEEE PAMI 20, 1998), and by all that differs among the nearest disparities only. No two
    /// views sample fine detail at the same places; where it repeats, that would be taken for another disparity.
    AsSampled,
}

/// A view and its neighbors in its row and column.
pub(crate) struct Sweep {
    pub height: usize,
    pub width: usize,
    /// Square root of light.
    pub center: Vec<f32>,
    /// Views left, right, above and below: steps from the center (rows, columns), square root of light.
    pub arms: [Arm; 4],
}

/// Views on one side.
pub(crate) type Arm = Vec<(isize, isize, Vec<f32>)>;

impl Sweep {
    /// The view at row and column `[r, c]`, with those that are no more than `reach` steps away.
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

    /// How far the outermost view stands from the center, in steps.
    pub fn reach(&self) -> f64 {
        let all = self.arms.iter().flatten();
        all.map(|(r, c, _)| r.unsigned_abs().max(c.unsigned_abs())).max().unwrap_or(0) as f64
    }

    /// Disparity of each pixel, pixels between neighboring views, between the ends of `range`.
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

    /// (height, width, candidates): mean difference, over the better of two opposite arms, for what is hidden on one
    /// side is seen on the other. What the center shows within `sampled` pixels to each side along an arm is no difference.
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
                        // Content of disparity delta stands displaced by -delta per step (OPTICS 3).
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

    /// Least and most light of the center's row `y` within `reach` pixels (no more than one) of each pixel, along the row or across it.
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

    /// (height, width): by how much the cost of a match grows with each pixel that it is off, along the axes that have
    /// views; no more than a cost does.
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

    /// Row `y` of a view that is moved by whole and parts of pixels along one axis; beyond its edge, its edge.
    fn shifted(&self, view: &[f32], y: usize, down: f64, across: f64, out: &mut [f32]) {
        let (h, w) = (self.height as i64, self.width as i64);
        let row = |j: i64| &view[j.clamp(0, h - 1) as usize * self.width..][..self.width];
        if across == 0.0 {
            let first = down.floor();
            let part = (down - first) as f32;
            // Between two rows that are one beyond the edge.
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

/// Where between its neighbors the least of the costs, `costs[d]`, would lie on a parabola through the three: -0.5 to 0.5.
pub(crate) fn lowest(costs: &[f32], d: usize) -> f64 {
    if d == 0 || d + 1 >= costs.len() {
        return 0.0;
    }
    let [a, b, c] = [costs[d - 1], costs[d], costs[d + 1]].map(f64::from);
    if a - 2.0 * b + c > 1e-12 { (0.5 * (a - c) / (a - 2.0 * b + c)).clamp(-0.5, 0.5) } else { 0.0 }
}

/// Sums of the path costs from four sides.
fn smooth(costs: &[f32], height: usize, width: usize, count: usize) -> Vec<f32> {
    let mut total = vec![0.0f32; costs.len()];
    // Along rows, both ways.
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
    // Along columns, both ways.
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

/// One pixel further along a path.
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
