//! The depth of the central view, measured from the light field itself: a plane sweep over the views of the central
//! row and column, smoothed by semi-global matching (Hirschmueller, IEEE PAMI 30, 2008).

use super::map::Map;
use super::resize::Resize;
use super::{Fit, LightField, Pyramid, ViewGrid};
use crate::optics::Display;
use rayon::prelude::*;

/// Disparities that are tried, at most.
const MOST: usize = 96;
/// Cost of a neighbour one step away, and of one further away, in units of the square root of light.
const STEP: f32 = 0.02;
const JUMP: f32 = 0.12;
/// Differences beyond this are occlusions or highlights.
const OUTLIER: f32 = 0.25;

/// Pixels along the longer side of what disparities are sought in.
const LARGEST: usize = 512;
/// Steps to the farthest view that disparities of any view are sought with.
const NEAR: usize = 3;

/// A view and its neighbours in its row and column.
struct Sweep {
    height: usize,
    width: usize,
    /// Square root of light.
    center: Vec<f32>,
    /// Views left, right, above and below: steps from the centre (rows, columns), square root of light.
    arms: [Vec<(isize, isize, Vec<f32>)>; 4],
}

impl Sweep {
    /// The central view (the nearest to the middle of the grid), with all of its row and column.
    fn new(rows: usize, columns: usize, size: [usize; 2], view: impl Fn(usize) -> Vec<f32>) -> Self {
        Self::around([rows, columns], [rows / 2, columns / 2], usize::MAX, size, view)
    }

    /// The view at row and column `[r, c]`, with those that are no more than `reach` steps away.
    fn around(
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
        let mut arms: [Vec<_>; 4] = Default::default();
        for d in along(columns, c) {
            arms[usize::from(d > 0)].push((0, d, root(r * columns + (c as isize + d) as usize)));
        }
        for d in along(rows, r) {
            arms[2 + usize::from(d > 0)].push((d, 0, root((r as isize + d) as usize * columns + c)));
        }
        Self { height, width, center: root(r * columns + c), arms }
    }

    /// How far the outermost view stands from the centre, in steps.
    fn reach(&self) -> f64 {
        let all = self.arms.iter().flatten();
        all.map(|(r, c, _)| r.unsigned_abs().max(c.unsigned_abs())).max().unwrap_or(0) as f64
    }

    /// Disparity of each pixel, pixels between neighbouring views, between the ends of `range`.
    fn disparities(&self, range: [f64; 2]) -> Vec<f32> {
        let span = range[1] - range[0];
        // The outermost view moves by half a pixel from one candidate to the next.
        let count = ((2.0 * span * self.reach()).ceil() as usize + 1).min(MOST);
        if count < 2 || !span.is_finite() {
            return vec![(0.5 * (range[0] + range[1])) as f32; self.height * self.width];
        }
        let step = span / (count - 1) as f64;
        let costs = self.costs(count, |d| range[0] + d as f64 * step);
        let total = smooth(&costs, self.height, self.width, count);
        let best = |sums: &[f32]| {
            let d = (0..count).min_by(|&a, &b| sums[a].total_cmp(&sums[b])).unwrap_or(0);
            let mut at = d as f64;
            if d > 0 && d + 1 < count {
                let (a, b, c) = (f64::from(sums[d - 1]), f64::from(sums[d]), f64::from(sums[d + 1]));
                if a - 2.0 * b + c > 1e-12 {
                    at += (0.5 * (a - c) / (a - 2.0 * b + c)).clamp(-0.5, 0.5);
                }
            }
            (range[0] + at * step) as f32
        };
        total.par_chunks_exact(count).map(best).collect()
    }

    /// (height, width, candidates): mean difference, over the better of two opposite arms, for what is hidden on one
    /// side is seen on the other.
    fn costs(&self, count: usize, disparity: impl Fn(usize) -> f64 + Sync) -> Vec<f32> {
        let (h, w) = (self.height, self.width);
        let mut costs = vec![0.0f32; h * w * count];
        costs.par_chunks_exact_mut(w * count).enumerate().for_each(|(y, row)| {
            let (mut arms, mut seen) = ([const { Vec::new() }; 4], vec![0.0f32; w]);
            for d in 0..count {
                for (sums, views) in arms.iter_mut().zip(&self.arms) {
                    sums.clear();
                    sums.resize(w, 0.0f32);
                    for (r, c, view) in views {
                        // Content of disparity delta stands displaced by -delta per step (OPTICS 3).
                        self.shifted(view, y, -disparity(d) * *r as f64, -disparity(d) * *c as f64, &mut seen);
                        let center = &self.center[y * w..][..w];
                        for ((sum, seen), center) in sums.iter_mut().zip(&seen).zip(center) {
                            *sum += (seen - center).abs().min(OUTLIER);
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

/// Depth of each pixel of the central view, (height, width), metres: where the central row and column of views agree
/// best. Depths are sought in the range that the scene states, else in what disparities of two pixels mean.
pub fn central_depth(field: &LightField, display: &Display) -> Vec<f32> {
    let per_pixel = display.focal_length * display.picture_pixel() / field.cell(display);
    let range = field.depth_range(display).map_or([-2.0, 2.0], |d| [d[0] / per_pixel, d[1] / per_pixel]);
    let Some(views) = field.planes.get(field.planes.len() / 2) else { return Vec::new() };
    let size = [field.height, field.width];
    let sweep = Sweep::new(field.grid[0], field.grid[1], size, |index| views[index].clone());
    sweep.disparities(range).into_iter().map(|d| (f64::from(d) * per_pixel) as f32).collect()
}

/// The central view of a pyramid, linear light, and its disparities between the ends of `range` (pixels between
/// neighbouring views); (height, width) of the pyramid's first level.
pub(crate) fn central_view(pyramid: &Pyramid, grid: &ViewGrid, range: [f64; 2]) -> (Vec<f32>, Vec<f32>) {
    let level = &pyramid.levels[0];
    let pixels = level.height * level.width;
    let unit = pyramid.scale / 65535.0;
    let view =
        |index: usize| level.views[index * pixels..][..pixels].iter().map(|v| f32::from(*v) * unit).collect::<Vec<_>>();
    let sweep = Sweep::new(grid.rows, grid.columns, [level.height, level.width], view);
    (view(grid.rows / 2 * grid.columns + grid.columns / 2), sweep.disparities(range))
}

/// Bytes that [`view_disparities`] takes while it works: two volumes of costs.
pub(super) fn scratch([height, width]: [usize; 2], range: [f64; 2]) -> u64 {
    let times = height.max(width).div_ceil(LARGEST).max(1);
    let candidates = ((2.0 * (range[1] - range[0]) * NEAR as f64 / times as f64).ceil() as usize + 1).min(MOST);
    (8 * candidates * height.div_ceil(times) * width.div_ceil(times)) as u64
}

/// The disparities of any view of a grid, (height, width), between the ends of `range` (pixels between neighbouring views),
/// from its nearest neighbours. Large views are looked at in fewer pixels.
pub(super) fn view_disparities(
    grid: &ViewGrid,
    view: usize,
    [height, width]: [usize; 2],
    range: [f64; 2],
    light: impl Fn(usize) -> Vec<f32>,
) -> Vec<f32> {
    let (counts, at) = ([grid.rows, grid.columns], [view / grid.columns, view % grid.columns]);
    let times = height.max(width).div_ceil(LARGEST);
    if times <= 1 {
        return Sweep::around(counts, at, NEAR, [height, width], light).disparities(range);
    }
    let [rows, columns] = [height.div_ceil(times), width.div_ceil(times)];
    let shrink = Resize::new([height, width], [rows, columns], Fit::Stretch);
    let scale = columns as f64 / width as f64;
    let sweep = Sweep::around(counts, at, NEAR, [rows, columns], |view| shrink.apply(&light(view)));
    let found = sweep.disparities(range.map(|d| d * scale));
    let values = found.into_iter().map(|d| (f64::from(d) / scale) as f32).collect();
    Map { height: rows, width: columns, values, is_disparity: true }.resize(height, width, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::optics::Color;
    use crate::scene::{Request, load};

    fn depths(source: &str) -> (LightField, Vec<f32>) {
        let display = Display { height: 96, width: 120, ..Display::preset("small").unwrap() };
        let field = load(source, &Request::new(&display, &[Color::Green])).unwrap();
        let depth = central_depth(&field, &display);
        (field, depth)
    }

    #[test]
    fn a_plane_is_found_at_its_depth() {
        for mm in [-0.3, 0.0, 0.4] {
            let display = Display { height: 96, width: 120, ..Display::preset("small").unwrap() };
            let mut field =
                load(&format!("builtin:plane?depth={mm}"), &Request::new(&display, &[Color::Green])).unwrap();
            // A plane's own range would give it away.
            field.depth = Some([-0.6e-3, 0.6e-3]);
            let depth = central_depth(&field, &display);
            let mut off: Vec<f32> = depth.iter().map(|z| (z * 1e3 - mm as f32).abs()).collect();
            off.sort_by(f32::total_cmp);
            // 0.16 mm are half a pixel between the centre and the outermost view.
            let at = |share: f64| off[(off.len() as f64 * share) as usize];
            assert!(at(0.5) < 0.05 && at(0.9) < 0.16, "{mm} mm: {} and {} mm off", at(0.5), at(0.9));
        }
    }

    #[test]
    fn near_and_far_are_told_apart() {
        let (field, depth) = depths("builtin:still-life");
        let [far, near] = field.depth.unwrap();
        let third = |k: usize| {
            let rows = depth.chunks_exact(field.width).skip(k * 32).take(32).flatten();
            rows.map(|z| f64::from(*z)).sum::<f64>() / (32 * field.width) as f64
        };
        // The wall is behind, the cloth comes towards the eye.
        assert!(third(0) < third(2) - 0.2 * (near - far), "{} {}", third(0), third(2));
    }
}
