//! Measures images: PSNR, SSIM, exposure, energy, speckle and color, for each pupil and for groups of pupils.
//!
//! Images are linear light, (row, column), with 1 as full scale. Sums are in float64. The measures are pure functions
//! of slices. [`views`] and [`photographs`] compute the images with any engine, and [`sums`] computes the sums that
//! exposure and PSNR need.
//!
//! A hologram is scored in this order (OPTICS 2 and 8). The intensity of every pupil and its target image are averaged
//! over 2 x 2 pixels ([`pool2`]). They give three [`Sums`], computed from the images or on the engine. One exposure is
//! fitted for all pupils together. PSNR follows for each pupil ([`Scores`], and with [`ssim`] [`compare`]). Their
//! [`Summary`] with worst, median and spread is more informative than the mean. [`members`] are the groups of pupils
//! with which the paper compares methods.
//!
//! The [`Ceiling`] is the highest score that diffraction at the pupil allows for any hologram.
//!
//! [`JodMetric`] measures the perceived difference in just-objectionable differences, at the display's luminance and
//! pixels per degree.
//!
//! Further measures cover other visible faults. They are broken parallax ([`sweep`]), light that is missing in places
//! of the eyebox ([`energy`], [`passed`]), speckle ([`contrast`]), and colors that separate at edges
//! ([`color_difference`]).

mod around;
mod ceiling;
mod color;
mod energy;
mod epipolar;
mod groups;
mod jod;
mod look;
mod score;
mod speckle;
mod ssim;
mod sums;

pub(crate) use around::MOST_VIEWS;
pub use around::Views;
pub use ceiling::Ceiling;
pub use color::{color_difference, edges, pool_mask};
pub use energy::{energy, passed, variation};
pub use epipolar::{RowFinder, sweep};
pub use groups::{Group, Member, members, places};
pub use jod::{JodMetric, Judged, Rgb, lost_picture, rgb};
pub use look::{Plane, centered, crop, crop_adjoint, images, photographs, targets, views};
pub use score::{Score, Scores, Summary, compare};
pub use speckle::{averaged_contrast, contrast};
pub use ssim::ssim;
pub(crate) use ssim::ssim_at;
pub use sums::{Sums, sums};

use eyebox_base::error::Reason;

/// The reason why a measure has no value.
#[derive(Debug, Clone, PartialEq, thiserror::Error, serde::Serialize)]
#[serde(tag = "code", content = "fields", rename_all = "kebab-case")]
#[non_exhaustive]
pub enum EvaluateError {
    /// Two images differ in size and cannot be compared.
    #[error("an image of {one} pixels cannot be compared with one of {other}")]
    Sizes {
        /// Number of pixels of the first image.
        one: usize,
        /// Number of pixels of the second image, or the product of its rows and columns.
        other: usize,
    },
    /// An image is smaller than the window of the measure.
    #[error("an image of {height}x{width} pixels is too small, because the smallest size is {least}x{least}")]
    TooSmall {
        /// Number of rows of pixels.
        height: usize,
        /// Number of columns of pixels.
        width: usize,
        /// Smallest allowed number of rows and of columns.
        least: usize,
    },
    /// The perceived difference cannot be computed.
    #[error("JOD: {reason}")]
    Jod {
        /// The reason why it cannot be computed.
        reason: Reason,
    },
    /// The images have no light, so no exposure fits them.
    #[error("the images are black, so no exposure fits them to their targets")]
    Dark,
}

/// Returns the peak signal-to-noise ratio `-10 log10(mean((a - b)^2))` in dB, with peak 1. It is infinite for equal
/// images.
///
/// # Errors
/// Returns [`EvaluateError::Sizes`], or [`EvaluateError::TooSmall`] for images without pixels.
pub fn psnr(a: &[f32], b: &[f32]) -> Result<f64, EvaluateError> {
    if a.len() != b.len() {
        return Err(EvaluateError::Sizes { one: a.len(), other: b.len() });
    }
    if a.is_empty() {
        return Err(EvaluateError::TooSmall { height: 0, width: 0, least: 1 });
    }
    let error: f64 = a.iter().zip(b).map(|(&a, &b)| (f64::from(a) - f64::from(b)).powi(2)).sum();
    Ok(-10.0 * (error / a.len() as f64).log10())
}

/// Returns the mean of every block of 2 x 2 pixels, (`height / 2`, `width / 2`). A last odd row or column is dropped.
/// It is the same for every method in a comparison, and represents the resolution of the eye (OPTICS 8). An image of a
/// single row or column has no such block and is returned unchanged.
///
/// # Panics
/// Panics if `image` is not `height` x `width`, which is a mistake of the caller.
pub fn pool2(image: &[f32], height: usize, width: usize) -> Vec<f32> {
    assert_eq!(image.len(), height * width, "the image is {height} x {width}");
    if height < 2 || width < 2 {
        return image.to_vec();
    }
    let mut pooled = Vec::with_capacity((height / 2) * (width / 2));
    for row in 0..height / 2 {
        let (upper, lower) = image[2 * row * width..(2 * row + 2) * width].split_at(width);
        let blocks = upper.chunks_exact(2).zip(lower.chunks_exact(2));
        pooled.extend(blocks.map(|(u, l)| 0.25 * (u[0] + u[1] + l[0] + l[1])));
    }
    pooled
}

/// Applies [`Sums::fit_exposure`] to pairs of images and targets.
///
/// # Errors
/// Returns [`EvaluateError::Sizes`], [`EvaluateError::TooSmall`] or [`EvaluateError::Dark`].
pub fn fit_exposure<'a>(pairs: impl IntoIterator<Item = (&'a [f32], &'a [f32])>) -> Result<f64, EvaluateError> {
    let sums =
        pairs.into_iter().map(|(image, target)| Sums::of_images(image, target)).collect::<Result<Vec<_>, _>>()?;
    Sums::fit_exposure(&sums)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn psnr_of_a_known_error() {
        assert!((psnr(&[0.0; 9], &[0.1; 9]).unwrap() - 20.0).abs() < 1e-5);
        assert!((psnr(&[0.0, 0.0], &[0.02, 0.0]).unwrap() - (-10.0 * 0.0002f64.log10())).abs() < 1e-5);
        assert_eq!(psnr(&[0.3], &[0.3]).unwrap(), f64::INFINITY);
        assert_eq!(psnr(&[0.0; 2], &[0.0; 3]), Err(EvaluateError::Sizes { one: 2, other: 3 }));
        assert!(matches!(psnr(&[], &[]), Err(EvaluateError::TooSmall { .. })));
    }

    /// Whole numbers divided by whole numbers, so that Python computes the same images.
    #[test]
    fn psnr_is_scikit_images() {
        let image = |n: usize, salt: usize| -> Vec<f32> {
            (0..n).map(|i| ((i * i * 7 + i * salt) % 101) as f32 / 100.0).collect()
        };
        // Values of scikit-image 0.26, by peak_signal_noise_ratio(a, b, data_range=1.0), and structural_similarity as
        // in `ssim`.
        assert!((psnr(&image(24 * 37, 3), &image(24 * 37, 5)).unwrap() - 7.457_955_216_659_766).abs() < 1e-4);
        for (h, w, part, db, similarity) in [
            (24, 37, 0.25, 22.232_105_941_015_36, 0.164_629_235_548_317_13),
            (33, 20, 0.05, 36.235_239_689_837_42, 0.822_411_126_934_963_8),
            (64, 64, 0.01, 50.184_380_185_472_506, 0.991_786_256_023_722_3),
        ] {
            let a: Vec<f32> = (0..h * w).map(|i| (i / w * 3 + i % w * 2) as f32 / 256.0 / 2.0).collect();
            let b: Vec<f32> = a.iter().zip(image(h * w, 5)).map(|(a, n)| a + part * (n - 0.5)).collect();
            assert!((psnr(&a, &b).unwrap() - db).abs() < 1e-4, "{}", psnr(&a, &b).unwrap());
            assert!((ssim(&a, &b, h, w).unwrap() - similarity).abs() < 1e-4);
        }
    }

    #[test]
    fn a_small_difference_survives_a_large_image() {
        // In float32 the sum of 16 million squares of 1e-4 would stop growing.
        let (a, b) = (vec![1.0f32; 1 << 24], vec![1.0f32 - 1e-2; 1 << 24]);
        assert!((psnr(&a, &b).unwrap() - 40.0).abs() < 1e-4);
    }

    #[test]
    fn pooling_drops_odd_edges() {
        let image: Vec<f32> = (0..15).map(|i| i as f32).collect();
        assert_eq!(pool2(&image, 3, 5), [3.0, 5.0]);
        assert_eq!(pool2(&image, 5, 3), [2.0, 8.0]);
        assert_eq!(pool2(&image, 1, 15), image);
    }

    #[test]
    fn one_exposure_is_fitted_over_all_images() {
        let images: [(&[f32], &[f32]); 2] = [(&[1.0, 2.0], &[2.0, 4.0]), (&[1.0], &[8.0])];
        // (2 + 8 + 8) / (1 + 4 + 1), neither image's own factor (2 and 8).
        assert_eq!(fit_exposure(images).unwrap(), 3.0);
        assert_eq!(fit_exposure([(&[0.0f32][..], &[1.0f32][..])]), Err(EvaluateError::Dark));
        assert!(fit_exposure([(&[0.0f32][..], &[][..])]).is_err());
    }
}
