//! Chooses one exposure per color for the whole eyebox, from the scene (OPTICS 6c).
//!
//! The exposure decides the light efficiency. If it is too low, every photon must reach a place that a pupil can see.
//! If it is too high, the speckle of the excess light shows in dark places. The best exposure follows the bright end of
//! the scene. Two measures of that end are computed from target images. They agree on scenes of surfaces, and either
//! one is within 0.3 dB of the best. They differ on sparse scenes (points on black), and then short pilot solves
//! between them decide.

/// The bright end of a scene by two measures, in linear light.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BrightEnd {
    /// `sum T^3 / sum T^2`, the mean brightness of the light that makes up the squared signal.
    pub contrast: f64,
    /// 0.65 of the 99th percentile.
    pub percentile: f64,
    /// The mean. A lower exposure is useless because there is no more light.
    pub mean: f64,
}

impl BrightEnd {
    /// Measures the target images of a scene.
    pub fn of<'a>(photographs: impl IntoIterator<Item = &'a [f32]>) -> Self {
        let (mut count, mut m1, mut m2, mut m3) = (0u64, 0.0, 0.0, 0.0);
        let mut values = Vec::new();
        for image in photographs {
            for &t in image {
                let t = f64::from(t.max(0.0));
                m1 += t;
                m2 += t * t;
                m3 += t * t * t;
            }
            count += image.len() as u64;
            values.extend_from_slice(image);
        }
        if m2.is_nan() || m2 <= 0.0 {
            // Any exposure shows a black scene.
            return Self { contrast: 0.35, percentile: 0.35, mean: 0.0 };
        }
        let rank = (values.len() - 1) * 99 / 100;
        let (_, p99, _) = values.select_nth_unstable_by(rank, f32::total_cmp);
        Self { contrast: m3 / m2, percentile: 0.65 * f64::from(*p99), mean: m1 / count as f64 }
    }

    /// Returns the bright end for an eyebox with this much light. An exposure is per unit of it.
    #[must_use]
    pub(crate) fn lit(self, light: f64) -> Self {
        Self { contrast: self.contrast / light, percentile: self.percentile / light, mean: self.mean / light }
    }

    /// Returns a first guess of the exposure.
    pub(crate) fn guess(&self) -> f64 {
        self.contrast.max(self.mean)
    }

    /// Returns exposures to try if the two measures differ, evenly spaced in log, lowest first.
    pub fn candidates(&self) -> Option<Vec<f64>> {
        let low = self.percentile.max(self.mean).max(self.contrast / 64.0);
        let high = self.guess();
        let ratio = high / low;
        if ratio.is_nan() || ratio <= 2.0 {
            return None;
        }
        // They are a factor of two apart or slightly more. One is below the range because the percentile may be too
        // high as well.
        let steps = ratio.log2().ceil();
        Some((-1..=steps as i32).map(|i| low * ratio.powf(f64::from(i) / steps)).filter(|e| *e >= self.mean).collect())
    }
}

/// Returns the peak of the parabola through three points (log exposure, dB), limited to the outer two.
pub fn peak(points: [(f64, f64); 3]) -> f64 {
    let [(a, fa), (b, fb), (c, fc)] = points.map(|(e, f)| (e.ln(), f));
    let (left, right) = ((b - a) * (fb - fc), (b - c) * (fb - fa));
    let bottom = left - right;
    if bottom.abs() < 1e-12 {
        return b.exp();
    }
    (b - 0.5 * ((b - a) * left - (b - c) * right) / bottom).clamp(a, c).exp()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn surfaces_are_guessed_and_points_are_tried() {
        let surface: Vec<f32> = (0..10_000).map(|i| 0.1 + 0.4 * (i as f32 / 9999.0)).collect();
        let end = BrightEnd::of([&surface[..]]);
        assert!(end.candidates().is_none() && (0.3..0.45).contains(&end.guess()), "{end:?}");
        let mut points = vec![0.001f32; 10_000];
        points[5_000..5_020].fill(0.9);
        let end = BrightEnd::of([&points[..]]);
        let tried = end.candidates().expect("two measures that differ");
        assert!(tried.len() > 3 && tried[0] < 0.05 && tried.iter().all(|e| *e >= end.mean), "{tried:?}");
        assert!(tried.windows(2).all(|t| t[1] > t[0]));
    }

    #[test]
    fn black_scenes_have_an_exposure() {
        let end = BrightEnd::of([&[0.0f32; 100][..]]);
        assert!(end.guess() > 0.0 && end.candidates().is_none());
    }

    #[test]
    fn the_peak_of_a_parabola_in_log() {
        let f = |e: f64| 30.0 - 2.0 * (e / 0.3).ln().powi(2);
        let found = peak([0.1, 0.2, 0.4].map(|e| (e, f(e))));
        assert!((found - 0.3).abs() < 1e-9, "{found}");
    }
}
