//! Finds rows and columns of views that have one running number, by the jump of the picture at the end of a row.

use crate::LightField;
use crate::light_field::resize::{Fit, Resize};
use rayon::prelude::*;

/// Pixels along the longer side of the compared pictures. They are few, so that distant views still have something in
/// common.
const PIXELS: usize = 32;
/// A jump from row to row is larger than any step within a row by at least this factor.
const JUMP: f64 = 1.2;
/// Steps along one row differ by at most this factor.
const EVEN: f64 = 1.5;
/// Least difference of views that are not the same.
const LEAST: f64 = 1e-4;

/// Returns a function that gives the difference of two views by their indices in the field.
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

/// Returns true if every second row clearly runs backwards. Each row then begins where the previous one ended and ends
/// where it began, and both places are far apart.
pub(crate) fn is_serpentine(field: &LightField, [rows, columns]: [usize; 2]) -> bool {
    let Some(apart) = distance(field).filter(|_| rows > 1 && columns > 2) else { return false };
    (1..rows).all(|r| {
        let [before, here, after] = [r - 1, r, r + 1].map(|r| r * columns);
        let down = apart(before, here);
        EVEN * apart(here - 1, here).max(apart(before, after - 1)) < down && down > LEAST
    })
}

/// Returns the rows and columns that the pictures clearly show, for views in the order of their number. It returns
/// `None` if they show none.
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
            // Views with every second row backwards change as evenly as one row, but return to their start.
            let comes_back = widths().any(|c| is_serpentine(field, [count / c, c]));
            (most < EVEN * least && apart(0, count - 1) > 2.0 * most && !comes_back).then_some([1, count])
        }
    }
}
