//! Rows and columns of views that have one running number: where a row ends, the picture jumps.

use super::LightField;
use super::resize::{Fit, Resize};
use rayon::prelude::*;

/// Pixels along the longer side of what is compared: so few that far views still have something in common.
const PIXELS: usize = 32;
/// A jump from row to row is larger than any step within a row by as much.
const JUMP: f64 = 1.2;
/// Steps along one row differ by no more.
const EVEN: f64 = 1.5;

/// Rows and columns that the pictures clearly show, of views in the order of their number; none where they show none.
pub(super) fn shape(field: &LightField) -> Option<[usize; 2]> {
    let (h, w) = (field.height, field.width);
    let times = (h.max(w) as f64 / PIXELS as f64).max(1.0);
    let resize = Resize::new([h, w], [h, w].map(|n| ((n as f64 / times).round() as usize).max(1)), Fit::Stretch);
    let views = field.planes.first()?;
    let root = |view: &Vec<f32>| resize.apply(view).into_iter().map(|v| v.max(0.0).sqrt()).collect::<Vec<f32>>();
    let small: Vec<Vec<f32>> = views.par_iter().map(root).collect();
    let apart = |a: usize, b: usize| {
        small[a].iter().zip(&small[b]).map(|(a, b)| f64::from((a - b).abs())).sum::<f64>() / small[a].len() as f64
    };
    let count = small.len();
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
    let best = (2..count).filter(|c| count.is_multiple_of(*c)).max_by(|&a, &b| jump(a).total_cmp(&jump(b)));
    match best {
        Some(columns) if jump(columns) > JUMP && most > 1e-4 => Some([count / columns, columns]),
        _ => (most < EVEN * least && apart(0, count - 1) > 2.0 * most).then_some([1, count]),
    }
}
