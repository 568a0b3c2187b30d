//! What a list of scores comes to.

use serde::Serialize;

/// Statistics of scores of which more is better.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Summary {
    /// Arithmetic mean.
    pub mean: f64,
    /// Half of the scores are at or below it.
    pub median: f64,
    /// The lowest.
    pub worst: f64,
    /// The highest.
    pub best: f64,
    /// Lower quartile.
    pub q25: f64,
    /// Upper quartile.
    pub q75: f64,
    /// Standard deviation, of these scores and not of a population guessed from them.
    pub sd: f64,
}

impl Summary {
    /// Quantiles lie linearly between scores, as NumPy's. None for no scores.
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
    fn quantiles_are_numpys() {
        // numpy: percentile([25, 50, 75]) = [21.75, 25.0, 28.25]; std = 4.4503433076062295.
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
