//! The second half of the filter of [`contrast_rows`](crate::contrast_rows), along columns, and what follows from it: turns the image into the factor
//! by which each field sample is to be multiplied, and sums the loss. One pupil.
//!
//! With `c` the difference of contrast, `s I - T` over the luminance `L = T + dark`, and `q = W^T W c`, the loss is `sum c q =
//! sum |W c|^2`, and its derivative by the intensity `2 s q / L`. The projection, which knows of pictures and not of losses, is
//! given one to replace the amplitude by: what is seen without the part of the difference that is resolved, `s I - L q`. Without
//! a filter that is the target. To first order each amplitude changes by `-q / 2` of itself, which is a step down the same loss,
//! so long in each pixel that neither bright nor dark ones overshoot. Where the gaze is known, a part `a` of the square of each pixel's
//! difference counts as it is, all of it where the eye looks, and the rest is filtered: `q = a c + b W^T W b c`, `b^2 = 1 - a`.

use crate::compare::PROJECTION;
use crate::contrast_rows::{Args, difference};
use crate::simd;

/// `weights` as for [`contrast_rows`](crate::contrast_rows::contrast_rows), which left `contrast`; `target` and `image`: intensity
/// in, factor out; all (rows, columns). `line` is overwritten. Returns the loss, a sum over pixels.
pub fn compare_contrast(
    args: &Args,
    weights: &[f32],
    contrast: &[f32],
    target: &[f32],
    image: &mut [f32],
    line: &mut Vec<f32>,
) -> f64 {
    let (rows, columns) = (args.rows as usize, args.columns as usize);
    let [down, _] = args.weights(weights);
    let row = |y: usize| &contrast[y % rows * columns..][..columns];
    line.clear();
    line.resize(columns, 0.0);
    let mut loss = 0.0f64;
    simd(
        #[inline(always)]
        || {
            let lines = image.chunks_exact_mut(columns).zip(target.chunks_exact(columns));
            for (y, (image, target)) in lines.enumerate() {
                for (q, c) in line.iter_mut().zip(row(y)) {
                    *q = down[0] * c;
                }
                for (t, weight) in down.iter().enumerate().skip(1) {
                    for ((q, before), behind) in line.iter_mut().zip(row(y + rows - t)).zip(row(y + t)) {
                        *q += weight * (before + behind);
                    }
                }
                if args.has_gaze() {
                    for (x, q) in line.iter_mut().enumerate() {
                        let sharp = args.sharp(y, x);
                        *q = sharp * difference(args, image[x], target[x]) + (1.0 - sharp).sqrt() * *q;
                    }
                }
                // Short float32 sums, added up in float64.
                for ((image, target), q) in image.chunks_mut(64).zip(target.chunks(64)).zip(line.chunks(64)) {
                    let mut sum = 0.0f32;
                    for ((i, t), q) in image.iter_mut().zip(target).zip(q) {
                        sum += difference(args, *i, *t) * q;
                        *i = factor(args, *i, *t, *q);
                    }
                    loss += f64::from(sum);
                }
            }
        },
    );
    loss
}

/// The factor of a field sample where `image` is seen, `target` wanted, and `resolved` the difference of contrast that is left
/// of it.
#[inline(always)]
fn factor(args: &Args, image: f32, target: f32, resolved: f32) -> f32 {
    let luminance = target + args.dark;
    if args.mode != PROJECTION {
        return args.weight * resolved / luminance;
    }
    let seen = args.exposure * image;
    let wanted = (seen - luminance * resolved).max(0.0);
    ((wanted + args.floor) / (seen + args.floor)).sqrt().min(args.limit) - 1.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::compare::INTENSITY;
    use crate::contrast_rows::contrast_rows;

    const ARGS: Args = Args {
        rows: 7,
        columns: 12,
        reach_y: 2,
        reach_x: 3,
        mode: INTENSITY,
        exposure: 0.8,
        weight: 2.0 * 0.8,
        floor: 1e-6,
        limit: 3.0,
        dark: 0.05,
        first_y: 3,
        first_x: 7,
        gaze_y: 2.5,
        gaze_x: 8.0,
        away_y: 0.3,
        away_x: 0.6,
        middle: 0.7,
        coarse: 0.25,
    };
    /// The squares of two filters' transfers: sums of products with themselves.
    const WEIGHTS: [f32; 7] = [0.375, 0.25, 0.0625, 0.3125, 0.234_375, 0.093_75, 0.015_625];

    fn pictures() -> [Vec<f32>; 2] {
        let value = |i: usize, salt: usize| ((i * 7919 + salt * 104_729) % 1009) as f32 / 1009.0;
        [1, 2].map(|salt| (0..ARGS.count()).map(|i| value(i, salt)).collect())
    }

    fn run(args: &Args, image: &[f32], target: &[f32]) -> (f64, Vec<f32>) {
        let (mut image, mut contrast, mut line) = (image.to_vec(), vec![0.0; args.count()], Vec::new());
        contrast_rows(args, &WEIGHTS, &image, target, &mut contrast, &mut line);
        let loss = compare_contrast(args, &WEIGHTS, &contrast, target, &mut image, &mut line);
        (loss, image)
    }

    /// Loss and what the filter leaves, in float64, straight from the definition.
    fn reference(image: &[f64], target: &[f32]) -> (f64, Vec<f64>) {
        let (rows, columns) = (7i64, 12i64);
        let at = |y: i64, x: i64| (y.rem_euclid(rows) * columns + x.rem_euclid(columns)) as usize;
        let sharp = |i: usize| {
            let (y, x) = (((i / 12 + 3) % 7) as f64, ((i % 12 + 7) % 12) as f64);
            let resolved = 1.0 / (0.7 + ((y - 2.5) * 0.3).hypot((x - 8.0) * 0.6));
            ((resolved - 0.25) / 0.75).clamp(0.0, 1.0)
        };
        let contrast = |i: usize| (0.8 * image[i] - f64::from(target[i])) / (f64::from(target[i]) + 0.05);
        let parts = [0, 1].map(|part| (0..84).filter(|i| sharp(*i) == f64::from(part)).count());
        assert!(parts.iter().all(|count| (1..83).contains(count)), "some sharp, some filtered: {parts:?}");
        let weight = |of: &[f32], t: i64| of.get(t.unsigned_abs() as usize).map_or(0.0, |w| f64::from(*w));
        let [down, along] = ARGS.weights(&WEIGHTS);
        let mut left = vec![0.0; image.len()];
        for (y, x) in (0..rows).flat_map(|y| (0..columns).map(move |x| (y, x))) {
            for (dy, dx) in (-2..=2).flat_map(|dy| (-3..=3).map(move |dx| (dy, dx))) {
                let from = at(y + dy, x + dx);
                left[at(y, x)] += weight(down, dy) * weight(along, dx) * (1.0 - sharp(from)).sqrt() * contrast(from);
            }
        }
        for (i, left) in left.iter_mut().enumerate() {
            *left = sharp(i) * contrast(i) + (1.0 - sharp(i)).sqrt() * *left;
        }
        ((0..image.len()).map(|i| contrast(i) * left[i]).sum(), left)
    }

    #[test]
    fn the_derivative_is_that_of_the_loss() {
        let [image, target] = pictures();
        let wide: Vec<f64> = image.iter().map(|v| f64::from(*v)).collect();
        let (loss, factors) = run(&ARGS, &image, &target);
        let (want, _) = reference(&wide, &target);
        assert!(loss > 0.0 && (loss / want - 1.0).abs() < 1e-5, "{loss}, not {want}");
        for i in [0, 5, 11, 40, 83] {
            let moved = |by: f64| {
                let mut image = wide.clone();
                image[i] += by;
                reference(&image, &target).0
            };
            // Exposures and samples are float32's.
            let slope = (moved(1e-4) - moved(-1e-4)) / 2e-4;
            assert!((f64::from(factors[i]) / slope - 1.0).abs() < 1e-4, "{i}: {}, not {slope}", factors[i]);
        }
    }

    #[test]
    fn without_a_filter_the_projection_has_the_target() {
        let [image, target] = pictures();
        let plain = Args { away_y: 0.0, away_x: 0.0, ..ARGS };
        let args = Args { reach_y: 0, reach_x: 0, mode: PROJECTION, ..plain };
        let (mut seen, mut contrast, mut line) = (image.clone(), vec![0.0; args.count()], Vec::new());
        contrast_rows(&args, &[1.0, 1.0], &image, &target, &mut contrast, &mut line);
        compare_contrast(&args, &[1.0, 1.0], &contrast, &target, &mut seen, &mut line);
        for ((factor, i), t) in seen.iter().zip(&image).zip(&target) {
            let plain = ((t + 1e-6) / (0.8 * i + 1e-6)).sqrt().min(3.0) - 1.0;
            assert!((factor - plain).abs() < 1e-4, "{factor}, not {plain}");
        }
    }
}
