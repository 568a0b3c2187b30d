//! How fine a pattern an eye tells from an even field: its contrast sensitivity.

/// Contrast sensitivity of a standard observer to a grating of `cycles_per_degree` (above 0) at a luminance of `cd_m2`, over a field of
/// 12 by 12 degrees: 1 over the modulation that is just seen. Barten, "Formula for the contrast sensitivity of the human eye",
/// Proc. SPIE 5294 (2003), with the constants of "Contrast Sensitivity of the Human Eye and Its Effects on Image Quality" (1999).
pub fn contrast_sensitivity(cycles_per_degree: f64, cd_m2: f64) -> f64 {
    /// Square degrees.
    const FIELD: f64 = 144.0;
    let u2 = cycles_per_degree * cycles_per_degree;
    // The lens and the retina's mosaic; noise of photons and of nerves; inhibition by what is around.
    let optics = 5200.0 * (-0.0016 * u2 * (1.0 + 100.0 / cd_m2).powf(0.08)).exp();
    let summed = 1.0 + 144.0 / FIELD + 0.64 * u2;
    let noise = 63.0 / cd_m2.powf(0.83) + 1.0 / (1.0 - (-0.02 * u2).exp());
    optics / (summed * noise).sqrt()
}

/// Contrast of the noise that is looked at: the speckle of eight sub-frames.
const SPECKLE: f64 = 0.35;

/// Standard deviation in cycles per degree of the Gaussian over spatial frequencies that passes, of the power of even noise, as
/// much as an eye sees of speckle: all of a frequency whose [threshold](contrast_sensitivity) speckle exceeds (contrasts far above
/// it look alike at all frequencies; Georgeson and Sullivan, "Contrast constancy", J. Physiol. 252, 1975), else their ratio.
pub fn resolved_frequencies(cd_m2: f64) -> f64 {
    const STEP: f64 = 0.05;
    let sensitivity = |k: usize| contrast_sensitivity(k as f64 * STEP, cd_m2);
    // At 60 cycles per degree nothing is left.
    let all: Vec<f64> = (1..1200).map(sensitivity).collect();
    // Below the peak all of it passes: there are too few frequencies for anything to be gained by what is lost there.
    let at = all.iter().enumerate().fold((0, 0.0), |best, (i, s)| if *s > best.1 { (i, *s) } else { best }).0;
    let power = |(i, s): (usize, &f64)| (i + 1) as f64 * if i < at { 1.0 } else { (s * SPECKLE).min(1.0) };
    // Over the plane a Gaussian of this deviation passes its square times 2 pi.
    (all.iter().enumerate().map(power).sum::<f64>() * STEP * STEP).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_peaks_at_some_cycles_and_ends_at_sixty() {
        let peak = |cd_m2: f64| {
            let at = |k: usize| (contrast_sensitivity(f64::from(k as u32) * 0.1, cd_m2), k);
            (1..600).map(at).fold((0.0, 0), |a, b| if b.0 > a.0 { b } else { a })
        };
        let (high, at) = peak(100.0);
        assert!((500.0..800.0).contains(&high) && (20..50).contains(&at), "{high} at {at}");
        // Less light: less sensitive, and to coarser patterns.
        let (low, coarser) = peak(0.1);
        assert!(low < high / 3.0 && coarser < at, "{low} at {coarser}");
        assert!(contrast_sensitivity(60.0, 100.0) < 1.0);
    }

    #[test]
    fn noise_beyond_some_cycles_is_not_resolved() {
        let [dim, usual, bright] = [1.0, 40.0, 1000.0].map(resolved_frequencies);
        assert!((33.0..36.0).contains(&usual) && dim < usual && usual < bright, "{dim}, {usual}, {bright}");
        // The same power, summed another way.
        let gaussian = |u: f64| (-u * u / (2.0 * usual * usual)).exp();
        let passes: f64 = (0..60_000).map(|k| (f64::from(k) + 0.5) * 0.01).map(|u| u * gaussian(u) * 0.01).sum();
        assert!((passes / (usual * usual) - 1.0).abs() < 1e-3);
    }
}
