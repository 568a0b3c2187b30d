//! Finds for each pixel the nearest pixel on the far rim of a tear, within reach.
//!
//! This is jump flooding (Rong and Tan 2006): each pixel takes the best of the results of its eight neighbors at a
//! distance, which becomes shorter from run to run. A pixel has two results. The first one is the nearest rim, which it
//! passes on. The second one is the nearest rim that is farther from the camera than the pixel itself.

use crate::relief::{AROUND, Args};
use rayon::prelude::*;

/// The pixel is a rim itself.
pub const HERE: u32 = 0;
/// The pixel has no rim within reach.
pub const NOWHERE: u32 = 0x8000_8000;

/// Returns the columns and rows to a rim, which are two words of 16 bits.
pub(crate) fn offset(stored: u32) -> Option<(i32, i32)> {
    let part = |bits: u32| i32::from(bits as u16 as i16);
    (stored != NOWHERE).then(|| (part(stored), part(stored >> 16)))
}

fn stored((x, y): (i32, i32)) -> u32 {
    u32::from(x as i16 as u16) | u32::from(y as i16 as u16) << 16
}

/// A result of a pixel, with its squared distance.
#[derive(Clone, Copy)]
struct Best {
    stored: u32,
    length: i32,
}

impl Best {
    fn of(stored: u32) -> Self {
        Self { stored, length: offset(stored).map_or(i32::MAX, |(x, y)| x * x + y * y) }
    }
}

/// Writes `to` (2, plane), the offsets to both rims, from the ones at `step` rows or columns.
pub fn relief_jump(args: &Args, step: u32, front: &[f32], from: &[u32], to: &mut [u32]) {
    let (plane, [tall, wide]) = (args.plane as usize, args.size().map(|n| n as i32));
    let reach = args.reach as i32;
    let around = AROUND.map(|(dx, dy)| (step as i32 * dx as i32, step as i32 * dy as i32));
    let (any, own) = to.split_at_mut(plane);
    let rows = any.par_chunks_mut(wide as usize).zip(own.par_chunks_mut(wide as usize)).take(tall as usize);
    rows.enumerate().for_each(|(y, (to_any, to_own))| {
        let y = y as i32;
        for x in 0..wide {
            let at = |x: i32, y: i32| y as usize * wide as usize + x as usize;
            let p = at(x, y);
            let (mut any, mut own) = (Best::of(from[p]), Best::of(from[plane + p]));
            for (dx, dy) in around {
                if x + dx < 0 || x + dx >= wide || y + dy < 0 || y + dy >= tall {
                    continue;
                }
                let q = at(x + dx, y + dy);
                let both = [from[q], from[plane + q]];
                // Many pixels have the same rim twice.
                let count = if both[0] == both[1] { 1 } else { 2 };
                for candidate in &both[..count] {
                    let Some((i, j)) = offset(*candidate) else { continue };
                    let (i, j) = (i + dx, j + dy);
                    // The products of larger numbers would not fit.
                    if i.abs() > reach || j.abs() > reach {
                        continue;
                    }
                    let length = i * i + j * j;
                    if length > reach * reach || length >= any.length.max(own.length) {
                        continue;
                    }
                    let found = Best { stored: stored((i, j)), length };
                    // Most neighbors have the same rim.
                    if found.stored == any.stored || found.stored == own.stored {
                        continue;
                    }
                    if length < any.length {
                        any = found;
                    }
                    if length < own.length && front[at(x + i, y + j)] < front[p] - args.tear {
                        own = found;
                    }
                }
            }
            (to_any[x as usize], to_own[x as usize]) = (any.stored, own.stored);
        }
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A near disk on a far ground. Every pixel of the disk finds a rim that is at most a little farther than the
    /// nearest one.
    #[test]
    fn pixels_behind_which_the_ground_continues_find_its_rim() {
        let args = Args::new([60, 80], [0.0, 10.0], 3.0);
        let [tall, wide] = args.size();
        let near = |p: usize| (p / wide).abs_diff(tall / 2).pow(2) + (p % wide).abs_diff(wide / 2).pow(2) <= 20 * 20;
        let front: Vec<f32> = (0..args.plane as usize).map(|p| if near(p) { 10.0 } else { 0.0 }).collect();
        let is_rim = |p: usize| {
            let (x, y) = args.place(p);
            !near(p) && AROUND.iter().any(|(dx, dy)| args.at(x + dx, y + dy).is_some_and(near))
        };
        let rims: Vec<usize> = (0..args.pixels()).filter(|p| is_rim(*p)).collect();
        let plane = args.plane as usize;
        let mut found = vec![NOWHERE; 2 * plane];
        rims.iter().for_each(|rim| found[*rim] = HERE);
        let steps: Vec<u32> = args.steps([0.0, 10.0]).collect();
        assert_eq!(steps, [32, 16, 8, 4, 2, 1]);
        for step in steps {
            let mut next = vec![7; 2 * plane];
            relief_jump(&args, step, &front, &found, &mut next);
            found = next;
        }
        for p in 0..args.pixels() {
            let (x, y) = args.place(p);
            let distance = |rim: &usize| {
                let (i, j) = args.place(*rim);
                (i - x).pow(2) + (j - y).pow(2)
            };
            let nearest = rims.iter().map(distance).min().unwrap();
            match offset(found[plane + p]) {
                Some((i, j)) => {
                    assert!(near(p) && is_rim(args.at(x + i64::from(i), y + i64::from(j)).unwrap()));
                    let length = ((i * i + j * j) as f64).sqrt();
                    assert!(length < (nearest as f64).sqrt() + 1.0, "{length} {nearest}");
                }
                None => assert!(!near(p)),
            }
        }
        assert_eq!(args.steps([2.0, 2.4]).count(), 0);
    }
}
