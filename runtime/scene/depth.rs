//! The depth of the central view, measured from the light field itself: a plane sweep over the views of the central
//! row and column, smoothed by semi-global matching (Hirschmueller, IEEE PAMI 30, 2008).

use super::{LightField, Pyramid, ViewGrid};
use crate::optics::Display;
use rayon::prelude::*;

/// Disparities that are tried, at most.
const MOST: usize = 96;
/// Cost of a neighbour one step away, and of one further away, in units of the square root of light.
const STEP: f32 = 0.02;
const JUMP: f32 = 0.12;
/// Differences beyond this are occlusions or highlights.
const OUTLIER: f32 = 0.25;

/// The central view (the nearest to the middle of the grid) and its neighbours.
struct Sweep {
    height: usize,
    width: usize,
    /// Square root of light.
    center: Vec<f32>,
    /// Views left, right, above and below: steps from the centre (rows, columns), square root of light.
    arms: [Vec<(isize, isize, Vec<f32>)>; 4],
}

impl Sweep {
    fn new(rows: usize, columns: usize, [height, width]: [usize; 2], view: impl Fn(usize) -> Vec<f32>) -> Self {
        let (r, c) = (rows / 2, columns / 2);
        let root = |index| view(index).iter().map(|v| v.max(0.0).sqrt()).collect();
        let along = |n: usize, at: usize| (0..n).filter(move |i| *i != at).map(move |i| i as isize - at as isize);
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
            for (x, costs) in row.chunks_exact_mut(count).enumerate() {
                for (d, cost) in costs.iter_mut().enumerate() {
                    let delta = disparity(d);
                    let arm = |views: &Vec<(isize, isize, Vec<f32>)>| {
                        let one = |(r, c, view): &(isize, isize, Vec<f32>)| {
                            // Content of disparity delta stands displaced by -delta per step (OPTICS 3).
                            let seen = self.sample(view, y as f64 - delta * *r as f64, x as f64 - delta * *c as f64);
                            (seen - self.center[y * w + x]).abs().min(OUTLIER)
                        };
                        views.iter().map(one).sum::<f32>() / views.len() as f32
                    };
                    let pair = |a: usize| {
                        let both = [&self.arms[a], &self.arms[a + 1]].into_iter().filter(|v| !v.is_empty()).map(arm);
                        both.fold(None, |least: Option<f32>, v| Some(least.map_or(v, |l| l.min(v)))).unwrap_or(0.0)
                    };
                    *cost = pair(0) + pair(2);
                }
            }
        });
        costs
    }

    fn sample(&self, view: &[f32], y: f64, x: f64) -> f32 {
        let (y, x) = (y.clamp(0.0, (self.height - 1) as f64), x.clamp(0.0, (self.width - 1) as f64));
        let (j, i) = (y as usize, x as usize);
        let (fy, fx) = ((y - j as f64) as f32, (x - i as f64) as f32);
        let row = |j: usize| {
            let row = &view[j * self.width..][..self.width];
            row[i] + fx * (row[(i + 1).min(self.width - 1)] - row[i])
        };
        let top = row(j);
        top + fy * (row((j + 1).min(self.height - 1)) - top)
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
