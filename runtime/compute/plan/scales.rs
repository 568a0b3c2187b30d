//! Chooses the powers of two by which factors and changes of a step are scaled.

use super::pass::PupilPass;
use super::pupil_pass::Planner;
use super::storage::{Storage, power};
use eyebox_kernels::compare;

impl Planner {
    /// Returns the expected result of `compare`, in units of its weight. A difference of intensities follows the
    /// exposure or the brightest target value. A difference of amplitudes is about 1.
    fn difference(&self, mode: u32, exposure: f64) -> f64 {
        let brightest = self.views.as_ref().map_or(1.0, |v| 65535.0 * v.unit);
        if mode == compare::INTENSITY { exposure.max(brightest / 8.0) } else { 1.0 }
    }

    /// Returns the scale of the factor of `compare`.
    pub(super) fn factor_scale(&self, mode: u32, exposure: f64, weight: f64) -> f64 {
        match self.storage {
            Storage::F16 if mode != compare::PROJECTION => power(1.0 / (weight * self.difference(mode, exposure))),
            _ => 1.0,
        }
    }

    /// Returns the scale of `Change` for this comparison. A step's pupil passes share mode and exposure.
    pub(super) fn change_scale(&self, mode: u32, exposure: f64) -> f64 {
        let points = self.grid.height * self.grid.width;
        let between = self.storage.between(points);
        match self.storage {
            Storage::F16 if mode != compare::PROJECTION => {
                let gradient = 2.0 * exposure * self.difference(mode, exposure) / (points as f64 * self.frames as f64);
                between * power(1.0 / gradient)
            }
            _ => between,
        }
    }

    /// Returns the scale of `Change` for these pupil passes.
    pub(super) fn change_scale_of(&self, pupil_passes: &[PupilPass], projects: bool) -> f64 {
        let first = pupil_passes.first().map(|l| (l.compare.mode, f64::from(l.compare.exposure)));
        let (mode, exposure) = first.unwrap_or((if projects { compare::PROJECTION } else { compare::INTENSITY }, 1.0));
        self.change_scale(mode, exposure)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::optics::{Optics, Pupil, WindowFactor};
    use crate::plan::Comparison;
    use eyebox_kernels::half::LARGEST;
    use proptest::prelude::*;

    proptest! {
        /// No phases overflow the buffers between the field and the retina, and typical values stay away from the
        /// small end.
        #[test]
        fn fields_stay_in_range(height in 1usize..20_000, width in 1usize..16_000, share in 1e-4f64..1.0) {
            prop_assume!(height * width <= 1 << 28);
            let points = height * width;
            let field = Storage::F16.field_scale(points);
            // The light is all in one bin, or evenly over all bins.
            prop_assert!(field * points as f64 <= f64::from(LARGEST));
            prop_assert!(field * (points as f64).sqrt() >= 2f64.powi(-13) && field >= 2f64.powi(-13));
            let bins = (share * points as f64).ceil();
            let window = Storage::F16.between(bins as usize);
            prop_assert!(window * bins.sqrt() <= f64::from(LARGEST));
            // The spectrum is at least as large as the smallest normal halves.
            prop_assert!(window / (points as f64).sqrt() >= 2f64.powi(-14), "{}", window / (points as f64).sqrt());
            prop_assert_eq!(Storage::F32.field_scale(points) * Storage::F32.between(points), 1.0);
        }

        /// The scale of a field does not change the result, because factors differ by powers of two that cancel.
        #[test]
        fn scales_cancel(n in 2usize..700, exposure in 1e-6f64..1e6, mode in 0u32..3, batch in 1usize..30) {
            let optics = Optics::new(n, n + 3, 8e-6, 520e-9, 0.4).unwrap();
            let plain = Planner::new(optics, 8, WindowFactor::Two);
            let half = Planner { storage: Storage::F16, ..plain.clone() };
            let comparison = Comparison { mode, exposure, batch, ..Comparison::default() };
            let pupil = Pupil { x: 1e-3, y: 0.0, diameter: 5e-3, depth: 1e-3 };
            let (a, b) = (plain.pupil_pass(&pupil, &comparison), half.pupil_pass(&pupil, &comparison));
            let field = half.storage.field_scale(n * (n + 3)) as f32;
            let window = b.pass.scale * field / a.pass.scale;
            prop_assert_eq!(b.intensity.gain * window * window, a.intensity.gain);
            let factor = b.compare.weight / a.compare.weight;
            let change = half.change_scale(mode, f64::from(exposure as f32)) as f32;
            prop_assert_eq!(b.back.scale * window * if mode == compare::PROJECTION { 1.0 } else { factor }, a.back.scale * change);
            prop_assert!(factor.log2().fract() == 0.0 && window.log2().fract() == 0.0 && change.log2().fract() == 0.0);
            prop_assert_eq!((a.compare.exposure, a.compare.floor), (b.compare.exposure, b.compare.floor));
        }
    }
}
