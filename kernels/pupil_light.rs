//! Sums the light that a pupil sees in focus, on the SLM's pixels, from the views in it and their shares. The sums are
//! whole numbers, so that every engine has the same result.

use crate::simd;
use bytemuck::{Pod, Zeroable};
use rayon::prelude::*;

/// Sum of the shares of all views in a pupil. With this value, full light in all views fits 32 bits.
pub const WHOLE: u32 = 65_536;

/// A view and its share of the pupil.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
pub struct Share {
    /// Index of the view.
    pub view: u32,
    /// Share in units of 1 / [`WHOLE`].
    pub weight: u32,
}

/// Position of the SLM in the views, and the range of shares.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
pub struct Args {
    /// Rows of the SLM.
    pub height: u32,
    /// Columns of the SLM.
    pub width: u32,
    /// Values from one row of a view to the next.
    pub line: u32,
    /// Index of the value of the SLM's first pixel in a view.
    pub first: u32,
    /// Values from one view to the next.
    pub stride: u32,
    /// First of the views that are bound.
    pub from: u32,
    /// First share that counts.
    pub begin: u32,
    /// End of the shares that count, exclusive.
    pub end: u32,
    /// If not 0, light is added to the contents of `light`.
    pub adds: u32,
}

/// Converts shares of 1 to shares of [`WHOLE`]. They are rounded, and the largest share takes the remainder.
pub fn shares(parts: &[(usize, f64)]) -> Vec<Share> {
    let whole = |part: f64| (part * f64::from(WHOLE)).round() as u32;
    let mut all: Vec<Share> =
        parts.iter().map(|(view, part)| Share { view: *view as u32, weight: whole(*part) }).collect();
    let sum: i64 = all.iter().map(|share| i64::from(share.weight)).sum();
    if let Some(largest) = all.iter_mut().max_by_key(|share| share.weight) {
        largest.weight = (i64::from(largest.weight) + i64::from(WHOLE) - sum).clamp(0, i64::from(WHOLE)) as u32;
    }
    all
}

/// Rows of a view that are added before the next view. Memory is then read in long pieces, and the sums stay in the
/// first cache.
const ROWS: usize = 8;

/// Sums `views` into `light` (height, width), each view by its share.
pub fn pupil_light(args: &Args, views: &[u16], shares: &[Share], light: &mut [u32]) {
    let [width, line, stride] = [args.width, args.line, args.stride].map(|n| n as usize);
    light.par_chunks_mut(ROWS * width).enumerate().for_each(|(block, light)| {
        if args.adds == 0 {
            light.fill(0);
        }
        for share in &shares[args.begin as usize..args.end as usize] {
            let at = args.first as usize + ROWS * block * line + (share.view - args.from) as usize * stride;
            for (light, values) in light.chunks_exact_mut(width).zip(views[at..].chunks(line)) {
                simd(
                    #[inline(always)]
                    || {
                        light
                            .iter_mut()
                            .zip(&values[..width])
                            .for_each(|(sum, v)| *sum = sum.wrapping_add(share.weight * u32::from(*v)))
                    },
                );
            }
        }
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Shares add up to the whole, however they round, and each view counts by its own share.
    #[test]
    fn is_the_mean_of_the_views_by_their_shares() {
        for count in [1, 3, 7, 81] {
            let parts: Vec<(usize, f64)> = (0..count).map(|i| (i, 1.0 / count as f64)).collect();
            assert_eq!(shares(&parts).iter().map(|share| share.weight).sum::<u32>(), WHOLE);
        }
        let shares = shares(&[(0, 0.3), (2, 0.7)]);
        // More rows than one block has, and the last block is not full.
        let (height, width, line) = (ROWS as u32 + 3, 4, 6);
        let stride = (height + 2) * line;
        let views: Vec<u16> = (0..3 * stride).map(|i| (i * 7919 % 65_536) as u16).collect();
        let args = Args { height, width, line, first: line + 1, stride, from: 0, begin: 0, end: 2, adds: 0 };
        let mut light = vec![7; (height * width) as usize];
        pupil_light(&args, &views, &shares, &mut light);
        for (i, sum) in light.iter().enumerate() {
            let at = (i as u32 / width + 1) * line + i as u32 % width + 1;
            let value = |view: u32| f64::from(views[(view * stride + at) as usize]);
            let wanted = 0.3 * value(0) + 0.7 * value(2);
            assert!((f64::from(*sum) / f64::from(WHOLE) - wanted).abs() < 1.1, "{i}");
        }
        let once = light.clone();
        pupil_light(&Args { begin: 1, adds: 1, ..args }, &views, &shares, &mut light);
        pupil_light(&Args { end: 1, ..args }, &views, &shares, &mut light);
        pupil_light(&Args { begin: 1, adds: 1, ..args }, &views, &shares, &mut light);
        assert_eq!(light, once);
        let full = vec![u16::MAX; views.len()];
        pupil_light(&args, &full, &shares, &mut light);
        assert!(light.iter().all(|sum| *sum == u32::from(u16::MAX) * WHOLE));
    }
}
