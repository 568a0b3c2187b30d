//! A hologram against its scene: one exposure for all pupils, then a score for each.

use super::{EvaluateError, fit_exposure, psnr, ssim};
use serde::{Deserialize, Serialize};

/// What one pupil scored in one colour.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Score {
    /// dB, peak 1.
    pub psnr: f64,
    /// None where the picture is smaller than SSIM's window.
    pub ssim: Option<f64>,
}

/// What all pupils of one colour came to.
#[derive(Debug, Clone, PartialEq)]
pub struct Compared {
    /// The one exposure, fitted over all of them.
    pub exposure: f64,
    /// Per pupil.
    pub scores: Vec<Score>,
}

/// Scores the intensities `seen` against the photographs `wanted`, pupil by pupil, all (height, width) and averaged
/// over 2 x 2 pixels already, after fitting one exposure over all pupils together: never one per pupil, which would hide
/// an uneven eyebox (OPTICS 2).
///
/// # Errors
/// [`EvaluateError::Sizes`]; [`EvaluateError::Dark`] where nothing is seen through any pupil.
pub fn compare(seen: &[Vec<f32>], wanted: &[Vec<f32>], height: usize, width: usize) -> Result<Compared, EvaluateError> {
    if seen.len() != wanted.len() {
        return Err(EvaluateError::Sizes { one: seen.len(), other: wanted.len() });
    }
    let exposure = fit_exposure(seen.iter().zip(wanted).map(|(s, w)| (&s[..], &w[..])))?;
    let score = |(seen, wanted): (&Vec<f32>, &Vec<f32>)| {
        let exposed: Vec<f32> = seen.iter().map(|v| v * exposure as f32).collect();
        let psnr = psnr(&exposed, wanted)?;
        let ssim = match ssim(&exposed, wanted, height, width) {
            Ok(value) => Some(value),
            Err(EvaluateError::TooSmall { .. }) => None,
            Err(other) => return Err(other),
        };
        Ok(Score { psnr, ssim })
    };
    let scores = seen.iter().zip(wanted).map(score).collect::<Result<_, _>>()?;
    Ok(Compared { exposure, scores })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_dim_pupil_stays_dim() {
        // Two pupils, one of which sees half the light: one exposure cannot serve both, and the scores say so.
        let target: Vec<f32> = (0..256).map(|i| 0.2 + (i % 7) as f32 * 0.05).collect();
        let bright: Vec<f32> = target.iter().map(|t| 2.0 * t).collect();
        let even = compare(&[bright.clone(), bright.clone()], &[target.clone(), target.clone()], 16, 16).unwrap();
        assert!((even.exposure - 0.5).abs() < 1e-6 && even.scores.iter().all(|s| s.psnr > 100.0));
        assert!(even.scores.iter().all(|s| (s.ssim.unwrap() - 1.0).abs() < 1e-6));
        let uneven = compare(&[bright, target.clone()], &[target.clone(), target.clone()], 16, 16).unwrap();
        assert!(uneven.scores.iter().all(|s| s.psnr < 25.0), "{uneven:?}");
    }

    #[test]
    fn small_pictures_have_no_ssim_and_black_ones_no_exposure() {
        let small = compare(&[vec![0.5; 4]], &[vec![0.25; 4]], 2, 2).unwrap();
        assert_eq!(small.scores[0].ssim, None);
        assert_eq!(compare(&[vec![0.0; 4]], &[vec![0.25; 4]], 2, 2), Err(EvaluateError::Dark));
        assert!(compare(&[vec![0.0; 4]], &[], 2, 2).is_err());
    }
}
