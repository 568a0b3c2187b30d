//! Computes structural similarity (Wang et al., IEEE Transactions on Image Processing 13, 2004).

use super::EvaluateError;
use rayon::prelude::*;

/// Half of the window, which is 3.5 standard deviations of 1.5 pixels, rounded.
const RADIUS: usize = 5;
const WINDOW: usize = 2 * RADIUS + 1;
const SIGMA: f64 = 1.5;
/// The constants (K L)^2 with the paper's K1 = 0.01 and K2 = 0.03, and L = 1.
const C1: f64 = 1e-4;
const C2: f64 = 9e-4;

/// Returns the mean structural similarity of two images of `height` x `width` with full scale 1. It uses Gaussian
/// weights of 1.5 pixels cut off at 5, and population covariances, averaged over the windows inside the image. It
/// equals `structural_similarity(a, b, gaussian_weights=True, sigma=1.5, use_sample_covariance=False, data_range=1.0)`
/// of scikit-image 0.26, whose cropped mean excludes every pixel that its border rule affects.
///
/// # Errors
/// Returns [`EvaluateError::TooSmall`] below 11 x 11, or [`EvaluateError::Sizes`].
pub fn ssim(a: &[f32], b: &[f32], height: usize, width: usize) -> Result<f64, EvaluateError> {
    if height < WINDOW || width < WINDOW {
        return Err(EvaluateError::TooSmall { height, width, least: WINDOW });
    }
    for image in [a, b] {
        if Some(image.len()) != height.checked_mul(width) {
            return Err(EvaluateError::Sizes { one: image.len(), other: height.saturating_mul(width) });
        }
    }
    let weights = gaussian();
    let inside = width - 2 * RADIUS;
    // Moments a, b, aa, bb, ab of every row's windows, weighted along the row.
    let along_rows: Vec<[f64; 5]> = (a.par_chunks_exact(width).zip(b.par_chunks_exact(width)))
        .flat_map_iter(|(a, b)| {
            (0..inside).map(move |x| {
                let mut sum = [0.0; 5];
                for ((&a, &b), w) in a[x..x + WINDOW].iter().zip(&b[x..x + WINDOW]).zip(weights) {
                    let (a, b) = (f64::from(a), f64::from(b));
                    for (s, v) in sum.iter_mut().zip([a, b, a * a, b * b, a * b]) {
                        *s += w * v;
                    }
                }
                sum
            })
        })
        .collect();
    // One sum per row, added in their order, gives the same result on any number of threads.
    let rows: Vec<f64> = (0..height - 2 * RADIUS)
        .into_par_iter()
        .map(|y| {
            let similarity = |x: usize| {
                let mut m = [0.0; 5];
                for (i, w) in weights.iter().enumerate() {
                    m.iter_mut().zip(&along_rows[(y + i) * inside + x]).for_each(|(m, s)| *m += w * s);
                }
                let [a, b, aa, bb, ab] = m;
                let (var_a, var_b, cov) = (aa - a * a, bb - b * b, ab - a * b);
                (2.0 * a * b + C1) * (2.0 * cov + C2) / ((a * a + b * b + C1) * (var_a + var_b + C2))
            };
            (0..inside).map(similarity).sum()
        })
        .collect();
    Ok(rows.iter().sum::<f64>() / (rows.len() * inside) as f64)
}

/// Returns [`ssim`] of an image at an exposure, or none for images that are smaller than its window.
pub(crate) fn ssim_at(
    exposure: f64,
    seen: &[f32],
    wanted: &[f32],
    height: usize,
    width: usize,
) -> Result<Option<f64>, EvaluateError> {
    let exposed: Vec<f32> = seen.iter().map(|v| v * exposure as f32).collect();
    match ssim(&exposed, wanted, height, width) {
        Err(EvaluateError::TooSmall { .. }) => Ok(None),
        other => other.map(Some),
    }
}

fn gaussian() -> [f64; WINDOW] {
    let raw: [f64; WINDOW] = std::array::from_fn(|i| (-0.5 * ((i as f64 - RADIUS as f64) / SIGMA).powi(2)).exp());
    let sum: f64 = raw.iter().sum();
    raw.map(|w| w / sum)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Whole numbers divided by whole numbers, so that Python computes the same images.
    fn image(height: usize, width: usize, salt: usize) -> Vec<f32> {
        (0..height * width).map(|i| ((i * i * 7 + i * salt) % 101) as f32 / 100.0).collect()
    }

    fn smooth(height: usize, width: usize) -> Vec<f32> {
        (0..height * width).map(|i| (i / width * 3 + i % width * 2) as f32 / 256.0).collect()
    }

    #[test]
    fn it_is_scikit_images() {
        let near = |a: &[f32], b: &[f32], (h, w), expected: f64| {
            let found = ssim(a, b, h, w).unwrap();
            assert!((found - expected).abs() < 1e-9, "{h}x{w}: {found}, not {expected}");
        };
        let noisy =
            |h, w| -> Vec<f32> { smooth(h, w).iter().zip(image(h, w, 5)).map(|(s, n)| s + 0.25 * (n - 0.5)).collect() };
        near(&image(24, 37, 3), &image(24, 37, 5), (24, 37), 0.0583039934860486);
        near(&smooth(33, 20), &noisy(33, 20), (33, 20), 0.23021663460488417);
        near(&smooth(11, 11), &noisy(11, 11), (11, 11), 0.21681828240788317);
        near(&smooth(16, 48), &smooth(16, 48), (16, 48), 1.0);
    }

    #[test]
    fn what_has_no_window_has_no_answer() {
        assert_eq!(
            ssim(&[0.0; 120], &[0.0; 120], 10, 12),
            Err(EvaluateError::TooSmall { height: 10, width: 12, least: 11 })
        );
        assert!(matches!(ssim(&[0.0; 121], &[0.0; 120], 11, 11), Err(EvaluateError::Sizes { .. })));
    }
}
