//! How complex fields lie in memory, and the powers of two that keep them in a half's range.
//!
//! `Field`, `Change` and `Window` are most of what a solve holds and moves. As halves they take half the room, and all
//! arithmetic stays in float32. A half reaches from 6e-8 to 65504 and has 11 bits wherever in that range a value lies, so
//! what matters is where. Transforms are unnormalised: they raise the typical value by the root of the number of points,
//! and the largest possible one by that number. Each buffer is therefore held times a power of two, which costs no digit
//! and goes into factors that the kernels have anyway:
//!
//! - `Field`, times 2^15 / points (at most 1): no bin of any phases exceeds 2^15, not even if all light is in one, and the
//!   typical bin is 2^15 / sqrt(points), far from the small end.
//! - `Window`, times 2^15 / sqrt(points), between 1 and 16: the retinal field is at most the root of the number of bins
//!   that pass, which is light focused on one point, and the spectrum before it stays clear of the small end.
//! - `Change`, times the same for the projection, whose change is in units of the field. A gradient is as small as the
//!   scene is large and dim, so it is lifted by its own expected size first, and so is the factor of `compare`.
//!
//! Only the change can still become too large, for exposures far off; `check_finite` finds that before phases move.
//!
//! `Transfer` stays in float32: it is one sub-frame's worth beside a window's F, and its error would be the same in all
//! sub-frames, so that their mean would not lessen it.

use super::{Planner, PupilPass};
use eyebox_kernels::compare;
use serde::{Deserialize, Serialize};

/// How complex fields are stored; arithmetic is in float32 always.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum Storage {
    /// Two float32.
    #[default]
    #[serde(rename = "fp32")]
    F32,
    /// Two halves: half the memory. On the CPU engine this is for comparison only: it rounds to halves and keeps
    /// float32, so that it saves nothing and takes longer.
    #[serde(rename = "fp16")]
    F16,
}

/// The power of two below `value`, or at it, as near as 2^-60 .. 2^60 goes.
fn power(value: f64) -> f64 {
    if value > 0.0 { value.log2().floor().clamp(-60.0, 60.0).exp2() } else { 1.0 }
}

impl Storage {
    /// All of them.
    pub const ALL: [Self; 2] = [Self::F32, Self::F16];

    /// The name by which it is chosen.
    pub fn name(self) -> &'static str {
        ["fp32", "fp16"][self as usize]
    }

    /// The storage of this name.
    pub fn by_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|s| s.name() == name)
    }

    /// Bytes of a complex value on a device.
    pub fn bytes(self) -> usize {
        [8, 4][self as usize]
    }

    /// What `Field` is held times, on a grid of so many points. Beyond 2^28 points the smallest values would be lost, so
    /// there it stays where it is, and a field that sends nearly all light into one bin overflows.
    pub fn field_scale(self, points: usize) -> f64 {
        match self {
            Self::F32 => 1.0,
            Self::F16 => power(32768.0 / points.max(1) as f64).clamp(2f64.powi(-13), 1.0),
        }
    }

    /// What a field is held times whose transforms each way, over so many values, have the root of their number between
    /// them.
    pub(super) fn between(self, values: usize) -> f64 {
        match self {
            Self::F32 => 1.0,
            Self::F16 => power(32768.0 / (values.max(1) as f64).sqrt()).clamp(1.0, 16.0),
        }
    }
}

impl Planner {
    /// The size of what `compare` finds, in units of its weight: the difference of intensities follows the exposure, or
    /// the brightest of what is wanted; that of amplitudes is about 1.
    fn difference(&self, mode: u32, exposure: f64) -> f64 {
        let brightest = self.views.as_ref().map_or(1.0, |v| 65535.0 * v.unit);
        if mode == compare::INTENSITY { exposure.max(brightest / 8.0) } else { 1.0 }
    }

    /// What the factor of `compare` is held times.
    pub(super) fn factor_scale(&self, mode: u32, exposure: f64, weight: f64) -> f64 {
        match self.storage {
            Storage::F16 if mode != compare::PROJECTION => power(1.0 / (weight * self.difference(mode, exposure))),
            _ => 1.0,
        }
    }

    /// What `Change` is held times when images are compared so. A step's pupil passes share mode and exposure.
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

    /// The same, of these pupil passes.
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
        /// No phases can overflow what is held between the field and the retina, nor are typical values near the small end.
        #[test]
        fn fields_stay_in_range(height in 1usize..20_000, width in 1usize..16_000, share in 1e-4f64..1.0) {
            prop_assume!(height * width <= 1 << 28);
            let points = height * width;
            let field = Storage::F16.field_scale(points);
            // All light in one bin, and evenly over all.
            prop_assert!(field * points as f64 <= f64::from(LARGEST));
            prop_assert!(field * (points as f64).sqrt() >= 2f64.powi(-13) && field >= 2f64.powi(-13));
            let bins = (share * points as f64).ceil();
            let window = Storage::F16.between(bins as usize);
            prop_assert!(window * bins.sqrt() <= f64::from(LARGEST));
            // Its spectrum: at least as large as the smallest normal halves.
            prop_assert!(window / (points as f64).sqrt() >= 2f64.powi(-14), "{}", window / (points as f64).sqrt());
            prop_assert_eq!(Storage::F32.field_scale(points) * Storage::F32.between(points), 1.0);
        }

        /// Whatever a field is held times, the same comes of it: factors differ by powers of two that cancel.
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

    #[test]
    fn names_are_those_of_the_files() {
        for storage in Storage::ALL {
            assert_eq!(serde_json::to_value(storage).unwrap(), storage.name());
            assert_eq!(Storage::by_name(storage.name()), Some(storage));
        }
        assert_eq!(Storage::by_name("fp8"), None);
    }
}
