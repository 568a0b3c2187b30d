//! What an eye sees, what it should see, and how far apart the two are in numbers: PSNR, SSIM, the exposure that compares
//! a hologram with its scene, and what a list of such numbers comes to.
//!
//! Images are linear light, (row, column), with 1 as full scale; sums are kept in float64. [`psnr`], [`ssim`] and their
//! like are pure functions of slices. May import `optics`, `scene`, `plan` and `engine`.
//!
//! The order in which a hologram is judged (OPTICS 2 and 7): the intensity of every pupil and its photograph, averaged
//! over 2 x 2 pixels ([`pool2`]), one exposure for all pupils together ([`fit_exposure`]), then [`psnr`] and [`ssim`]
//! pupil by pupil, and their [`Summary`]: worst, median and spread say more than the mean.

mod look;
mod ssim;
mod summary;

pub use look::{photographs, views};
pub use ssim::ssim;
pub use summary::Summary;

/// Why there is no number.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum EvaluateError {
    /// An image smaller than the measure's window.
    #[error("an image of {height}x{width} pixels is too small for SSIM: {least}x{least} is the least")]
    TooSmall {
        /// Rows.
        height: usize,
        /// Columns.
        width: usize,
        /// Least number of either.
        least: usize,
    },
}

/// Peak signal-to-noise ratio in dB of an image at an exposure, peak 1: `-10 log10(mean((exposure I - T)^2))`; infinite
/// where the two are equal.
///
/// # Panics
/// If the images differ in size or have no pixels: the caller's mistake.
pub fn psnr(image: &[f32], target: &[f32], exposure: f64) -> f64 {
    assert!(image.len() == target.len() && !image.is_empty(), "{} and {} pixels", image.len(), target.len());
    let squares = image.iter().zip(target).map(|(&i, &t)| (exposure * f64::from(i) - f64::from(t)).powi(2));
    -10.0 * (squares.sum::<f64>() / image.len() as f64).log10()
}

/// Mean of every block of 2 x 2 pixels, (`height / 2`, `width / 2`): a last odd row or column is dropped. The same for
/// every method compared, it stands for the eye's own resolution (OPTICS 7). An image of a single row or column has no
/// such block and stays as it is.
///
/// # Panics
/// If `image` is not `height` x `width`: the caller's mistake.
pub fn pool2(image: &[f32], height: usize, width: usize) -> Vec<f32> {
    assert_eq!(image.len(), height * width, "the image is {height} x {width}");
    if height < 2 || width < 2 {
        return image.to_vec();
    }
    let mut pooled = Vec::with_capacity((height / 2) * (width / 2));
    for rows in image.chunks_exact(2 * width) {
        let (upper, lower) = rows.split_at(width);
        let blocks = upper.chunks_exact(2).zip(lower.chunks_exact(2));
        pooled.extend(blocks.map(|(u, l)| 0.25 * (u[0] + u[1] + l[0] + l[1])));
    }
    pooled
}

/// The one exposure that brings images `I` nearest to their targets `T` in the least-squares sense, over all of them:
/// `sum <I, T> / sum <I, I>`. For comparing what is finished; it settles too low to steer by (OPTICS 6c). 1 for black
/// images, which no exposure changes.
///
/// # Panics
/// If an image and its target differ in size: the caller's mistake.
pub fn fit_exposure<'a>(pairs: impl IntoIterator<Item = (&'a [f32], &'a [f32])>) -> f64 {
    let (mut with_target, mut with_itself) = (0.0, 0.0);
    for (image, target) in pairs {
        assert_eq!(image.len(), target.len(), "an image is as large as its target");
        for (&i, &t) in image.iter().zip(target) {
            with_target += f64::from(i) * f64::from(t);
            with_itself += f64::from(i) * f64::from(i);
        }
    }
    if with_itself > 0.0 { with_target / with_itself } else { 1.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn psnr_of_a_known_error() {
        assert!((psnr(&[0.0; 9], &[0.1; 9], 1.0) - 20.0).abs() < 1e-5);
        assert!((psnr(&[0.25; 9], &[0.6; 9], 2.0) - 20.0).abs() < 1e-5);
        assert!((psnr(&[0.0, 0.0], &[0.02, 0.0], 7.0) - (-10.0 * 0.0002f64.log10())).abs() < 1e-5);
        assert_eq!(psnr(&[0.3], &[0.3], 1.0), f64::INFINITY);
    }

    #[test]
    fn a_small_difference_survives_a_large_image() {
        // In float32 the sum of 16 million squares of 1e-4 would stop growing.
        let (a, b) = (vec![1.0f32; 1 << 24], vec![1.0f32 - 1e-2; 1 << 24]);
        assert!((psnr(&a, &b, 1.0) - 40.0).abs() < 1e-4);
    }

    #[test]
    fn pooling_drops_odd_edges() {
        let image: Vec<f32> = (0..15).map(|i| i as f32).collect();
        assert_eq!(pool2(&image, 3, 5), [3.0, 5.0]);
        assert_eq!(pool2(&image, 5, 3), [2.0, 8.0]);
        assert_eq!(pool2(&image, 1, 15), image);
        assert!(pool2(&[], 0, 3).is_empty());
    }

    #[test]
    fn one_exposure_is_fitted_over_all_images() {
        let images: [(&[f32], &[f32]); 2] = [(&[1.0, 2.0], &[2.0, 4.0]), (&[1.0], &[8.0])];
        // (2 + 8 + 8) / (1 + 4 + 1), neither image's own factor (2 and 8).
        assert_eq!(fit_exposure(images), 3.0);
        assert_eq!(fit_exposure([(&[0.0f32][..], &[1.0f32][..])]), 1.0);
    }
}
