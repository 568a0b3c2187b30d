//! Finds the range of a light field's disparities from coarse to fine, if the scene does not state it.
//!
//! Small copies of the central view are compared with its nearest neighbors over every disparity up to a third of the
//! picture. Larger copies are then compared with farther views over the found range. A pixel counts only under three
//! conditions. It is alike in the views of both axes, it is alike at no other disparity, and its standard error is
//! small (`subpixel`). The range ends where enough of these pixels agree. It is doubtful if too much of the detail is
//! not among them, because that detail may be at any depth.

use crate::depth::flat::{OFF, OFF_RANGE, WINDOW};
use crate::depth::subpixel::Subpixel;
use crate::depth::sweep::{Arm, Sweep, lowest, reach_within};
use crate::light_field::resize::Resize;
use crate::{Fit, LightField, SceneError, depth::flat};
use eyebox_optics::{Display, depths_in_words};
use rayon::prelude::*;

/// Range in which disparities are searched if nothing shows any, in pixels between neighboring views.
pub(crate) const USUAL: [f64; 2] = [-2.0, 2.0];

/// Pixels along the longer side of the coarse copies, and of the fine ones.
const COARSE: usize = 128;
const FINE: usize = 256;
/// Steps to the farthest view with which the fine copies are compared.
const STEPS: usize = 3;
/// Another disparity must be less alike than the best match by at least this factor, and by at least this many pixels.
const UNLIKE: [f32; 2] = [2.0, 0.4];
/// Windows whose slopes sum to this may be certain (5 x 5 pixels of 8 bits that differ from their neighbors by one).
const SLOPE: f32 = 0.1;
/// Largest standard error of certain windows, in pixels between neighboring views.
const ERROR: f64 = 0.06;
/// Share and number of the certain pixels that are not a coincidence, if they are within this many pixels of each
/// other.
const ENOUGH: f64 = 0.005;
const LEAST: usize = 12;
const TOGETHER: f64 = 0.1;
/// A range is trusted if this share of the detail is certain.
const TRUSTED: f64 = 0.7;

/// Detail whose disparity is not unique is explained if some disparity of the range is alike. A range is plausible if
/// it explains the first share of the detail and the second share is certain.
const PLAUSIBLE: [f64; 2] = [0.9, 0.3];
/// Smallest range of disparities, in pixels of the light field, for a search in which disparities are not unique within
/// more.
const NARROWEST: f64 = 4.0;
/// Drawn content is at an end of the coarse range if the fine range ends this many pixels earlier.
const LOST: f64 = 0.4;
/// Light of views that differs by at most this is the same, in square root of light.
const SAME: f32 = 4e-3;

/// The disparities that the views show.
#[derive(Debug, Clone, Copy)]
struct Found {
    /// Smallest and largest disparity, in pixels between neighboring views. It is `None` if nothing is certain.
    range: Option<[f64; 2]>,
    /// The same range extended to flat surfaces, which only their edges show.
    beyond: [f64; 2],
    /// The share of detail whose disparity is certain. It is `None` if there is no detail.
    share: Option<f64>,
    /// The share of detail that some disparity of the range explains.
    explained: f64,
}

impl Found {
    fn is_trusted(&self) -> bool {
        self.share.is_none_or(|share| share >= TRUSTED)
    }
}

/// The source of a range of depths.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum DepthSource {
    /// The scene or its settings file states the range.
    Stated,
    /// The range is measured in the central view.
    Measured,
    /// The range is measured and plausible. It explains the views, but only this percentage of their detail has a
    /// unique disparity.
    Plausible(u8),
    /// The range is measured and not trusted. Only this percentage of its detail is found again with certainty in the
    /// neighboring views.
    Doubtful(u8),
}

impl DepthSource {
    /// Returns the farthest and the nearest depth in meters if this source is certain enough. `focal_length` is in
    /// meters.
    ///
    /// # Errors
    /// [`SceneError::Depth`] if they are doubtful.
    pub fn sure(self, depth: [f64; 2], focal_length: f64) -> Result<[f64; 2], SceneError> {
        match self {
            Self::Doubtful(percent) => Err(SceneError::doubtful_depth(depth, percent, focal_length)),
            Self::Plausible(percent) => {
                let words = depths_in_words(depth, focal_length);
                tracing::warn!(
                    "the depth of the scene is measured as {words} from {percent} % of its detail. The rest is flat \
                     or repeats itself, so state the depths if these are wrong"
                );
                Ok(depth)
            }
            Self::Stated | Self::Measured => Ok(depth),
        }
    }
}

/// Measured disparities, in pixels between neighboring views at this resolution.
pub(crate) struct Measured {
    /// The range from the farthest to the nearest. It is `None` if the pictures show nothing.
    pub range: Option<[f64; 2]>,
    /// The trust in the range, which is measured, plausible or doubtful.
    pub trust: DepthSource,
}

impl LightField {
    /// Measures the disparities of the views, without regard to stated ones.
    pub(crate) fn measured(&self) -> Measured {
        let first = look(self, None);
        let shows_something = first.range.is_some() || !first.is_trusted();
        if shows_something && self.stands_still() {
            return Measured { range: Some([0.0; 2]), trust: DepthSource::Measured };
        }
        if first.is_trusted() {
            return Measured { range: first.range, trust: DepthSource::Measured };
        }
        let percent = |share: f64| (100.0 * share) as u8;
        // Drawn content is flat or repetitive. Windows are compared as a whole, within fewer and fewer pixels.
        let mut within = self.height.max(self.width) as f64 / 9.0;
        let mut best = first;
        while within >= NARROWEST {
            let found = look(self, Some(within));
            let share = |found: &Found| found.share.filter(|_| found.range.is_some()).unwrap_or(0.0);
            if found.range.is_some() && found.is_trusted() {
                return Measured { range: found.range, trust: DepthSource::Plausible(percent(share(&found))) };
            }
            if share(&found) > share(&best) {
                best = found;
            }
            within /= 3.0;
        }
        let sure = best.share.unwrap_or(0.0);
        let trust = match best.range {
            Some(_) if best.explained >= PLAUSIBLE[0] && sure >= PLAUSIBLE[1] => DepthSource::Plausible(percent(sure)),
            _ => DepthSource::Doubtful(percent(first.share.unwrap_or(0.0))),
        };
        Measured { range: best.range.filter(|_| !matches!(trust, DepthSource::Doubtful(_))).or(first.range), trust }
    }

    /// Returns true if all views of the central row and column equal the central one, up to rounding.
    fn stands_still(&self) -> bool {
        let [rows, columns] = self.grid;
        let (r, c) = (rows / 2, columns / 2);
        let mut others = (0..columns).map(|k| r * columns + k).chain((0..rows).map(|k| k * columns + c));
        let brightest = self.planes.iter().flatten().flatten().copied().fold(f32::MIN_POSITIVE, f32::max);
        let root = |v: f32| (v / brightest).max(0.0).sqrt();
        others.all(|view| {
            let same = |views: &Vec<Vec<f32>>| {
                let both = views[view].iter().zip(&views[r * columns + c]);
                both.map(|(a, b)| (root(*a) - root(*b)).abs()).fold(0.0, f32::max) <= SAME
            };
            self.planes.iter().all(same)
        })
    }

    /// Returns the range in which disparities are searched, in pixels between neighboring views at this resolution. It
    /// is the range that the scene states on `display`, otherwise a little more than the measured one.
    pub(crate) fn disparities_sought(&self, display: &Display) -> [f64; 2] {
        let per_pixel = display.focal_length * display.picture_pixel() / self.cell(display);
        if let Some(stated) = self.depth_range(display) {
            return stated.map(|z| z / per_pixel);
        }
        let around = |[low, high]: [f64; 2]| {
            let margin = 0.05 * (high - low) + 0.25;
            [low - margin, high + margin]
        };
        self.measured().range.map_or(USUAL, around)
    }

    /// Returns the relevant depths on `display` in meters, with the farthest first. They are the requested, stated or
    /// measured depths, in this order.
    ///
    /// # Errors
    /// [`SceneError::Depth`] if nothing is requested or stated, and the views show too little.
    pub fn depths(&self, display: &Display, asked: Option<[f64; 2]>) -> Result<[f64; 2], SceneError> {
        asked_or_found(asked, || self.reach(display), display.focal_length)
    }
}

/// Returns the farthest and the nearest depth in meters behind a lens of `focal_length`, as requested or as found.
///
/// # Errors
/// [`SceneError::Depth`] if nothing is requested, and the found depths are doubtful.
pub fn asked_or_found(
    asked: Option<[f64; 2]>,
    find: impl FnOnce() -> ([f64; 2], DepthSource),
    focal_length: f64,
) -> Result<[f64; 2], SceneError> {
    if let Some([a, b]) = asked {
        return Ok([a.min(b), a.max(b)]);
    }
    let (found, source) = find();
    source.sure(found, focal_length)
}

/// Returns the light of a view in all colors together, in units of the brightest.
pub(crate) fn mean_light(field: &LightField) -> impl Fn(usize) -> Vec<f32> {
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

/// Measures the disparities of the views, first coarse and then fine. The range is a third of the picture, or
/// `by_window` pixels with windows that are compared as a whole.
fn look(field: &LightField, by_window: Option<f64>) -> Found {
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
        let found = ends(&sweep, range, by_window.is_some());
        Found { range: found.range.map(|r| r.map(|d| d / scale)), beyond: found.beyond.map(|d| d / scale), ..found }
    };
    let third = by_window.unwrap_or(longer as f64 / 3.0);
    let coarse = within(at(COARSE), [-third, third], 1);
    let Some([low, high]) = coarse.range else { return coarse };
    let margin = (longer as f64 / COARSE as f64).max(1.0) + 0.1 * (high - low);
    let fine = within(at(FINE), [low - margin, high + margin], STEPS);
    let mut found = if fine.range.is_some() { fine } else { coarse };
    // Windows that cover the end of a flat surface see it only in the nearest views.
    if let (Some([a, b]), true) = (found.range, by_window.is_some()) {
        found.range = Some([if low < a - LOST { low } else { a }, if high > b + LOST { high } else { b }]);
    }
    let [least, most] = coarse.beyond;
    // Disparities that the coarse measurement finds beyond its own range are also beyond the fine range.
    let range = found
        .range
        .map(|[a, b]| [if least < low { a.min(least) } else { a }, if most > high { b.max(most) } else { b }]);
    Found { range, ..found }
}

/// Returns the smallest and the largest disparity that enough pixels have with certainty.
fn ends(sweep: &Sweep, range: [f64; 2], by_window: bool) -> Found {
    let (h, w, reach) = (sweep.height, sweep.width, sweep.reach());
    let nothing = Found { range: None, beyond: [0.0; 2], share: None, explained: 0.0 };
    if reach == 0.0 || h.min(w) < 4 * WINDOW {
        return nothing;
    }
    let step = 0.5 / reach;
    let count = ((range[1] - range[0]) / step).ceil() as usize + 1;
    let slopes = windows(&sweep.slopes(), h, w, 1);
    let at = |d: usize| range[0] + d as f64 * step;
    let costs = match by_window {
        true => costs_by_window(sweep, count, at),
        false => windows(&sweep.costs(count, 0.0, at), h, w, count),
    };
    let mean = (slopes.iter().sum::<f32>() / slopes.len() as f32).max(1e-4);
    let detail = slopes.iter().filter(|slope| **slope > mean).count();
    // The valley of a match is one and a half pixels to each side.
    let own = (1.5 / step).ceil() as usize;
    let subpixel = Subpixel::of(sweep);
    let sure = |(p, costs): (usize, &[f32])| {
        let slope = slopes[p];
        let best = (0..count).min_by(|&a, &b| costs[a].total_cmp(&costs[b]))?;
        let alike = costs[best] <= OFF * slope && slope > mean.min(SLOPE);
        let others = (0..count).filter(|d| d.abs_diff(best) > own).map(|d| costs[d]);
        let unlike = others.fold(f32::INFINITY, f32::min);
        let guess = range[0] + (best as f64 + lowest(costs, best)) * step;
        let sure = alike && unlike >= (UNLIKE[0] * costs[best]).max(UNLIKE[1] * slope);
        let [d, error] = subpixel.refined([p / w, p % w], WINDOW, guess).filter(|_| sure)?;
        (error < ERROR).then_some((slope > mean, d))
    };
    let all: Vec<(bool, f64)> = costs.par_chunks_exact(count).enumerate().filter_map(sure).collect();
    let share = (detail > 0).then(|| all.iter().filter(|(has, _)| *has).count() as f64 / detail as f64);
    let mut all: Vec<f64> = all.into_iter().map(|(_, d)| d).collect();
    all.sort_by(f64::total_cmp);
    let enough = LEAST.max((ENOUGH * all.len() as f64) as usize);
    let Some([low, high]) = flat::outermost(&all, enough, TOGETHER) else { return Found { share, ..nothing } };
    let best = |p: usize| {
        let costs = &costs[p * count..][..count];
        (0..count).min_by(|&a, &b| costs[a].total_cmp(&costs[b])).map_or(range[0], at)
    };
    // The coarse measurement finds flat surfaces, and the fine one finds fewer.
    let beyond = match sweep.reach() > 1.0 {
        true => [low, high],
        false => flat::extended(sweep, &slopes, mean.min(SLOPE), [range, [low, high]], step, best),
    };
    let range = [low, high];
    let within: Vec<usize> =
        (0..count).filter(|d| at(*d) >= range[0] - OFF_RANGE && at(*d) <= range[1] + OFF_RANGE).collect();
    let is_explained = |p: &usize| within.iter().any(|d| costs[p * count + d] <= OFF * slopes[*p]);
    let of_detail: Vec<usize> = (0..h * w).filter(|p| slopes[*p] > mean).collect();
    let explained = of_detail.iter().filter(|p| is_explained(p)).count() as f64 / of_detail.len().max(1) as f64;
    Found { range: Some(range), beyond, share, explained }
}

/// Returns the costs of [`Sweep::costs`] summed over windows, each compared as a whole with one of two opposite arms.
/// Pixel by pixel, flat surfaces are like one of them at any disparity.
fn costs_by_window(sweep: &Sweep, count: usize, at: impl Fn(usize) -> f64 + Sync + Copy) -> Vec<f32> {
    let (h, w) = (sweep.height, sweep.width);
    let arm = |arm: usize| {
        let mut arms: [Arm; 4] = Default::default();
        arms[arm] = sweep.arms[arm].clone();
        let alone = Sweep { height: h, width: w, center: sweep.center.clone(), arms };
        windows(&alone.costs(count, 0.0, at), h, w, count)
    };
    let pair = |pair: usize| match [pair, pair + 1].map(|arm| !sweep.arms[arm].is_empty()) {
        [true, true] => {
            let mut least = arm(pair);
            least.iter_mut().zip(arm(pair + 1)).for_each(|(a, b)| *a = a.min(b));
            Some(least)
        }
        [first, second] => (first || second).then(|| arm(pair + usize::from(second))),
    };
    match (pair(0), pair(2)) {
        (Some(mut all), Some(other)) => {
            all.iter_mut().zip(other).for_each(|(a, b)| *a += b);
            all
        }
        (one, other) => one.or(other).unwrap_or_default(),
    }
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
    use crate::{DepthSource, Request, load};
    use eyebox_optics::Color;

    /// Returns a built-in scene without stated depths, its true disparities, and the display.
    fn silent(scene: &str, views: usize) -> (LightField, [f64; 2], Display) {
        let display = Display { height: 96, width: 112, ..Display::preset("paper").unwrap() };
        let request = Request { views, ..Request::new(&display, &[Color::Green]) };
        let field = load(&format!("builtin:{scene}"), &request).unwrap();
        let truth = field.disparities_sought(&display);
        (LightField { depth: None, disparity: None, ..field }, truth, display)
    }

    #[test]
    fn disparities_are_found_however_far_the_views_stand_apart() {
        for (scene, views) in
            [("still-life?span=1.5", 5), ("still-life?span=2", 5), ("plane?depth=2.5", 3), ("points?span=1.5", 5)]
        {
            let (field, [low, high], display) = silent(scene, views);
            let per_pixel = display.focal_length * display.picture_pixel() / field.cell(&display);
            let (reach, source) = field.reach(&display);
            assert_eq!(source, DepthSource::Measured, "{scene}");
            let [a, b] = reach.map(|z| z / per_pixel);
            let near = (0.1 * (high - low)).max(0.25);
            assert!((a - low).abs() < near && (b - high).abs() < near, "{scene}: {a} .. {b}, not {low} .. {high}");
            let [a, b] = field.disparities_sought(&display);
            assert!(a < low + near && b > high - near, "{scene}: {a} .. {b}");
        }
    }

    #[test]
    fn views_that_show_nothing_have_no_depth_and_no_doubt() {
        let (mut field, _, display) = silent("still-life", 9);
        for light in [0.3, 0.0] {
            field.planes.iter_mut().flatten().for_each(|view| view.fill(light));
            assert_eq!(field.disparities_sought(&display), USUAL);
            assert_eq!(field.reach(&display), ([0.0, 0.0], DepthSource::Measured));
        }
    }

    #[test]
    fn one_row_of_views_is_enough() {
        let (field, [low, high], display) = silent("still-life?span=1.5", 5);
        let planes = field.planes.iter().map(|views| views[10..15].to_vec()).collect();
        let row = LightField { grid: [1, 5], planes, view_pitch: Some(field.cell(&display)), ..field };
        let [a, b] = row.measured().range.unwrap();
        let near = 0.1 * (high - low);
        assert!((a - low).abs() < near && (b - high).abs() < near, "{a} .. {b}, not {low} .. {high}");
    }

    /// Thin blades hide each other by eight pixels from view to view. The lost content must cause doubt.
    #[test]
    fn what_neighbouring_views_do_not_show_again_is_doubted() {
        let (field, _, display) = silent("dense-grass?span=6", 5);
        assert!(matches!(field.reach(&display).1, DepthSource::Doubtful(1..65)));
        assert!(matches!(field.depths(&display, None), Err(SceneError::Depth { percent: 1..65, .. })));
        assert_eq!(field.depths(&display, Some([2e-3, -1e-3])), Ok([-1e-3, 2e-3]));
    }
}
