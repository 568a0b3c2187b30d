//! Continues the far surface behind pixels near a tear, as its mirror image at the rim of the tear.

use crate::relief::{ABSENT, Args, COLORS, color};
use crate::relief_jump::offset;
use rayon::prelude::*;

/// Distances from a pixel to the places that may give its color. They are multiples of the distance of the rim, and
/// pixels that are added. Colors at an outline are mixed, so the mirror is a little further out.
const TRIES: [(f32, f32); 5] = [(2.0, 2.0), (1.5, 2.0), (1.0, 3.0), (1.0, 2.0), (1.0, 1.0)];

/// Writes the surface behind `front` from the rims that [`relief_jump`](crate::relief_jump::relief_jump) found. A pixel
/// with nothing behind it gets [`ABSENT`].
pub fn relief_fill(args: &Args, front: &[f32], nearest: &[u32], filled: &mut [f32]) {
    let plane = args.plane as usize;
    let (disparity, colors) = front.split_at(plane);
    let (depths, behind) = filled.split_at_mut(plane);
    let surface = depths.par_iter_mut().zip(behind.par_chunks_exact_mut(COLORS));
    surface.take(args.pixels()).enumerate().for_each(|(p, (depth, behind))| {
        let Some((i, j)) = offset(nearest[plane + p]) else {
            (*depth, behind[0], behind[1], behind[2]) = (ABSENT, 0.0, 0.0, 0.0);
            return;
        };
        let (i, j) = (i64::from(i), i64::from(j));
        let (x, y) = args.place(p);
        let rim = args.at(x + i, y + j).unwrap_or(p);
        let level = disparity[rim];
        let length = ((i * i + j * j) as f32).sqrt();
        // Along an axis, the direction is exact.
        let unit = |d: i64| if i == 0 || j == 0 { d.signum() as f32 } else { d as f32 / length };
        let out = |(times, more): (f32, f32)| {
            let along = |d: i64| (d as f32 * times + unit(d) * more).round() as i64;
            args.at(x + along(i), y + along(j)).filter(|q| (disparity[*q] - level).abs() <= args.tear)
        };
        let from = TRIES.into_iter().find_map(out).unwrap_or(rim);
        *depth = level;
        behind.copy_from_slice(&color(colors, from));
    });
}
