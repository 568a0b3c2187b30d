//! The range of a light field's disparities, found where the scene does not state it, from coarse to fine.
//!
//! Small copies of the central view are compared with its nearest neighbours over every disparity up to a third of the
//! picture; larger copies, with farther views, over what was found. Only pixels count of which the pictures leave no
//! doubt: with detail along every axis that has views, alike in the views of both axes, and like at no other disparity.

use super::resize::Resize;
use super::sweep::{Sweep, lowest, reach_within};
use super::{Fit, LightField};
use crate::optics::Display;
use rayon::prelude::*;

/// Where disparities are sought if none beyond is found, pixels between neighbouring views.
pub(super) const USUAL: [f64; 2] = [-2.0, 2.0];

/// Pixels along the longer side: coarse, and fine.
const COARSE: usize = 128;
const FINE: usize = 256;
/// Steps to the farthest view that the fine copies are compared with.
const STEPS: usize = 3;
/// Pixels from the middle of the windows that are compared to their edge.
const WINDOW: usize = 2;
/// A match is off by no more than this many pixels, as the light's slope tells.
const OFF: f32 = 0.5;
/// Another disparity is as unlike as this many times its best match, and as this many pixels, at least.
const UNLIKE: [f32; 2] = [2.0, 0.4];
/// The share of sure pixels within a pixel that is no accident, and their number.
const ENOUGH: f64 = 0.006;
const LEAST: usize = 12;
/// A range beyond two pixels is trusted where so much of the detail is sure.
const TRUSTED: f64 = 0.45;

/// What the views show.
struct Found {
    /// Smallest and largest disparity, pixels between neighbouring views.
    range: [f64; 2],
    /// The share of detail whose disparity is sure.
    share: f64,
}

/// Where disparities are sought, pixels between neighbouring views.
pub(super) struct Sought {
    /// From the farthest to the nearest.
    pub range: [f64; 2],
    /// The share of detail whose disparity is sure, where that is too little to trust the range.
    pub doubt: Option<f64>,
}

impl LightField {
    /// Where disparities are sought, pixels between neighbouring views at this resolution: in the range that the scene
    /// states on `display`; else within two pixels, or, where the views show content beyond, within what they show.
    pub(super) fn disparities_sought(&self, display: &Display) -> Sought {
        let per_pixel = display.focal_length * display.picture_pixel() / self.cell(display);
        if let Some(stated) = self.depth_range(display) {
            return Sought { range: stated.map(|z| z / per_pixel), doubt: None };
        }
        match found(self) {
            Some(Found { range: [low, high], share }) if low < USUAL[0] || high > USUAL[1] => {
                let margin = 0.05 * (high - low) + 0.25;
                Sought { range: [low - margin, high + margin], doubt: (share < TRUSTED).then_some(share) }
            }
            _ => Sought { range: USUAL, doubt: None },
        }
    }

    /// The depths that matter on `display`, farthest first, metres: as asked, as the scene says, or what a disparity of two
    /// pixels means, or what the views show beyond.
    pub fn depths(&self, display: &Display, asked: Option<[f64; 2]>) -> [f64; 2] {
        let per_pixel = display.focal_length * display.picture_pixel() / self.cell(display);
        let sought = || self.disparities_sought(display).range.map(|d| d * per_pixel);
        let [a, b] = asked.or_else(|| self.depth_range(display)).unwrap_or_else(sought);
        [a.min(b), a.max(b)]
    }
}

/// A view's light in all colours together, in units of the brightest.
pub(super) fn mean_light(field: &LightField) -> impl Fn(usize) -> Vec<f32> {
    let brightest = field.planes.par_iter().flatten().flatten().copied().reduce(|| 0.0, f32::max);
    let unit = 1.0 / (brightest.max(f32::MIN_POSITIVE) * field.planes.len().max(1) as f32);
    move |view| {
        let mut sum = vec![0.0f32; field.height * field.width];
        for views in &field.planes {
            sum.iter_mut().zip(&views[view]).for_each(|(s, v)| *s += unit * v);
        }
        sum
    }
}

/// Smallest and largest disparity that the views show, pixels between neighbouring views; none where no detail tells.
fn found(field: &LightField) -> Option<Found> {
    let longer = field.height.max(field.width);
    let light = mean_light(field);
    let at = |pixels: usize| {
        let times = longer.div_ceil(pixels).max(1);
        [field.height, field.width].map(|n| n.div_ceil(times))
    };
    let within = |size: [usize; 2], range: [f64; 2], most: usize| {
        let scale = size[1] as f64 / field.width as f64;
        let shrink = Resize::new([field.height, field.width], size, Fit::Stretch);
        let range = range.map(|d| d * scale);
        let middle = field.grid.map(|n| n / 2);
        let sweep = Sweep::around(field.grid, middle, reach_within(range, most), size, |v| shrink.apply(&light(v)));
        ends(&sweep, range).map(|found| Found { range: found.range.map(|d| d / scale), ..found })
    };
    let third = longer as f64 / 3.0;
    let coarse = within(at(COARSE), [-third, third], 1)?;
    let [low, high] = coarse.range;
    let margin = (longer as f64 / COARSE as f64).max(1.0) + 0.1 * (high - low);
    let near = [low - margin, high + margin];
    within(at(FINE), near, STEPS).or(Some(coarse))
}

/// The smallest and the largest disparity that enough pixels surely have.
fn ends(sweep: &Sweep, range: [f64; 2]) -> Option<Found> {
    let (h, w, reach) = (sweep.height, sweep.width, sweep.reach());
    if reach == 0.0 || h.min(w) < 4 * WINDOW {
        return None;
    }
    let step = 0.5 / reach;
    let count = ((range[1] - range[0]) / step).ceil() as usize + 1;
    let slopes = windows(&sweep.slopes(), h, w, 1);
    let costs = windows(&sweep.costs(count, |d| range[0] + d as f64 * step), h, w, count);
    let least = (slopes.iter().sum::<f32>() / slopes.len() as f32).max(1e-4);
    let detail = slopes.iter().filter(|slope| **slope > least).count();
    // A match's own valley: a pixel and a half to each side.
    let own = (1.5 / step).ceil() as usize;
    let sure = |(costs, slope): (&[f32], &f32)| {
        let best = (0..count).min_by(|&a, &b| costs[a].total_cmp(&costs[b]))?;
        let alike = costs[best] <= OFF * slope && *slope > least;
        let others = (0..count).filter(|d| d.abs_diff(best) > own).map(|d| costs[d]);
        let unlike = others.fold(f32::INFINITY, f32::min);
        let sure = alike && unlike >= (UNLIKE[0] * costs[best]).max(UNLIKE[1] * slope);
        sure.then(|| range[0] + (best as f64 + lowest(costs, best)) * step)
    };
    let mut all: Vec<f64> = costs.par_chunks_exact(count).zip(slopes.par_iter()).filter_map(sure).collect();
    all.sort_by(f64::total_cmp);
    let enough = LEAST.max((ENOUGH * all.len() as f64) as usize);
    let together = |run: &&[f64]| run[enough - 1] - run[0] <= 2.0 * step;
    let range = [all.windows(enough).find(together)?[0], all.windows(enough).rfind(together)?[enough - 1]];
    Some(Found { range, share: all.len() as f64 / detail as f64 })
}

/// Sums over windows of (height, width, depth).
fn windows(values: &[f32], height: usize, width: usize, depth: usize) -> Vec<f32> {
    let line = width * depth;
    let mut across = vec![0.0f32; values.len()];
    across.par_chunks_exact_mut(line).zip(values.par_chunks_exact(line)).for_each(|(out, row)| {
        for x in 0..width {
            for i in x.saturating_sub(WINDOW)..(x + WINDOW + 1).min(width) {
                let from = &row[i * depth..][..depth];
                out[x * depth..][..depth].iter_mut().zip(from).for_each(|(o, v)| *o += v);
            }
        }
    });
    let mut all = vec![0.0f32; values.len()];
    all.par_chunks_exact_mut(line).enumerate().for_each(|(y, out)| {
        for j in y.saturating_sub(WINDOW)..(y + WINDOW + 1).min(height) {
            out.iter_mut().zip(&across[j * line..][..line]).for_each(|(o, v)| *o += v);
        }
    });
    all
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::optics::Color;
    use crate::scene::{DepthSource, Request, load};

    /// A built-in scene whose depths are not told, its true disparities, and the display.
    fn silent(scene: &str, views: usize) -> (LightField, [f64; 2], Display) {
        let display = Display { height: 96, width: 112, ..Display::preset("paper").unwrap() };
        let request = Request { views, ..Request::new(&display, &[Color::Green]) };
        let field = load(&format!("builtin:{scene}"), &request).unwrap();
        let truth = field.disparities_sought(&display).range;
        (LightField { depth: None, disparity: None, ..field }, truth, display)
    }

    #[test]
    fn disparities_are_found_however_far_the_views_stand_apart() {
        for (scene, views) in
            [("still-life?span=1.5", 5), ("still-life?span=3", 3), ("still-life?span=6", 5), ("plane?depth=2.5", 3)]
        {
            let (field, [low, high], display) = silent(scene, views);
            let sought = field.disparities_sought(&display);
            let [a, b] = sought.range;
            let near = 0.1 * (high - low) + 1.0;
            assert!(sought.doubt.is_none() && a < low + near && b > high - near, "{scene}: {a} .. {b}");
            let per_pixel = display.focal_length * display.picture_pixel() / field.cell(&display);
            let (reach, source) = field.reach(&display);
            assert_eq!(source, DepthSource::Measured);
            let [a, b] = reach.map(|z| z / per_pixel);
            let near = 0.1 * (high - low) + 0.6;
            assert!((a - low).abs() < near && (b - high).abs() < near, "{scene}: {a} .. {b}, not {low} .. {high}");
        }
    }

    #[test]
    fn dense_and_flat_views_are_sought_within_two_pixels() {
        let (mut field, _, display) = silent("still-life", 9);
        assert_eq!(field.disparities_sought(&display).range, USUAL);
        field.planes.iter_mut().flatten().for_each(|view| view.fill(0.3));
        assert_eq!(field.disparities_sought(&display).range, USUAL);
        field.planes.iter_mut().flatten().for_each(|view| view.fill(0.0));
        assert_eq!(field.disparities_sought(&display).range, USUAL);
    }

    #[test]
    fn one_row_of_views_is_enough() {
        let (field, [low, high], display) = silent("still-life?span=3", 3);
        let planes = field.planes.iter().map(|views| views[3..6].to_vec()).collect();
        let row = LightField { grid: [1, 3], planes, view_pitch: Some(field.cell(&display)), ..field };
        let [a, b] = row.disparities_sought(&display).range;
        assert!((a - low).abs() < 2.0 && (b - high).abs() < 2.0, "{a} .. {b}, not {low} .. {high}");
    }

    /// Thin blades that hide each other by eight pixels from view to view: what is lost is not passed over in silence.
    #[test]
    fn what_neighbouring_views_do_not_show_again_is_doubted() {
        let (field, _, display) = silent("dense-grass?span=6", 5);
        assert!(field.disparities_sought(&display).doubt.is_some());
        assert!(matches!(field.reach(&display).1, DepthSource::Doubtful(1..45)));
    }
}
