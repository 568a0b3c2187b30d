//! Differences of contrast, the first half of what an eye weighs them by (W^T W of the loss |W c|^2): along rows. What an image
//! shows too much over the luminance that is wanted there, as an eye that is adapted to it sees it, is smoothed by a symmetric
//! filter; where it is known where the eye looks, only that part of it which is not compared sharply. One pupil.

use crate::simd;
use bytemuck::{Pod, Zeroable};

/// One pupil's differences of contrast, and what becomes of them in [`compare_contrast`](crate::compare_contrast).
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct Args {
    /// Rows of the image.
    pub rows: u32,
    /// And columns.
    pub columns: u32,
    /// Pixels that the filter reaches on either side along y, less than half of the rows,
    pub reach_y: u32,
    /// and along x.
    pub reach_x: u32,
    /// [`PROJECTION`](crate::compare::PROJECTION), or any other for the derivative of the loss.
    pub mode: u32,
    /// Exposure s.
    pub exposure: f32,
    /// Of the derivative: what `compare` has, times the square of the light that contrasts are in units of.
    pub weight: f32,
    /// Added to both sides of the projection's ratio.
    pub floor: f32,
    /// Its largest ratio of amplitudes.
    pub limit: f32,
    /// Added to the luminance that is wanted: nobody is adapted to less.
    pub dark: f32,
    /// Which row of the picture the image begins with,
    pub first_y: u32,
    /// and which column: those behind the picture's last come from its first.
    pub first_x: u32,
    /// Where the eye looks in the picture, pixels along y,
    pub gaze_y: f32,
    /// and along x.
    pub gaze_x: f32,
    /// How far a pixel is from the next along y, in units of the angle at twice of which an eye resolves half as much; 0 where it is
    /// not known where the eye looks,
    pub away_y: f32,
    /// and along x.
    pub away_x: f32,
    /// What is added to a pixel's distance from where the eye looks: over the sum is what an eye resolves there, in units of the
    /// highest frequency.
    pub middle: f32,
    /// What the filter passes, in the same units; below 1.
    pub coarse: f32,
}

impl Args {
    /// Weights of the filter along y, then along x: of a pixel itself, then of each that is further away, on either side.
    pub fn weights<'a>(&self, weights: &'a [f32]) -> [&'a [f32]; 2] {
        weights.split_at(self.reach_y as usize + 1).into()
    }

    /// Whether the eye's gaze is known.
    #[inline(always)]
    pub(crate) fn has_gaze(&self) -> bool {
        self.away_y != 0.0 || self.away_x != 0.0
    }

    /// How much of the square of a difference counts unfiltered in pixel (y, x), where it is known where the eye looks; the rest is
    /// filtered.
    #[inline(always)]
    pub fn sharp(&self, y: usize, x: usize) -> f32 {
        let [y, x] = [(y, self.first_y, self.rows), (x, self.first_x, self.columns)]
            .map(|(at, first, count)| (at as u32 + first) % count);
        let down = (y as f32 - self.gaze_y) * self.away_y;
        let along = (x as f32 - self.gaze_x) * self.away_x;
        let resolved = 1.0 / (self.middle + (down * down + along * along).sqrt());
        ((resolved - self.coarse) / (1.0 - self.coarse)).clamp(0.0, 1.0)
    }

    /// Pixels.
    pub fn count(&self) -> usize {
        self.rows as usize * self.columns as usize
    }
}

/// By how much of the light that is wanted there more is seen than that.
#[inline(always)]
pub(crate) fn difference(args: &Args, image: f32, target: f32) -> f32 {
    (args.exposure * image - target) / (target + args.dark)
}

/// `weights` as [`Args::weights`] has them; `image` and `target` (rows, columns) to `contrast`, of the same size. `line` is
/// overwritten.
pub fn contrast_rows(
    args: &Args,
    weights: &[f32],
    image: &[f32],
    target: &[f32],
    contrast: &mut [f32],
    line: &mut Vec<f32>,
) {
    let (columns, reach) = (args.columns as usize, args.reach_x as usize);
    let [_, along] = args.weights(weights);
    line.clear();
    line.resize(columns + 2 * reach, 0.0);
    simd(
        #[inline(always)]
        || {
            let rows = image.chunks_exact(columns).zip(target.chunks_exact(columns));
            for (y, ((image, target), out)) in rows.zip(contrast.chunks_exact_mut(columns)).enumerate() {
                for ((c, i), t) in line[reach..][..columns].iter_mut().zip(image).zip(target) {
                    *c = difference(args, *i, *t);
                }
                if args.has_gaze() {
                    for (x, c) in line[reach..][..columns].iter_mut().enumerate() {
                        *c *= (1.0 - args.sharp(y, x)).sqrt();
                    }
                }
                // Pictures are periodic, as everything here.
                line.copy_within(columns..columns + reach, 0);
                line.copy_within(reach..2 * reach, reach + columns);
                for (out, c) in out.iter_mut().zip(&line[reach..]) {
                    *out = along[0] * c;
                }
                for (t, weight) in along.iter().enumerate().skip(1) {
                    let both = line[reach - t..].iter().zip(&line[reach + t..]);
                    for (out, (before, behind)) in out.iter_mut().zip(both) {
                        *out += weight * (before + behind);
                    }
                }
            }
        },
    );
}
