//! Averages the continued far surface over 3 x 3 pixels. Neighbors that are mirrored at different rims can differ, and
//! the average avoids lines.

use crate::relief::{ABSENT, AROUND, Args, COLORS, color};
use rayon::prelude::*;

/// Writes the surface `hidden` from the surface of [`relief_fill`](crate::relief_fill::relief_fill).
pub fn relief_soften(args: &Args, filled: &[f32], hidden: &mut [f32]) {
    let plane = args.plane as usize;
    let (disparity, colors) = filled.split_at(plane);
    let (depths, soft) = hidden.split_at_mut(plane);
    let surface = depths.par_iter_mut().zip(soft.par_chunks_exact_mut(COLORS));
    surface.take(args.pixels()).enumerate().for_each(|(p, (depth, soft))| {
        *depth = disparity[p];
        let (mut sum, mut count) = (color(colors, p), 1.0);
        if disparity[p] > ABSENT {
            let (x, y) = args.place(p);
            for (dx, dy) in AROUND {
                let like = |q: &usize| disparity[*q] > ABSENT && (disparity[*q] - disparity[p]).abs() <= args.tear;
                let Some(q) = args.at(x + dx, y + dy).filter(like) else { continue };
                sum.iter_mut().zip(color(colors, q)).for_each(|(sum, c)| *sum += c);
                count += 1.0;
            }
        }
        soft.copy_from_slice(&sum.map(|sum| sum / count));
    });
}
