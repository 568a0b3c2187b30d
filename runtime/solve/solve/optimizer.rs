//! The optimizers that move the phases, and their schedules.

use crate::plan::Purpose;
use serde::{Deserialize, Serialize};

/// The optimizer that moves the phases.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase", tag = "kind")]
pub enum Optimizer {
    /// The pupil-wise projection (OPTICS 6b). It is the method of Gerchberg and Saxton, combined over pupils as in
    /// ptychography.
    Projection {
        /// Gain of the first and the last step, with a half cosine between them.
        gain: [f64; 2],
        /// Share of the velocity that each step keeps.
        momentum: f64,
        /// Exponent of the overlap by which the change is divided.
        overlap_power: f64,
    },
    /// Adam on the closed-form Wirtinger gradient, as in the paper (OPTICS 4).
    Adam {
        /// Learning rate of the first and the last step in radians, with a half cosine between them.
        rate: [f64; 2],
        /// Compares amplitudes instead of intensities.
        amplitude: bool,
    },
}

impl Optimizer {
    /// Returns the projection as tuned on several scenes (docs/results/against-pytorch.json).
    pub const fn projection() -> Self {
        Self::Projection { gain: [2.5, 0.3], momentum: 0.5, overlap_power: 0.5 }
    }

    /// Returns the purpose of an engine's buffers.
    pub(super) fn purpose(&self) -> Purpose {
        if matches!(self, Self::Adam { .. }) { Purpose::Adam } else { Purpose::Project }
    }

    /// Returns the projection with more momentum and a smaller last gain. It is better by 0.1 dB with a hundred steps
    /// or more and a window of twice the pupil (docs/results/speed-and-accuracy.json).
    pub fn momentum() -> Self {
        Self::Projection { gain: [2.5, 0.15], momentum: 0.7, overlap_power: 0.5 }
    }

    /// Returns Adam at twice the rate of the paper, which is better here by 0.3 dB. The rate decays to a twentieth.
    pub const fn adam() -> Self {
        Self::Adam { rate: [0.2, 0.01], amplitude: false }
    }
}

/// Returns a half cosine from `from` to `to` for a `progress` from 0 to 1.
pub fn cosine([from, to]: [f64; 2], progress: f64) -> f64 {
    to + (from - to) * 0.5 * (1.0 + (std::f64::consts::PI * progress.clamp(0.0, 1.0)).cos())
}
