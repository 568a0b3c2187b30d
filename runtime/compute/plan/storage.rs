//! Chooses the storage of complex fields, and the powers of two that keep them in a half's range.
//!
//! `Field`, `Change` and `Window` are most of a solve's memory and traffic. Halves take half the memory, and all
//! arithmetic stays in float32. A half reaches from 6e-8 to 65504 and has 11 bits at every place in that range, so
//! only the range matters. Transforms are unnormalized and raise the typical value by the root of the number of
//! points, and the largest possible one by that number. Each buffer is therefore held times a power of two, which
//! costs no digit and becomes part of factors that the kernels have anyway:
//!
//! - `Field`, times 2^15 / points (at most 1). No bin of any phases exceeds 2^15, not even if all light is in one.
//!   The typical bin is 2^15 / sqrt(points), far from the small end.
//! - `Window`, times 2^15 / sqrt(points), between 1 and 16. The retinal field is at most the root of the number of
//!   bins that pass, which is light focused on one point. The spectrum before it stays clear of the small end.
//! - `Change`, times the same for the projection, whose change is in units of the field. A gradient is as small as
//!   the scene is large and dim, so it is first scaled up by its own expected size, and so is the factor of
//!   `compare`.
//!
//! Only the change can still become too large, for extreme exposures. `check_finite` finds that before phases move.
//!
//! `Transfer` stays in float32. It is the size of one sub-frame next to a window of F sub-frames, and its error would
//! be the same in all sub-frames, so that their mean would not lessen it.

use serde::{Deserialize, Serialize};

/// The storage of complex fields. Arithmetic is always in float32.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum Storage {
    /// Pairs of float32 values.
    #[default]
    #[serde(rename = "fp32")]
    F32,
    /// Pairs of halves, in half the memory. On the CPU engine this is for comparison only, because it rounds to
    /// halves and keeps float32. This saves nothing and takes longer.
    #[serde(rename = "fp16")]
    F16,
}

/// Returns the largest power of two that is at most `value`, within 2^-60 .. 2^60.
pub(super) fn power(value: f64) -> f64 {
    if value > 0.0 { value.log2().floor().clamp(-60.0, 60.0).exp2() } else { 1.0 }
}

impl Storage {
    /// All kinds of storage.
    pub const ALL: [Self; 2] = [Self::F32, Self::F16];

    /// Returns the name of the storage in settings.
    pub fn name(self) -> &'static str {
        ["fp32", "fp16"][self as usize]
    }

    /// The storage of this name.
    pub fn by_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|s| s.name() == name)
    }

    /// Returns this storage if the error of an SLM with `levels` phase levels hides its error, otherwise float32.
    /// Halves keep 60 dB or more (docs/precision.md), and the rounding to levels is at least 10 dB below that.
    pub fn for_levels(self, levels: usize) -> Self {
        if Self::decibels_of_levels(levels) < 50.0 { self } else { Self::F32 }
    }

    /// Returns the signal-to-noise ratio of a field on an SLM with `levels` phase levels, dB. Phase errors are even
    /// over one level, with the variance (2 pi / levels)^2 / 12 of the field's power.
    pub fn decibels_of_levels(levels: usize) -> f64 {
        let power = (std::f64::consts::TAU / levels.max(1) as f64).powi(2) / 12.0;
        -10.0 * power.log10()
    }

    /// Returns the bytes of a complex value on a device.
    pub fn bytes(self) -> usize {
        [8, 4][self as usize]
    }

    /// Returns the scale of `Field` on a grid of `points` points. Beyond 2^28 points the smallest values would be
    /// lost, so the scale stays there, and a field that sends nearly all light into one bin overflows.
    pub fn field_scale(self, points: usize) -> f64 {
        match self {
            Self::F32 => 1.0,
            Self::F16 => power(32768.0 / points.max(1) as f64).clamp(2f64.powi(-13), 1.0),
        }
    }

    /// Returns the scale of a field between two transforms of `values` values that multiply it by the root of their
    /// number.
    pub(super) fn between(self, values: usize) -> f64 {
        match self {
            Self::F32 => 1.0,
            Self::F16 => power(32768.0 / (values.max(1) as f64).sqrt()).clamp(1.0, 16.0),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn halves_do_for_few_levels() {
        assert!((Storage::decibels_of_levels(256) - 43.0).abs() < 0.1);
        assert_eq!([2, 256, 573, 574, 4096].map(|n| Storage::F16.for_levels(n) as usize), [1, 1, 1, 0, 0]);
        assert_eq!(Storage::F32.for_levels(2), Storage::F32);
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
