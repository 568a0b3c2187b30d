//! Computes the three sums from which exposure and PSNR follow, on the engine, without reading images back.

use super::EvaluateError;
use super::look::{crop, pass_by_pass};
use crate::engine::{Buffer, Engine, EngineError};
use crate::optics::WindowFactor;
use crate::plan::{Comparison, Planner, Viewpoint};
use eyebox_kernels::exposure::{Args, PART, exposure};
use eyebox_kernels::modulate;

/// Mean square of a target below which it is black, for 1/65535 of full scale.
const BLACK_POWER: f64 = 2.4e-10;

/// Returns true if a target of this mean square has no light. A PSNR against it has no meaning for quality.
pub(crate) fn is_black(power: f64) -> bool {
    power < BLACK_POWER
}

/// The sums of one viewpoint's image `I` and target `T`, both averaged over 2 x 2 pixels.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Sums {
    /// The scalar product `<I, T>`.
    pub with_target: f64,
    /// The scalar product `<I, I>`.
    pub with_itself: f64,
    /// The scalar product `<T, T>`.
    pub of_target: f64,
    /// Number of averaged pixels.
    pub pixels: usize,
}

impl Sums {
    /// Returns the sums of the partial results of the kernel `exposure`.
    pub(crate) fn of_parts(parts: &[f32], pixels: usize) -> Self {
        let sum = |k: usize| parts.chunks_exact(PART).map(|p| f64::from(p[2 * k]) + f64::from(p[2 * k + 1])).sum();
        Self { with_target: sum(0), with_itself: sum(1), of_target: sum(2), pixels }
    }

    /// Returns the sums of an image and its target of the same size, which are already averaged over 2 x 2 pixels.
    ///
    /// # Errors
    /// Returns [`EvaluateError::Sizes`], or [`EvaluateError::TooSmall`] for images without pixels.
    pub fn of_images(image: &[f32], target: &[f32]) -> Result<Self, EvaluateError> {
        if image.len() != target.len() {
            return Err(EvaluateError::Sizes { one: image.len(), other: target.len() });
        }
        if image.is_empty() {
            return Err(EvaluateError::TooSmall { height: 0, width: 0, least: 1 });
        }
        let mut sums = Self { pixels: image.len(), ..Self::default() };
        for (&i, &t) in image.iter().zip(target) {
            let (i, t) = (f64::from(i), f64::from(t));
            sums.with_target += i * t;
            sums.with_itself += i * i;
            sums.of_target += t * t;
        }
        Ok(sums)
    }

    /// Returns the single exposure that fits all images `I` to their targets `T` in the least-squares sense, `sum <I,
    /// T> / sum <I, I>`. It is for comparisons of finished holograms. As a guide for a solve it is too low (OPTICS 6c).
    ///
    /// # Errors
    /// Returns [`EvaluateError::Dark`] for images without light.
    pub fn fit_exposure(all: &[Self]) -> Result<f64, EvaluateError> {
        let with_itself: f64 = all.iter().map(|s| s.with_itself).sum();
        if with_itself > 0.0 {
            Ok(all.iter().map(|s| s.with_target).sum::<f64>() / with_itself)
        } else {
            Err(EvaluateError::Dark)
        }
    }

    /// Returns the mean square of the target.
    pub fn target_power(&self) -> f64 {
        self.of_target / self.pixels.max(1) as f64
    }

    /// Returns the PSNR at this exposure in dB, as [`psnr`](super::psnr) computes it from the images. It is infinite
    /// without an error. It is within 0.01 dB up to 100 dB, because sums of an engine have 48 bits.
    pub fn psnr(&self, exposure: f64) -> f64 {
        Self::psnr_of_colors(&[(*self, exposure)])
    }

    /// Returns [`psnr`](Self::psnr) as a quality in dB, or `None` if the target is black.
    pub fn quality(&self, exposure: f64) -> Option<f64> {
        Self::quality_of_colors(&[(*self, exposure)])
    }

    /// Returns [`psnr_of_colors`](Self::psnr_of_colors) as a quality. Returns `None` if the target is black in all
    /// colors, since a black image of it would be perfect.
    pub fn quality_of_colors(colors: &[(Self, f64)]) -> Option<f64> {
        let is_lit = |(sums, _): &(Self, f64)| !is_black(sums.target_power());
        colors.iter().any(is_lit).then(|| Self::psnr_of_colors(colors))
    }

    /// Returns the PSNR in dB of one pupil over several colors, each with its exposure. Every pixel has the same
    /// weight.
    pub fn psnr_of_colors(colors: &[(Self, f64)]) -> f64 {
        let error: f64 = colors.iter().map(|(sums, exposure)| sums.error(*exposure)).sum();
        -10.0 * (error / colors.iter().map(|(sums, _)| sums.pixels).sum::<usize>() as f64).log10()
    }

    /// Returns the sums of an image and its target on the SLM's pixels.
    fn of_pixels(place: &modulate::Args, image: &[f32], target: &[f32]) -> Self {
        let modulate::Args { height, width, .. } = *place;
        let args = Args { height, width, pitch: width, top: 0, left: 0 };
        let mut parts = vec![0.0; PART * args.parts()];
        exposure(&args, image, target, &mut parts);
        Self::of_parts(&parts, args.pixels())
    }

    /// Returns the sum of squared differences at this exposure.
    fn error(&self, exposure: f64) -> f64 {
        let error = exposure * (exposure * self.with_itself - 2.0 * self.with_target) + self.of_target;
        // NaN stays NaN.
        if error < 0.0 { 0.0 } else { error }
    }
}

/// Returns the sums of each viewpoint, from the phases in `engine` and the target images of its views, on the SLM's
/// pixels.
///
/// # Errors
/// Returns the errors of the engine.
pub fn sums(engine: &mut dyn Engine, planner: &Planner, viewpoints: &[Viewpoint]) -> Result<Vec<Sums>, EngineError> {
    let planner = Planner { factor: WindowFactor::Full, ..planner.clone() };
    let pupil_passes = viewpoints.iter().map(|s| planner.viewpoint(s, &Comparison::default())).collect();
    let place = planner.place();
    pass_by_pass(engine, planner.exposure_step(pupil_passes), |engine, pupil_pass| {
        if planner.slm.mask_factor > 1 {
            let [image, target] = [engine.read(Buffer::Image(0))?, engine.read(Buffer::Target(0))?];
            return Ok(Sums::of_pixels(&place, &crop(&planner, image), &crop(&planner, target)));
        }
        Ok(Sums::of_parts(&engine.read(Buffer::Sums(0))?, pupil_pass.exposure(&place).pixels()))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evaluate::{fit_exposure, pool2, psnr};

    fn noise(count: usize, seed: u64) -> Vec<f32> {
        let mix = |i: u64| (i + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15).rotate_left(29).wrapping_mul(seed | 0x2545_f491);
        (0..count as u64).map(|i| (mix(i + (seed << 32)) >> 40) as f32 / (1 << 24) as f32).collect()
    }

    fn sums_of(image: &[f32], target: &[f32], height: usize, width: usize) -> Sums {
        let args = Args { height: height as u32, width: width as u32, pitch: width as u32, top: 0, left: 0 };
        let mut parts = vec![0.0; PART * args.parts()];
        exposure(&args, image, target, &mut parts);
        Sums::of_parts(&parts, args.pixels())
    }

    /// Covers odd sizes, single rows and columns, and more than one part, from poor images to nearly perfect ones.
    #[test]
    fn exposure_and_psnr_are_those_of_the_images() {
        for (height, width) in [(1, 1), (1, 9), (9, 1), (7, 13), (45, 64), (151, 203)] {
            let target = noise(height * width, 1);
            for decibels in [10.0, 30.0, 60.0, 100.0] {
                // The image is 1 / 0.7 brighter than the target, with noise of this size.
                let beside = noise(height * width, 2);
                let far = (10f64.powf(-decibels / 20.0) * 12f64.sqrt()) as f32;
                let image: Vec<f32> =
                    target.iter().zip(&beside).map(|(t, n)| (t + far * (n - 0.5)).max(0.0) / 0.7).collect();
                let sums = sums_of(&image, &target, height, width);
                let (image, target) = (pool2(&image, height, width), pool2(&target, height, width));
                assert_eq!(sums.pixels, target.len());
                let wanted = fit_exposure([(&image[..], &target[..])]).unwrap();
                let found = Sums::fit_exposure(&[sums]).unwrap();
                assert!((found / wanted - 1.0).abs() < 1e-12, "{height} x {width}: {found}, not {wanted}");
                // Tests the fitted exposure and another. The error of a single pixel is zero at the fitted exposure, so
                // that is skipped.
                for exposure in [wanted, 0.9 * wanted].into_iter().skip(usize::from(target.len() < 2)) {
                    let error =
                        image.iter().zip(&target).map(|(i, t)| (exposure * f64::from(*i) - f64::from(*t)).powi(2));
                    let exact = -10.0 * (error.sum::<f64>() / target.len() as f64).log10();
                    let got = sums.psnr(exposure);
                    assert!((got - exact).abs() < 0.01, "{height} x {width}: {got} dB, not {exact}");
                    let seen: Vec<f32> = image.iter().map(|i| i * exposure as f32).collect();
                    if exact < 90.0 {
                        assert!((got - psnr(&seen, &target).unwrap()).abs() < 0.01);
                    }
                }
            }
        }
    }

    #[test]
    fn what_has_no_light_has_no_exposure() {
        let sums = sums_of(&[0.0; 35], &[0.5; 35], 5, 7);
        assert_eq!(Sums::fit_exposure(&[sums, sums]), Err(EvaluateError::Dark));
        assert!((sums.psnr(1.0) - 10.0 * 4f64.log10()).abs() < 1e-9);
        assert_eq!(sums_of(&[0.5; 35], &[0.5; 35], 5, 7).psnr(1.0), f64::INFINITY);
        assert!(sums_of(&[f32::NAN; 4], &[0.5; 4], 2, 2).psnr(1.0).is_nan());
    }
}
