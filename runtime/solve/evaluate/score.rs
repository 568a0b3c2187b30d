//! Scores pupils at one exposure for all of them, and summarizes lists of scores.

use super::ssim::ssim_at;
use super::sums::is_black;
use super::{EvaluateError, Sums};
use serde::{Deserialize, Serialize};

/// PSNR of several pupils at one exposure for all of them. An exposure per pupil would hide an uneven eyebox (OPTICS
/// 2).
///
/// If all pupils see about the same light, the exposure is the fit over all of them ([`fitted`](Self::fitted)). Some
/// pupils may see many times the light of others. Examples are the corners of the eyebox, where methods leave unwanted
/// light, and a narrow pupil on the peak of a smooth phase. Then such a fit follows the few brightest pupils and leaves
/// the rest dark. In this case the exposure is fitted through the widest pupil, as a photographer would, and given
/// ([`at`](Self::at)).
#[derive(Debug, Clone, PartialEq)]
pub struct Scores {
    /// PSNR in dB of each pupil whose target is not black, after 2 x 2 averaging. If all targets are black, it holds
    /// each pupil. Such values only compare states, since [`quality`](Self::quality) is `None`.
    pub psnr: Vec<f64>,
    /// The exposure of all pupils.
    pub exposure: f64,
    /// Mean square of the targets of all pupils.
    pub target_power: f64,
}

impl Scores {
    /// Scores at the least-squares fit over all pupils.
    ///
    /// # Errors
    /// Returns [`EvaluateError::Dark`] for images without light.
    pub fn fitted(sums: &[Sums]) -> Result<Self, EvaluateError> {
        Ok(Self::at(sums, Sums::fit_exposure(sums)?))
    }

    /// Scores at the given exposure.
    pub fn at(sums: &[Sums], exposure: f64) -> Self {
        let target_power = sums.iter().map(Sums::target_power).sum::<f64>() / sums.len().max(1) as f64;
        let lit: Vec<f64> = sums.iter().filter_map(|s| s.quality(exposure)).collect();
        let psnr = if lit.is_empty() { sums.iter().map(|s| s.psnr(exposure)).collect() } else { lit };
        Self { psnr, exposure, target_power }
    }

    /// Returns the mean and worst PSNR over pupils as a quality in dB. Returns `None` if all targets are black, since a
    /// black hologram of them would be perfect.
    pub fn quality(&self) -> Option<[f64; 2]> {
        (!is_black(self.target_power)).then(|| [self.mean(), self.worst()])
    }

    /// Returns the mean over pupils in dB.
    pub fn mean(&self) -> f64 {
        self.psnr.iter().sum::<f64>() / self.psnr.len().max(1) as f64
    }

    /// Returns the PSNR of the worst pupil in dB.
    pub fn worst(&self) -> f64 {
        self.psnr.iter().copied().fold(f64::INFINITY, f64::min)
    }

    /// Converts scores for targets that were divided by `unit` to the exposure and errors of the original targets.
    pub(crate) fn in_units_of(mut self, unit: f64) -> Self {
        self.exposure *= unit;
        self.target_power *= unit * unit;
        self.psnr.iter_mut().for_each(|db| *db -= 20.0 * unit.log10());
        self
    }
}

/// The scores of one pupil in one color.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Score {
    /// PSNR in dB with peak 1, or `None` if the target image is black.
    pub psnr: Option<f64>,
    /// SSIM, or `None` if the picture is smaller than SSIM's window.
    pub ssim: Option<f64>,
}

/// Returns PSNR and SSIM of the intensities `seen` against the target images `wanted`, for each pupil, at one exposure
/// for all of them (see [`Scores`]). All images are (height, width) and already averaged over 2 x 2 pixels.
///
/// # Errors
/// Returns [`EvaluateError::Sizes`] for lists or images of different sizes.
pub fn compare(
    seen: &[Vec<f32>],
    wanted: &[Vec<f32>],
    exposure: f64,
    height: usize,
    width: usize,
) -> Result<Vec<Score>, EvaluateError> {
    if seen.len() != wanted.len() {
        return Err(EvaluateError::Sizes { one: seen.len(), other: wanted.len() });
    }
    let score = |(seen, wanted): (&Vec<f32>, &Vec<f32>)| {
        let psnr = Sums::of_images(seen, wanted)?.quality(exposure);
        Ok(Score { psnr, ssim: ssim_at(exposure, seen, wanted, height, width)? })
    };
    seen.iter().zip(wanted).map(score).collect()
}

/// Statistics of scores for which a higher value is better.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Summary {
    /// Arithmetic mean of the scores.
    pub mean: f64,
    /// Median. Half of the scores are at or below it.
    pub median: f64,
    /// The lowest of the scores.
    pub worst: f64,
    /// The highest of the scores.
    pub best: f64,
    /// Lower quartile of the scores.
    pub q25: f64,
    /// Upper quartile of the scores.
    pub q75: f64,
    /// Standard deviation of these scores, not of a population estimated from them.
    pub sd: f64,
}

impl Summary {
    /// Summarizes scores, or returns none for no scores. Quantiles are interpolated linearly between scores, as in
    /// NumPy.
    pub fn of(scores: &[f64]) -> Option<Self> {
        let mut sorted = scores.to_vec();
        sorted.sort_by(f64::total_cmp);
        let (&worst, &best) = (sorted.first()?, sorted.last()?);
        let quantile = |q: f64| {
            let at = q * (sorted.len() - 1) as f64;
            let (below, above) = (sorted[at.floor() as usize], sorted[at.ceil() as usize]);
            // Equal infinities have no difference, and need none.
            if below == above { below } else { below + (above - below) * at.fract() }
        };
        let n = sorted.len() as f64;
        let mean = sorted.iter().sum::<f64>() / n;
        let sd = (sorted.iter().map(|s| (s - mean).powi(2)).sum::<f64>() / n).sqrt();
        Some(Self { mean, median: quantile(0.5), worst, best, q25: quantile(0.25), q75: quantile(0.75), sd })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_dim_pupil_stays_dim() {
        // The second pupil sees half the light. One exposure cannot serve both, and the scores must show it.
        let target: Vec<f32> = (0..256).map(|i| 0.2 + (i % 7) as f32 * 0.05).collect();
        let bright: Vec<f32> = target.iter().map(|t| 2.0 * t).collect();
        let scores = compare(&[bright, target.clone()], &[target.clone(), target], 0.5, 16, 16).unwrap();
        assert!(scores[0].psnr.unwrap() > 100.0 && (scores[0].ssim.unwrap() - 1.0).abs() < 1e-6);
        // About half of 0.35.
        assert!((14.0..16.0).contains(&scores[1].psnr.unwrap()) && scores[1].ssim.unwrap() < 0.9, "{scores:?}");
    }

    /// A black target has no quality, even if the error is small. A target with one lit pixel has a quality.
    #[test]
    fn black_targets_have_no_quality() {
        let sums = |image: f32, target: f32| {
            let mut targets = vec![0.0; 256];
            targets[7] = target;
            Sums::of_images(&[image; 256], &targets).unwrap()
        };
        for image in [0.0, 1e-6, 0.5] {
            let black = Scores::at(&[sums(image, 0.0), sums(image, 0.0)], 1.0);
            assert_eq!((black.quality(), black.psnr.len()), (None, 2));
            assert_eq!(Sums::quality_of_colors(&[(sums(image, 0.0), 1.0)]), None);
            let lit = Scores::at(&[sums(image, 0.0), sums(image, 0.5)], 1.0);
            assert_eq!(lit.quality(), Some([lit.mean(), lit.worst()]));
            // The black pupil is no part of the mean.
            assert_eq!(lit.psnr, [sums(image, 0.5).psnr(1.0)]);
            let [black, wanted] =
                [0.0, 0.5].map(|t| (0..256).map(|i| if i == 7 { t } else { 0.0 }).collect::<Vec<f32>>());
            let seen = vec![vec![image; 256]; 2];
            let compared = compare(&seen, &[black, wanted], 1.0, 16, 16).unwrap();
            assert!(compared[0].psnr.is_none() && compared[1].psnr.is_some_and(f64::is_finite));
            let colors = [(sums(image, 0.0), 1.0), (sums(image, 0.5), 1.0)];
            assert_eq!(Sums::quality_of_colors(&colors), Some(Sums::psnr_of_colors(&colors)));
        }
        // Targets that were divided by a unit count in their original scale.
        assert!(Scores::at(&[sums(0.0, 0.5)], 1.0).in_units_of(1e-6).quality().is_none());
    }

    #[test]
    fn small_pictures_have_no_ssim() {
        let small = compare(&[vec![0.5; 4]], &[vec![0.25; 4]], 0.5, 2, 2).unwrap();
        assert!(small[0].ssim.is_none() && small[0].psnr == Some(f64::INFINITY));
        assert!(compare(&[vec![0.0; 4]], &[], 1.0, 2, 2).is_err());
        assert!(compare(&[vec![0.0; 4]], &[vec![0.0; 6]], 1.0, 2, 2).is_err());
    }

    #[test]
    fn quantiles_are_numpys() {
        // NumPy gives percentile([25, 50, 75]) = [21.75, 25.0, 28.25] and std = 4.4503433076062295.
        let s = Summary::of(&[29.0, 18.0, 24.0, 26.0, 31.0, 21.0]).unwrap();
        assert_eq!((s.q25, s.median, s.q75, s.worst, s.best), (21.75, 25.0, 28.25, 18.0, 31.0));
        assert!((s.mean - 149.0 / 6.0).abs() < 1e-12);
        assert!((s.sd - 4.4503433076062295).abs() < 1e-12, "{}", s.sd);
        let one = Summary::of(&[7.0]).unwrap();
        assert_eq!((one.mean, one.q25, one.sd), (7.0, 7.0, 0.0));
        assert_eq!(Summary::of(&[]), None);
        assert_eq!(Summary::of(&[f64::INFINITY; 3]).unwrap().median, f64::INFINITY);
    }
}
