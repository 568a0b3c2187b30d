//! Interpolates a light field between its views, and a little beyond them.
//!
//! If content moves by pixels from one view to the next, a target image shows each edge once per view. Here a view from
//! any place is made from the four views around it. Each has its own disparities (`depth`), along which the ray of a
//! pixel is followed to the nearest surface in that view. The other views show what one view did not see. Of several
//! surfaces, the nearest one counts that no larger share of the views look through. Content that no view saw is
//! continued from the farther side.

use crate::depth::central::{scratch, view_disparities};
use crate::depth::map::between;
use crate::depth::sweep::Compared;
use crate::synthesis::rays::{MOST_STEPS, NONE, RayDirection, Rays};
use crate::{LightField, ViewGrid};
use eyebox_kernels::relief_close::farther_side;
use eyebox_optics::Display;
use rayon::prelude::*;
use std::sync::OnceLock;

/// Pixels between the steps along a ray.
const STEP: f32 = 0.5;
/// A ray meets a surface that is at most this many pixels off the ray. Otherwise the ray passes behind it.
const MET: f32 = 1.0;
/// Disparities that differ by more than this belong to two surfaces.
const TEAR: f32 = 0.7;
/// Views of a smaller share are used only if the others saw nothing.
const LEAST: f32 = 0.02;

/// Views of a light field and their disparities, stored compactly.
pub struct Interpolator {
    grid: ViewGrid,
    size: [usize; 2],
    planes: Vec<Stored>,
    /// Smallest and largest disparity, in pixels between neighboring views.
    range: [f64; 2],
    /// The disparities of the views that were needed up to now, as (row, column), where 65535 is the larger end of the
    /// range.
    disparities: Vec<OnceLock<Vec<u16>>>,
}

/// One color of all views.
struct Stored {
    /// Linear light of the value 65535.
    scale: f32,
    /// The light as (view, row, column).
    views: Vec<u16>,
}

impl Stored {
    fn new(views: Vec<Vec<f32>>) -> Self {
        let brightest = views.par_iter().flatten().copied().reduce(|| 0.0, f32::max);
        let scale = if brightest > 0.0 { brightest } else { 1.0 };
        let quantised = |v: &f32| (v / scale * 65535.0 + 0.5) as u16;
        let mut stored = Vec::with_capacity(views.iter().map(Vec::len).sum());
        views.into_iter().for_each(|view| stored.extend(view.iter().map(quantised)));
        Self { scale, views: stored }
    }
}

/// A view that contributes light to another view.
struct Lender<'a> {
    light: &'a [u16],
    disparities: &'a [u16],
    /// Columns and rows of views from this view to the other.
    away: [f32; 2],
    rays: Rays,
    share: f32,
}

/// The surface that a ray meets.
#[derive(Clone, Copy)]
struct Met {
    disparity: f32,
    light: f32,
    share: f32,
}

impl Interpolator {
    /// Prepares the colors of a light field for a display. Disparities are searched in the range that the light field
    /// states or that is found (`LightField::disparities_sought`).
    pub fn new(field: LightField, display: &Display) -> Self {
        let cell = field.cell(display);
        let range = field.disparities_sought(display);
        let grid = ViewGrid { rows: field.grid[0], columns: field.grid[1], cell };
        let size = [field.height, field.width];
        // Content that moves by more than a picture is never visible in two views.
        let most = field.height.max(field.width) as f64;
        let range = range.map(|d| d.clamp(-most, most));
        let planes = field.planes.into_iter().map(Stored::new).collect();
        let disparities = (0..grid.rows * grid.columns).map(|_| OnceLock::new()).collect();
        Self { grid, size, planes, range, disparities }
    }

    /// Adds the colors of the same light field that were loaded after the others. If colors are loaded one by one, only
    /// one is in memory in its original form at a time.
    ///
    /// # Panics
    /// If its views have another shape, which is a mistake of the caller.
    pub fn add(&mut self, field: LightField) {
        let same = (field.grid, [field.height, field.width]) == ([self.grid.rows, self.grid.columns], self.size);
        assert!(same, "a light field of another size");
        self.planes.extend(field.planes.into_iter().map(Stored::new));
    }

    /// Returns the rows and columns of a view.
    pub fn size(&self) -> [usize; 2] {
        self.size
    }

    /// Returns the pixels by which content at an end of the depths moves over `metres` meters of the pupil plane.
    pub fn parallax(&self, metres: f64) -> f64 {
        metres / self.grid.cell * self.range[0].abs().max(self.range[1].abs())
    }

    /// Returns the bytes in memory, including the disparities of all views and the working memory of their search.
    pub fn bytes(&self) -> u64 {
        let pixels = (self.size[0] * self.size[1]) as u64;
        let views = (self.grid.rows * self.grid.columns) as u64;
        2 * pixels * views * (self.planes.len() as u64 + 1) + scratch(self.size, self.range)
    }

    /// Returns views of color `color` from these places (x, y) of the pupil plane in meters. The light field's own
    /// views are at the places of its [`ViewGrid`].
    pub fn views(&self, color: usize, places: &[(f64, f64)]) -> Vec<Vec<f32>> {
        // The search for the disparities of one view already uses all cores.
        for &(x, y) in places {
            for (view, ..) in self.around(x, y).into_iter().flatten() {
                self.disparities_of(view);
            }
        }
        places.par_iter().map(|&(x, y)| self.view(color, x, y)).collect()
    }

    /// Returns the four views around a place, or fewer at the edge of a grid that is one view wide. Each has the
    /// columns and rows from it to the place, and its share. Beyond the outermost views, only these count.
    fn around(&self, x: f64, y: f64) -> [Option<(usize, [f32; 2], f32)>; 4] {
        let axis = |at: f64, n: usize| {
            let at = at / self.grid.cell + (n - 1) as f64 / 2.0;
            // A place that is off by rounding counts as the place of the view.
            let at = if (at - at.round()).abs() < 1e-6 { at.round() } else { at };
            let first = at.floor().clamp(0.0, n.saturating_sub(2) as f64) as usize;
            [first, first + 1]
                .map(|i| (i < n).then_some((i, at - i as f64, 1.0 - (at.clamp(0.0, (n - 1) as f64) - i as f64).abs())))
        };
        let (columns, rows) = (axis(x, self.grid.columns), axis(y, self.grid.rows));
        std::array::from_fn(|k| {
            let ((c, u, across), (r, v, down)) = (columns[k % 2]?, rows[k / 2]?);
            Some((r * self.grid.columns + c, [u as f32, v as f32], (across * down) as f32))
        })
    }

    fn light_of(&self, color: usize, view: usize) -> &[u16] {
        let pixels = self.size[0] * self.size[1];
        &self.planes[color].views[view * pixels..][..pixels]
    }

    fn disparities_of(&self, view: usize) -> &[u16] {
        self.disparities[view].get_or_init(|| {
            let light = |view: usize| {
                let mut sum = vec![0.0f32; self.size[0] * self.size[1]];
                // The unit is the brightest light, so that differences have the same weight for a scene of
                // any brightness.
                let brightest = self.planes.iter().map(|p| p.scale).fold(0.0, f32::max);
                for (color, plane) in self.planes.iter().enumerate() {
                    let unit = plane.scale / brightest / (65535.0 * self.planes.len() as f32);
                    sum.iter_mut().zip(self.light_of(color, view)).for_each(|(s, v)| *s += unit * f32::from(*v));
                }
                sum
            };
            let found = view_disparities(&self.grid, view, self.size, self.range, Compared::AsSampled, light);
            let [low, high] = self.range;
            let unit = 65535.0 / (high - low).max(1e-12);
            let own = found.iter().map(|d| ((f64::from(*d) - low) * unit + 0.5).clamp(0.0, 65535.0) as u16);
            own.collect()
        })
    }

    fn view(&self, color: usize, x: f64, y: f64) -> Vec<f32> {
        let span = (self.range[1] - self.range[0]) as f32;
        let range = self.range.map(|v| v as f32);
        let lend = |(view, away, share): (usize, [f32; 2], f32)| {
            let length = away[0].hypot(away[1]);
            // Far beyond the views, a ray is followed in longer steps.
            let most = (4.0 * (self.size[0] + self.size[1]) as f32).min(MOST_STEPS);
            let count = (length * span / STEP).ceil().clamp(1.0, most);
            let rays =
                Rays::new(&RayDirection { away, range, step: span / count, count: count as usize, met: MET / length });
            let (light, disparities) = (self.light_of(color, view), self.disparities_of(view));
            Lender { light, disparities, away, rays, share: share.max(1e-4) }
        };
        let mut lenders: Vec<Lender> = self.around(x, y).into_iter().flatten().map(lend).collect();
        lenders.sort_by(|a, b| b.share.total_cmp(&a.share));
        let unit = self.planes[color].scale / 65535.0;
        if let Some(own) = lenders.first().filter(|l| l.away == [0.0, 0.0]) {
            return own.light.iter().map(|v| f32::from(*v) * unit).collect();
        }
        let [height, width] = self.size;
        let mut image = vec![0.0f32; height * width];
        let mut depth = vec![f32::NAN; height * width];
        let rows = image.par_chunks_exact_mut(width).zip(depth.par_chunks_exact_mut(width)).enumerate();
        let room = || [const { Vec::new() }; 4];
        rows.for_each_init(room, |room, (y, (image, depth))| self.row(&lenders, y, room, [image, depth], unit));
        self.close(&mut image, &depth, lenders.first().map_or([1.0, 0.0], |l| l.away));
        image
    }

    /// Computes a row of a view and of its disparities from all views with a large share. If these saw nothing, the
    /// others count. `steps` is working memory for the steps at which the rays through each view meet a surface.
    fn row(&self, lenders: &[Lender], y: usize, steps: &mut [Vec<u16>; 4], [image, depth]: [&mut [f32]; 2], unit: f32) {
        let large = lenders.iter().take_while(|l| l.share >= LEAST).count().max(1);
        let follow = |steps: &mut [Vec<u16>], lenders: &[Lender]| {
            for (steps, lender) in steps.iter_mut().zip(lenders) {
                steps.resize(self.size[1], NONE);
                lender.rays.follow(lender.disparities, self.size, y, steps);
            }
        };
        follow(&mut steps[..large], lenders);
        let unseen = (0..self.size[1]).any(|x| steps[..large].iter().all(|steps| steps[x] == NONE));
        if unseen {
            follow(&mut steps[large..], &lenders[large..]);
        }
        for x in 0..self.size[1] {
            let mut met = [None::<Met>; 4];
            let mut meet = |k: usize| met[k] = (steps[k][x] < NONE).then(|| self.met(&lenders[k], x, y, steps[k][x]));
            (0..large).for_each(&mut meet);
            if unseen && steps[..large].iter().all(|steps| steps[x] == NONE) {
                (large..lenders.len()).for_each(meet);
            }
            if let Some(met) = self.nearest(&lenders[..large], met, x, y) {
                image[x] = met.light * unit;
                depth[x] = met.disparity;
            }
        }
    }

    /// Returns the visible surface at a pixel among the surfaces that the views met. It is the nearest one that is not
    /// contradicted by more views.
    fn nearest(&self, large: &[Lender], met: [Option<Met>; 4], x: usize, y: usize) -> Option<Met> {
        let mut limit = f32::INFINITY;
        let mut best = None::<(f32, Met)>;
        loop {
            let below = met.iter().flatten().filter(|m| m.disparity < limit);
            let nearest = below.clone().map(|m| m.disparity).fold(f32::NEG_INFINITY, f32::max);
            if nearest == f32::NEG_INFINITY {
                return best.map(|(_, met)| met);
            }
            let (mut light, mut share, mut depth) = (0.0, 0.0, 0.0);
            for m in below.filter(|m| m.disparity >= nearest - TEAR) {
                light += m.share * m.light;
                depth += m.share * m.disparity;
                share += m.share;
            }
            let found = Met { disparity: depth / share, light: light / share, share };
            // A view that looks through a surface contradicts it. A view that sees something in front of it does not
            // count.
            let denied: f32 = (large.iter())
                .filter(|l| self.beyond(l, x, y, found.disparity).is_some_and(|d| d < found.disparity - TEAR))
                .map(|l| l.share)
                .sum();
            if share > denied {
                return Some(found);
            }
            if best.as_ref().is_none_or(|(surplus, _)| share - denied > *surplus) {
                best = Some((share - denied, found));
            }
            limit = nearest - TEAR;
        }
    }

    /// Returns the disparity that a view saw at the place of a surface of this disparity.
    fn beyond(&self, lender: &Lender, x: usize, y: usize, disparity: f32) -> Option<f32> {
        let [low, high] = self.range.map(|v| v as f32);
        let at = (x as f32 + disparity * lender.away[0], y as f32 + disparity * lender.away[1]);
        let at = pixel(self.size, at).map(|(j, i)| lender.disparities[j * self.size[1] + i])?;
        Some(low + (high - low) / 65535.0 * f32::from(at))
    }

    /// Returns the surface that the ray of a pixel through a view meets at a step, interpolated between the pixels of
    /// the view.
    fn met(&self, lender: &Lender, x: usize, y: usize, step: u16) -> Met {
        let (width, [low, high]) = (self.size[1], self.range.map(|v| v as f32));
        let scale = (high - low) / 65535.0;
        let own = |j: usize, i: usize| low + scale * f32::from(lender.disparities[j * width + i]);
        let place = |d: f32| (x as f32 + d * lender.away[0], y as f32 + d * lender.away[1]);
        let [down, right] = lender.rays.place(step);
        let mut disparity = own((y as i32 + down) as usize, (x as i32 + right) as usize);
        for _ in 0..2 {
            disparity = smooth(self.size, place(disparity), &own).unwrap_or(disparity);
        }
        let (x, y) = place(disparity);
        Met { disparity, light: sample(self.size, lender.light, x, y), share: lender.share }
    }

    /// Fills content that no view saw with the light of the farther side, along the direction in which content moves.
    fn close(&self, image: &mut [f32], depth: &[f32], [u, v]: [f32; 2]) {
        let length = u.hypot(v).max(1e-6);
        let known = |q: usize| Some(depth[q]).filter(|d| !d.is_nan());
        let light = |p| farther_side(self.size, p, [u / length, v / length], known).map_or(0.0, |q| image[q]);
        let empty = (0..image.len()).into_par_iter().filter(|p| depth[*p].is_nan());
        let filled: Vec<(usize, f32)> = empty.map(|p| (p, light(p))).collect();
        filled.into_iter().for_each(|(p, light)| image[p] = light);
    }
}

/// Splits a number into the whole number below and the rest. It avoids the function call that `floor` becomes in builds
/// for old processors.
fn split(x: f32) -> (i32, f32) {
    let whole = x as i32;
    let whole = if whole as f32 > x { whole.saturating_sub(1) } else { whole };
    (whole, x - whole as f32)
}

/// Returns the row and column of the pixel at a place (x, y), if there is one.
fn pixel([height, width]: [usize; 2], (x, y): (f32, f32)) -> Option<(usize, usize)> {
    let (i, j) = (split(x + 0.5).0, split(y + 0.5).0);
    (i >= 0 && j >= 0 && i < width as i32 && j < height as i32).then_some((j as usize, i as usize))
}

/// Interpolates between four disparities of one surface. It returns `None` if they belong to two surfaces.
fn smooth([height, width]: [usize; 2], (x, y): (f32, f32), own: &impl Fn(usize, usize) -> f32) -> Option<f32> {
    let (x, y) = (x.clamp(0.0, (width - 1) as f32), y.clamp(0.0, (height - 1) as f32));
    let (i, j) = (x as usize, y as usize);
    let (fx, fy) = (x - i as f32, y - j as f32);
    let (right, below) = ((i + 1).min(width - 1), (j + 1).min(height - 1));
    between([own(j, i), own(j, right), own(below, i), own(below, right)], fx, fy, TEAR)
}

/// Samples light by Catmull-Rom, never below zero.
fn sample([height, width]: [usize; 2], light: &[u16], x: f32, y: f32) -> f32 {
    let weights = |t: f32| {
        let (t2, t3) = (t * t, t * t * t);
        [-0.5 * t + t2 - 0.5 * t3, 1.0 - 2.5 * t2 + 1.5 * t3, 0.5 * t + 2.0 * t2 - 1.5 * t3, 0.5 * (t3 - t2)]
    };
    let ((left, u), (top, v)) = (split(x), split(y));
    let (across, down) = (weights(u), weights(v));
    let index = |at: i32, k: usize, n: usize| at.saturating_add(k as i32 - 1).clamp(0, n as i32 - 1) as usize;
    let columns: [usize; 4] = std::array::from_fn(|k| index(left, k, width));
    let mut sum = 0.0;
    for (k, weight) in down.iter().enumerate() {
        let row = &light[index(top, k, height) * width..][..width];
        let line: f32 = columns.iter().zip(across).map(|(&i, w)| w * f32::from(row[i])).sum();
        sum += weight * line;
    }
    sum.max(0.0)
}
