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
pub(crate) fn offset(stored: u32) -> Option<(i64, i64)> {
    let part = |bits: u32| i64::from(bits as u16 as i16);
    (stored != NOWHERE).then(|| (part(stored), part(stored >> 16)))
}

fn stored((x, y): (i64, i64)) -> u32 {
    u32::from(x as i16 as u16) | u32::from(y as i16 as u16) << 16
}

/// Writes `to` (2, plane), the offsets to both rims, from the ones at `step` rows or columns.
pub fn relief_jump(args: &Args, step: u32, front: &[f32], from: &[u32], to: &mut [u32]) {
    let plane = args.plane as usize;
    let (reach, step) = (i64::from(args.reach), i64::from(step));
    let (any, own) = to.split_at_mut(plane);
    any.par_iter_mut().zip(own).take(args.pixels()).enumerate().for_each(|(p, (any, own))| {
        let (x, y) = args.place(p);
        (*any, *own) = (from[p], from[plane + p]);
        let length = |stored: u32| offset(stored).map_or(i64::MAX, |(x, y)| x * x + y * y);
        let (mut any_length, mut own_length) = (length(*any), length(*own));
        for (dx, dy) in AROUND {
            let Some(q) = args.at(x + step * dx, y + step * dy) else { continue };
            for candidate in [from[q], from[plane + q]] {
                let Some((i, j)) = offset(candidate) else { continue };
                let (i, j) = (i + step * dx, j + step * dy);
                let length = i * i + j * j;
                if length > reach * reach {
                    continue;
                }
                if length < any_length {
                    (*any, any_length) = (stored((i, j)), length);
                }
                let is_farther = args.at(x + i, y + j).is_some_and(|rim| front[rim] < front[p] - args.tear);
                if is_farther && length < own_length {
                    (*own, own_length) = (stored((i, j)), length);
                }
            }
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
        assert_eq!(steps, [32, 16, 8, 4, 2, 1, 1]);
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
                    assert!(near(p) && is_rim(args.at(x + i, y + j).unwrap()));
                    let length = ((i * i + j * j) as f64).sqrt();
                    assert!(length < (nearest as f64).sqrt() + 1.0, "{length} {nearest}");
                }
                None => assert!(!near(p)),
            }
        }
        assert_eq!(args.steps([2.0, 2.4]).count(), 0);
    }
}
