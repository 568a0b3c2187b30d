//! Measures images: PSNR, SSIM, exposure, energy, speckle and color, for each pupil and for groups of pupils.
//!
//! Images are linear light, (row, column), with 1 as full scale; sums are kept in float64. The measures are pure
//! functions of slices; [`views`] and [`photographs`] get the images from any engine, [`sums`] what exposure and PSNR need
//! of them.
//!
//! The order in which a hologram is scored (OPTICS 2 and 8): the intensity of every pupil and its photograph, averaged
//! over 2 x 2 pixels ([`pool2`]), come to three [`Sums`], made of the images or where they are; one exposure is fitted for
//! all pupils together, and PSNR follows pupil by pupil ([`Scores`], and with [`ssim`] [`compare`]). Their [`Summary`]: worst,
//! median and spread say more than the mean. [`members`] are the groups of pupils that the paper compares methods with.
//!
//! What a hologram scores stands beside the most that any could: the [`Ceiling`] that diffraction at the pupil sets.
//!
//! What people see of it all is said in just-objectionable differences ([`JodMetric`]), at the display's luminance and pixels a
//! degree.
//!
//! What else an eye would notice: parallax that breaks ([`sweep`]), light that is not everywhere in the eyebox
//! ([`energy`], [`passed`]), grain ([`contrast`]) and colours that come apart at edges ([`color_difference`]).

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
pub use look::{Plane, centered, crop, images, photographs, targets, views};
pub use score::{Score, Scores, Summary, compare};
pub use speckle::{averaged_contrast, contrast};
pub use ssim::ssim;
pub(crate) use ssim::ssim_at;
pub use sums::{Sums, sums};

use eyebox_base::error::Reason;

/// Why there is no number.
#[derive(Debug, Clone, PartialEq, thiserror::Error, serde::Serialize)]
#[serde(tag = "code", content = "fields", rename_all = "kebab-case")]
#[non_exhaustive]
pub enum EvaluateError {
    /// Two images that cannot be compared.
    #[error("an image of {one} pixels cannot be compared with one of {other}")]
    Sizes {
        /// Pixels of the first.
        one: usize,
        /// Pixels of the second, or what its rows and columns come to.
        other: usize,
    },
    /// An image smaller than the measure's window.
    #[error("an image of {height}x{width} pixels is too small: {least}x{least} is the least")]
    TooSmall {
        /// Rows.
        height: usize,
        /// Columns.
        width: usize,
        /// Least number of either.
        least: usize,
    },
    /// What people see of a difference cannot be told.
    #[error("JOD: {reason}")]
    Jod {
        /// Why not.
        reason: Reason,
    },
    /// No exposure makes anything of images without light.
    #[error("the images are black: no exposure brings them to their targets")]
    Dark,
}

/// Peak signal-to-noise ratio in dB, peak 1: `-10 log10(mean((a - b)^2))`; infinite for equal images.
///
/// # Errors
/// [`EvaluateError::Sizes`]; [`EvaluateError::TooSmall`] for images without pixels.
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

/// Mean of every block of 2 x 2 pixels, (`height / 2`, `width / 2`): a last odd row or column is dropped. The same for
/// every method compared, it stands for the eye's own resolution (OPTICS 8). An image of
/// a single row or column has no such block and stays as it is.
///
/// # Panics
/// If `image` is not `height` x `width`: the caller's mistake.
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

/// [`Sums::fit_exposure`] over pairs of images and targets.
///
/// # Errors
/// [`EvaluateError::Sizes`], [`EvaluateError::TooSmall`], [`EvaluateError::Dark`].
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

    /// Whole numbers over whole numbers, so that Python makes the same images.
    #[test]
    fn psnr_is_scikit_images() {
        let image = |n: usize, salt: usize| -> Vec<f32> {
            (0..n).map(|i| ((i * i * 7 + i * salt) % 101) as f32 / 100.0).collect()
        };
        // scikit-image 0.26: peak_signal_noise_ratio(a, b, data_range=1.0), and structural_similarity as in `ssim`.
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
