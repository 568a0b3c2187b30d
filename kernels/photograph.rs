//! Sums the target image of a light field by shift-and-add (OPTICS 3). The sum is
//! `accumulator = sum_v weight_v shift(view_v)`. Shifts are bilinear and periodic, on one level of the views' pyramid.
//! One pupil.
//!
//! A shift is the same for a whole view, so its four bilinear weights separate. Two along x apply while a row of views
//! is added up, and two along y apply once to the sum.

use crate::simd;
use bytemuck::{Pod, Zeroable};
use std::cell::RefCell;

/// Rows that an invocation of the shader computes at once.
pub const STRIP: u32 = 8;

/// The level of the pyramid, and the scale of the views.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct Args {
    /// Rows of the level.
    pub height: u32,
    /// Columns of the level.
    pub width: u32,
    /// Number of taps of the pupil.
    pub taps: u32,
    /// Light of the value 65535 in the views, times the norm of the weights.
    pub scale: f32,
    /// If 0, the accumulator is overwritten. If 1, the sum is added to it, for views that arrive in groups.
    pub accumulate: u32,
}

/// One view that the pupil covers. Taps with the same (`dy`, `fy`) must be neighbors.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct Tap {
    /// Index of the view.
    pub view: u32,
    /// Share of the pupil that the view has.
    pub weight: f32,
    /// Whole rows by which the content moves down, `0 .. height`.
    pub dy: u32,
    /// Whole columns by which the content moves right, `0 .. width`.
    pub dx: u32,
    /// Fraction of a row by which it moves further down, `0 ..= 1`.
    pub fy: f32,
    /// Fraction of a column by which it moves further right, `0 ..= 1`.
    pub fx: f32,
}

thread_local! {
    /// Two rows of samples, the current one and the one above.
    static ROWS: RefCell<[Vec<f32>; 2]> = const { RefCell::new([Vec::new(), Vec::new()]) };
}

/// Sums `views` (views, height, width), linear light as u16, into `accumulator`. The accumulator holds rows of the
/// level from `first_row` on.
pub fn photograph(args: &Args, views: &[u16], taps: &[Tap], first_row: usize, accumulator: &mut [f32]) {
    let w = args.width as usize;
    if args.accumulate == 0 {
        accumulator.fill(0.0);
    }
    let rows = accumulator.len() / w;
    if rows == 0 {
        return;
    }
    ROWS.with_borrow_mut(|[above, here]| {
        [&mut *above, &mut *here].into_iter().for_each(|row| row.resize(w, 0.0));
        add_views(args, views, taps, first_row, accumulator, [above, here]);
    });
}

/// Adds the views of all taps. `above` and `here` are memory for one row each.
fn add_views(
    args: &Args,
    views: &[u16],
    taps: &[Tap],
    first_row: usize,
    accumulator: &mut [f32],
    [mut above, mut here]: [&mut Vec<f32>; 2],
) {
    let (h, w) = (args.height as usize, args.width as usize);
    for group in taps.chunk_by(|a, b| a.dy == b.dy && a.fy == b.fy) {
        let (dy, fy) = (group[0].dy as usize, group[0].fy);
        let source = |y: usize| (first_row + y + h - dy % h) % h;
        simd(
            #[inline(always)]
            || {
                blend(args, views, group, (source(0) + h - 1) % h, above);
                for (y, out) in accumulator.chunks_exact_mut(w).enumerate() {
                    blend(args, views, group, source(y), here);
                    for ((out, a), b) in out.iter_mut().zip(&*here).zip(&*above) {
                        *out += (1.0 - fy) * a + fy * b;
                    }
                    std::mem::swap(&mut above, &mut here);
                }
            },
        );
    }
}

/// Computes `out = sum over the group of weight * (row moved right by dx + fx)` for one row of the level.
#[inline(always)]
fn blend(args: &Args, views: &[u16], group: &[Tap], row: usize, out: &mut [f32]) {
    let (h, w) = (args.height as usize, args.width as usize);
    out.fill(0.0);
    for tap in group {
        let line = &views[(tap.view as usize * h + row) * w..][..w];
        let weight = tap.weight * args.scale;
        let (near, far) = (weight * (1.0 - tap.fx), weight * tap.fx);
        let dx = tap.dx as usize % w;
        // Column x reads x - dx and x - dx - 1. That is two runs without a wrap, and the column at which the pair
        // wraps.
        out[dx] += near * f32::from(line[0]) + far * f32::from(line[w - 1]);
        let (left, right) = out.split_at_mut(dx);
        add_run(&mut right[1..], &line[1..w - dx], &line[..w - dx - 1], near, far);
        if dx > 0 {
            add_run(left, &line[w - dx..], &line[w - dx - 1..w - 1], near, far);
        }
    }
}

#[inline(always)]
fn add_run(out: &mut [f32], here: &[u16], before: &[u16], near: f32, far: f32) {
    for ((out, a), b) in out.iter_mut().zip(here).zip(before) {
        *out += near * f32::from(*a) + far * f32::from(*b);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// Compared with the formula in float64.
        #[test]
        fn is_shift_and_add(h in 1usize..9, w in 1usize..40, moves in prop::collection::vec((0u32..9, 0u32..40, 0.0f32..1.0, 0.0f32..1.0, 0.1f32..1.0), 1..5), seed in 0u32..1000) {
            let taps: Vec<Tap> = moves.iter().enumerate().map(|(i, &(dy, dx, fy, fx, weight))| Tap { view: i as u32, weight, dy: dy % h as u32, dx: dx % w as u32, fy, fx }).collect();
            let views: Vec<u16> = (0..taps.len() * h * w).map(|i| ((i as u32 + seed).wrapping_mul(2_654_435_761) >> 16) as u16).collect();
            let args = Args { height: h as u32, width: w as u32, taps: taps.len() as u32, scale: 1.0 / 65535.0, accumulate: 0 };
            let mut got = vec![f32::NAN; h * w];
            let cut = h / 2;
            let (top, bottom) = got.split_at_mut(cut * w);
            photograph(&args, &views, &taps, 0, top);
            photograph(&args, &views, &taps, cut, bottom);
            for y in 0..h {
                for x in 0..w {
                    let mut want = 0.0;
                    for t in &taps {
                        let at = |dy: usize, dx: usize| {
                            let (r, c) = ((y + 2 * h - t.dy as usize - dy) % h, (x + 2 * w - t.dx as usize - dx) % w);
                            f64::from(views[(t.view as usize * h + r) * w + c]) / 65535.0
                        };
                        let (fy, fx) = (f64::from(t.fy), f64::from(t.fx));
                        want += f64::from(t.weight) * ((1.0 - fy) * ((1.0 - fx) * at(0, 0) + fx * at(0, 1)) + fy * ((1.0 - fx) * at(1, 0) + fx * at(1, 1)));
                    }
                    prop_assert!((f64::from(got[y * w + x]) - want).abs() < 1e-5, "({}, {}): {} {}", y, x, got[y * w + x], want);
                }
            }
        }
    }
}
