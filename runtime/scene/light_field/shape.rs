//! Rows and columns of views that have one running number: where a row ends, the picture jumps.

use crate::LightField;
use crate::light_field::resize::{Fit, Resize};
use rayon::prelude::*;

/// Pixels along the longer side of what is compared: so few that far views still have something in common.
const PIXELS: usize = 32;
/// A jump from row to row is larger than any step within a row by as much.
const JUMP: f64 = 1.2;
/// Steps along one row differ by no more.
const EVEN: f64 = 1.5;
/// What views differ by that are not the same.
const LEAST: f64 = 1e-4;

/// How far two views are from each other, by their numbers, as they come in the field.
fn distance(field: &LightField) -> Option<impl Fn(usize, usize) -> f64> {
    let (h, w) = (field.height, field.width);
    let times = (h.max(w) as f64 / PIXELS as f64).max(1.0);
    let resize = Resize::new([h, w], [h, w].map(|n| ((n as f64 / times).round() as usize).max(1)), Fit::Stretch);
    let root = |view: &Vec<f32>| resize.apply(view).into_iter().map(|v| v.max(0.0).sqrt()).collect::<Vec<f32>>();
    let small: Vec<Vec<f32>> = field.planes.first()?.par_iter().map(root).collect();
    Some(move |a: usize, b: usize| {
        small[a].iter().zip(&small[b]).map(|(a, b)| f64::from((a - b).abs())).sum::<f64>() / small[a].len() as f64
    })
}

/// Whether every second row clearly runs backwards: it begins where the one before ended, ends where that one began, and both are
/// far apart.
pub(crate) fn is_serpentine(field: &LightField, [rows, columns]: [usize; 2]) -> bool {
    let Some(apart) = distance(field).filter(|_| rows > 1 && columns > 2) else { return false };
    (1..rows).all(|r| {
        let [before, here, after] = [r - 1, r, r + 1].map(|r| r * columns);
        let down = apart(before, here);
        EVEN * apart(here - 1, here).max(apart(before, after - 1)) < down && down > LEAST
    })
}

/// Rows and columns that the pictures clearly show, of views in the order of their number; none where they show none.
pub(crate) fn shape(field: &LightField) -> Option<[usize; 2]> {
    let (apart, count) = (distance(field)?, field.planes[0].len());
    if count < 3 {
        return None;
    }
    let steps: Vec<f64> = (1..count).map(|k| apart(k - 1, k)).collect();
    let (least, most) = steps.iter().fold((f64::INFINITY, 0.0f64), |(a, b), &d| (a.min(d), b.max(d)));
    let jump = |columns: usize| {
        let ends = |k: &usize| (k + 1).is_multiple_of(columns);
        let across = (0..count - 1).filter(ends).map(|k| steps[k]).fold(f64::INFINITY, f64::min);
        let within = (0..count - 1).filter(|k| !ends(k)).map(|k| steps[k]).fold(0.0, f64::max);
        across / within.max(1e-9)
    };
    let widths = || (2..count).filter(|c| count.is_multiple_of(*c));
    let best = widths().max_by(|&a, &b| jump(a).total_cmp(&jump(b)));
    match best {
        Some(columns) if jump(columns) > JUMP && most > LEAST => Some([count / columns, columns]),
        _ => {
            // Every second row backwards changes as evenly as one row, but comes back to where it was.
            let comes_back = widths().any(|c| is_serpentine(field, [count / c, c]));
            (most < EVEN * least && apart(0, count - 1) > 2.0 * most && !comes_back).then_some([1, count])
        }
    }
}
