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

/// Above this PSNR, dB, a view cannot pull the exposure any further.
const CEILING_DB: f64 = 60.0;
/// How far from the least-squares fit the exposure is sought, as a factor.
const SEARCH: f64 = 64.0;

/// Scores the intensities `seen` against the photographs `wanted`, pupil by pupil, all (height, width) and averaged
/// over 2 x 2 pixels already, with one exposure for all pupils together ([`best_exposure`]): never one per pupil, which
/// would hide an uneven eyebox (OPTICS 2).
///
/// # Errors
/// [`EvaluateError::Sizes`]; [`EvaluateError::Dark`] where nothing is seen through any pupil.
pub fn compare(
    seen: &[Vec<f32>],
    wanted: &[Vec<f32>],
    height: usize,
    width: usize,
) -> Result<Compared, EvaluateError> {
    let exposure = best_exposure(seen, wanted)?;
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

/// The one exposure at which the mean PSNR over all pupils is highest.
///
/// A least-squares fit ([`fit_exposure`]) does for pupils that all see about the same light. Over pupils of which some
/// see many times the light of others (the corners of the eyebox, where methods leave what they have no use for; a
/// narrow pupil on the peak of smooth phase) it follows the few brightest and leaves all others in the dark. The mean
/// PSNR lets every pupil count alike, so that each method is shown at its own best.
///
/// # Errors
/// [`EvaluateError::Sizes`]; [`EvaluateError::Dark`].
pub fn best_exposure(seen: &[Vec<f32>], wanted: &[Vec<f32>]) -> Result<f64, EvaluateError> {
    if seen.len() != wanted.len() {
        return Err(EvaluateError::Sizes { one: seen.len(), other: wanted.len() });
    }
    let start = fit_exposure(seen.iter().zip(wanted).map(|(s, w)| (&s[..], &w[..])))?;
    if !(start.is_finite() && start > 0.0) {
        return Ok(start);
    }
    // Per pupil, the mean squared error is a e^2 - 2 b e + c.
    let moments = |(s, w): (&Vec<f32>, &Vec<f32>)| {
        let mut sums = [0.0f64; 3];
        for (&s, &w) in s.iter().zip(w) {
            let (s, w) = (f64::from(s), f64::from(w));
            sums.iter_mut().zip([s * s, s * w, w * w]).for_each(|(sum, v)| *sum += v);
        }
        sums.map(|v| v / s.len().max(1) as f64)
    };
    let all: Vec<[f64; 3]> = seen.iter().zip(wanted).map(moments).collect();
    let least = 10f64.powf(-CEILING_DB / 10.0);
    let quality = |log: f64| -> f64 {
        let e = log.exp();
        all.iter().map(|[a, b, c]| -(a * e * e - 2.0 * b * e + c).max(least).ln()).sum()
    };
    // There may be more than one peak: first everywhere, coarsely, then closer around the highest.
    const COARSE: usize = 241;
    let (mut low, mut high) = ((start / SEARCH).ln(), (start * SEARCH).ln());
    let step = (high - low) / (COARSE - 1) as f64;
    let from = low;
    let best = (0..COARSE).map(|i| from + i as f64 * step).max_by(|a, b| quality(*a).total_cmp(&quality(*b)));
    let best = best.unwrap_or(start.ln());
    (low, high) = (best - step, best + step);
    for _ in 0..40 {
        let (a, b) = (low + (high - low) / 3.0, high - (high - low) / 3.0);
        if quality(a) < quality(b) { low = a } else { high = b }
    }
    Ok(((low + high) / 2.0).exp())
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
        assert!((even.exposure - 0.5).abs() < 5e-3 && even.scores.iter().all(|s| s.psnr > 50.0));
        assert!(even.scores.iter().all(|s| (s.ssim.unwrap() - 1.0).abs() < 1e-3));
        let uneven = compare(&[bright, target.clone()], &[target.clone(), target.clone()], 16, 16).unwrap();
        assert!(uneven.scores.iter().any(|s| s.psnr < 15.0), "{uneven:?}");
    }

    #[test]
    fn one_bright_pupil_does_not_leave_the_others_dark() {
        // Nine pupils see what they should, give or take; the tenth sees twenty times the light.
        let target: Vec<f32> = (0..256).map(|i| 0.2 + (i % 7) as f32 * 0.05).collect();
        let grainy = |k: usize| -> Vec<f32> {
            target.iter().enumerate().map(|(i, t)| t * (1.0 + 0.2 * ((i * 7 + k * 3) % 5) as f32 - 0.4)).collect()
        };
        let mut seen: Vec<Vec<f32>> = (0..9).map(grainy).collect();
        seen.push(grainy(9).iter().map(|v| 20.0 * v).collect());
        let wanted = vec![target; 10];
        let exposure = best_exposure(&seen, &wanted).unwrap();
        assert!((exposure - 1.0).abs() < 0.15, "{exposure}");
        let fitted = fit_exposure(seen.iter().zip(&wanted).map(|(s, w)| (&s[..], &w[..]))).unwrap();
        assert!(fitted < 0.1, "{fitted}");
        // No other exposure has a better mean.
        let mean = |e: f32| -> f64 {
            let of = |(s, w): (&Vec<f32>, &Vec<f32>)| psnr(&s.iter().map(|v| v * e).collect::<Vec<_>>(), w).unwrap();
            seen.iter().zip(&wanted).map(of).sum()
        };
        let best = mean(exposure as f32);
        assert!((1..400).all(|i| mean(i as f32 * 0.005) <= best + 1e-3));
    }

    #[test]
    fn small_pictures_have_no_ssim_and_black_ones_no_exposure() {
        let small = compare(&[vec![0.5; 4]], &[vec![0.25; 4]], 2, 2).unwrap();
        assert_eq!(small.scores[0].ssim, None);
        assert_eq!(compare(&[vec![0.0; 4]], &[vec![0.25; 4]], 2, 2), Err(EvaluateError::Dark));
        assert!(compare(&[vec![0.0; 4]], &[], 2, 2).is_err());
    }
}
