//! Finds the disparities of surfaces without texture by their edges.
//!
//! Windows on such a surface have no unique disparity. A flat square in front of a textured background is like the
//! background at the background's disparity, if each window may choose one of two opposite views, because one of them
//! shows it flat. In both views at once, its edges are alike only at its own disparity.

use crate::depth::sweep::{OUTLIER, Sweep};
use rayon::prelude::*;

/// Pixels from the middle of the compared windows to their edge.
pub(crate) const WINDOW: usize = 2;
/// A match is off by at most this many pixels, as computed from the slope of the light.
pub(crate) const OFF: f32 = 0.5;
/// Pixels by which a disparity may be beyond the range that explains it.
pub(crate) const OFF_RANGE: f64 = 0.6;
/// A window is alike in all views if it differs by at most as much as this many pixels of movement would cause.
const ALIKE: f32 = 0.25;
/// Widest range of disparities, in pixels, at which a window may be alike. The edge of a surface is alike within the
/// width of a window.
const WIDEST: f64 = 6.0;
/// Pixels beyond the found range in which surfaces are searched.
const FARTHEST: f64 = 8.0;
/// Disparities that are compared between two candidates.
const BETWEEN: u32 = 5;
/// Disparities are as likely as the likeliest if they differ by at most this many pixels of movement.
const LIKEST: f32 = 0.02;
/// Least mean light of a window, square root of the brightest. Between points on black, darkness is alike at many
/// disparities.
const LIT: f32 = 0.25;
/// Number of windows that must agree, and pixels within which they agree, to show a surface.
const LEAST: usize = 12;
const TOGETHER: f64 = 0.5;

/// Extends the found range of disparities to surfaces beyond it that edges show.
///
/// The `ranges` are the searched one and the found one. The `slopes` of windows must be above `least` to show anything.
/// The likeliest disparity of each window is `best`, and disparities have the distance `step`.
pub(crate) fn extended(
    sweep: &Sweep,
    slopes: &[f32],
    least: f32,
    [searched, [low, high]]: [[f64; 2]; 2],
    step: f64,
    best: impl Fn(usize) -> f64 + Sync,
) -> [f64; 2] {
    let (h, w) = (sweep.height, sweep.width);
    if h <= 2 * WINDOW || w <= 2 * WINDOW {
        return [low, high];
    }
    let within = |d: f64| d >= low - OFF_RANGE && d <= high + OFF_RANGE;
    let count = ((searched[1] - searched[0]) / step).ceil() as usize + 1;
    let all: Vec<f64> = (0..count).map(|k| searched[0] + k as f64 * step).collect();
    let (inside, mut outside): (Vec<f64>, Vec<f64>) = all.into_iter().partition(|d| within(*d));
    let beyond = |d: f64| (low - d).max(d - high);
    outside.retain(|d| beyond(*d) <= FARTHEST);
    outside.sort_by(|a, b| beyond(*a).total_cmp(&beyond(*b)));
    let shown = |p: usize| {
        let (y, x) = (p / w, p % w);
        let inner = y >= WINDOW && x >= WINDOW && y + WINDOW < h && x + WINDOW < w;
        let slope = slopes[p];
        if !inner || slope <= least {
            return None;
        }
        let rows = (y - WINDOW..=y + WINDOW).flat_map(|y| &sweep.center[y * w + x - WINDOW..][..2 * WINDOW + 1]);
        if rows.sum::<f32>() < LIT * ((2 * WINDOW + 1) * (2 * WINDOW + 1)) as f32 {
            return None;
        }
        let differs = |d: f64| over_all(sweep, [y, x], d);
        let likely = best(p);
        let is_alike = |d: &f64| differs(*d) <= OFF * slope;
        if (within(likely) && is_alike(&likely)) || inside.iter().any(is_alike) {
            return None;
        }
        // A window that is alike nearly everywhere is dark, or flat without an edge.
        let alike: Vec<f64> = outside.iter().copied().filter(|d| differs(*d) <= ALIKE * slope).collect();
        let found = *alike.first().filter(|_| alike.len() as f64 * step <= WIDEST)?;
        // The result is the middle of the likeliest disparities, also between candidates. An edge that is drawn in
        // whole pixels is alike from one candidate to the next.
        let ends = alike.iter().fold([found; 2], |[a, b], d| [a.min(*d), b.max(*d)]);
        let count = (f64::from(BETWEEN) * ((ends[1] - ends[0]) / step + 2.0)).round() as usize;
        let fine: Vec<(f64, f32)> = (0..=count)
            .map(|k| ends[0] - step + k as f64 * step / f64::from(BETWEEN))
            .map(|d| (d, differs(d)))
            .collect();
        let least = fine.iter().map(|(_, differs)| *differs).fold(f32::INFINITY, f32::min);
        let mut likest = fine.iter().filter(|(_, differs)| *differs <= least + LIKEST * slope).map(|(d, _)| *d);
        let first = likest.next()?;
        Some(0.5 * (first + likest.next_back().unwrap_or(first)))
    };
    let mut votes: Vec<f64> = (0..h * w).into_par_iter().filter_map(shown).collect();
    votes.sort_by(f64::total_cmp);
    outermost(&votes, LEAST, TOGETHER).map_or([low, high], |[first, last]| [first.min(low), last.max(high)])
}

/// Returns the middle one of the first `count` ascending values that are `within` this distance of each other, and of
/// the last such values.
pub(crate) fn outermost(sorted: &[f64], count: usize, within: f64) -> Option<[f64; 2]> {
    let together = |run: &&[f64]| run[count - 1] - run[0] <= within;
    let (first, last) = (sorted.windows(count).find(together)?, sorted.windows(count).rfind(together)?);
    Some([first[count / 2], last[count / 2]])
}

/// Returns the difference of a window at a disparity over all views, in the units of a sweep's costs. The mean of
/// opposite arms counts.
fn over_all(sweep: &Sweep, [y, x]: [usize; 2], disparity: f64) -> f32 {
    let (h, w) = (sweep.height as i64, sweep.width as i64);
    let arm = |arm: &Vec<(isize, isize, Vec<f32>)>| {
        let mut sum = 0.0;
        for (r, c, view) in arm {
            let steps = if *r == 0 { *c } else { *r };
            let away = -disparity * steps as f64;
            let first = away.floor();
            let (first, part) = (first as i64, (away - first) as f32);
            for j in y - WINDOW..=y + WINDOW {
                for i in x - WINDOW..=x + WINDOW {
                    let at = |more: i64| {
                        let (j, i) = if *r == 0 { (j as i64, i as i64 + more) } else { (j as i64 + more, i as i64) };
                        view[(j.clamp(0, h - 1) * w + i.clamp(0, w - 1)) as usize]
                    };
                    let (a, b) = (at(first), at(first + 1));
                    let seen = a + part * (b - a);
                    sum += (seen - sweep.center[j * sweep.width + i]).abs().min(OUTLIER);
                }
            }
        }
        sum / arm.len().max(1) as f32
    };
    let pair = |pair: usize| {
        let arms = [&sweep.arms[pair], &sweep.arms[pair + 1]];
        let count = arms.iter().filter(|a| !a.is_empty()).count();
        arms.iter().map(|a| arm(a)).sum::<f32>() / count.max(1) as f32
    };
    pair(0) + pair(2)
}
