//! How phases are moved: the optimisers and their schedules.

use crate::plan::Purpose;
use serde::{Deserialize, Serialize};

/// How phases are moved.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase", tag = "kind")]
pub enum Optimizer {
    /// Pupil-wise projection (OPTICS 6b): Gerchberg and Saxton's, put together over pupils as in ptychography.
    Projection {
        /// Gain of the first and of the last step; a half cosine between.
        gain: [f64; 2],
        /// Share of the velocity that is kept.
        momentum: f64,
        /// The change is divided by the overlap to this power.
        overlap_power: f64,
    },
    /// Adam on the closed-form Wirtinger gradient, the paper's (OPTICS 4).
    Adam {
        /// Learning rate of the first and of the last step, radians; a half cosine between.
        rate: [f64; 2],
        /// Compare amplitudes, not intensities.
        amplitude: bool,
    },
}

impl Optimizer {
    /// The projection as tuned on several scenes (docs/measurements.md).
    pub const fn projection() -> Self {
        Self::Projection { gain: [2.5, 0.3], momentum: 0.5, overlap_power: 0.5 }
    }

    /// What an engine's buffers are for.
    pub(super) fn purpose(&self) -> Purpose {
        if matches!(self, Self::Adam { .. }) { Purpose::Adam } else { Purpose::Project }
    }

    /// The projection with more momentum and a smaller last gain: better by 0.1 dB where steps are a hundred or more and
    /// the window is twice the pupil (docs/measurements.md).
    pub fn momentum() -> Self {
        Self::Projection { gain: [2.5, 0.15], momentum: 0.7, overlap_power: 0.5 }
    }

    /// Adam at twice the paper's rate (better here by 0.3 dB), decaying to a twentieth.
    pub const fn adam() -> Self {
        Self::Adam { rate: [0.2, 0.01], amplitude: false }
    }
}

/// A half cosine from `from` to `to` as `progress` goes from 0 to 1.
pub fn cosine([from, to]: [f64; 2], progress: f64) -> f64 {
    to + (from - to) * 0.5 * (1.0 + (std::f64::consts::PI * progress.clamp(0.0, 1.0)).cos())
}
