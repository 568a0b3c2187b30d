//! What can be chosen about a solve.

use super::sampling::{Diameters, Sequence};
use super::{Method, SolveError};
use crate::optics::WindowFactor;
use crate::plan::{Purpose, Storage};
use serde::{Deserialize, Serialize};

/// How phases are moved.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase", tag = "kind")]
pub enum Optimizer {
    /// Pupil-wise projection (OPTICS 6b).
    Projection {
        /// Gain of the first and of the last step; a half cosine between.
        gain: [f64; 2],
        /// Share of the velocity that is kept.
        momentum: f64,
        /// The change is divided by the overlap to this power.
        overlap_power: f64,
    },
    /// Adam on the closed-form gradient, the paper's (OPTICS 4).
    Adam {
        /// Learning rate of the first and of the last step, radians; a half cosine between.
        rate: [f64; 2],
        /// Compare amplitudes, not intensities.
        amplitude: bool,
    },
}

impl Optimizer {
    /// The projection as tuned on several scenes (docs/measurements.md).
    pub fn projection() -> Self {
        Self::Projection { gain: [2.5, 0.3], momentum: 0.5, overlap_power: 0.5 }
    }

    /// What an engine's buffers are for.
    pub(super) fn purpose(&self) -> Purpose {
        if matches!(self, Self::Adam { .. }) { Purpose::Adam } else { Purpose::Project }
    }

    /// Adam at twice the paper's rate (better here by 0.3 dB), decaying to a twentieth.
    pub fn adam() -> Self {
        Self::Adam { rate: [0.2, 0.01], amplitude: false }
    }
}

/// Everything that decides a solve, besides the scene and the display.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Settings {
    /// Sub-frames, optimised jointly on their mean intensity.
    pub frames: usize,
    /// What is looked through, and from which first phases.
    pub method: Method,
    /// How phases are moved.
    pub optimizer: Optimizer,
    /// Steps, at most.
    pub steps: usize,
    /// Pupils per step.
    pub pupils: usize,
    /// Seconds, at most; the schedule follows whichever of steps and seconds runs out first.
    pub seconds: Option<f64>,
    /// Stop once the held-out pupils' mean PSNR reaches this, dB.
    pub psnr: Option<f64>,
    /// Part of the light that the pupils are to see: mean of the target over the exposure. None: chosen from the scene.
    pub efficiency: Option<f64>,
    /// Window per pupil.
    pub window: WindowFactor,
    /// Diameters drawn, metres.
    pub diameter: [f64; 2],
    /// Focus depths drawn, metres.
    pub depth: [f64; 2],
    /// Distribution of diameters.
    pub diameters: Diameters,
    /// Sequence of pupils.
    pub sequence: Sequence,
    /// Decides the first phases and the pupils.
    pub seed: u64,
    /// Diameter of the STFT's circular Fourier filter, over the eyebox's side ([`Method::Stft`]; Choi et al. 2022).
    pub stft_filter: f64,
    /// Pixels of the STFT's window along each axis; None: the number of views.
    pub stft_samples: Option<usize>,
    /// Weight of the light's evenness over the eyebox ([`Method::PupilAware`]); the share of the way to an even eyebox
    /// that a step of the projection asks for, or the factor of the term in Adam's loss.
    pub evenness: f64,
    /// Patches of the eyebox along each axis, 1 to 16, whose light is evened out.
    pub patches: usize,
    /// Phases that the SLM can show, radians, 1 to 256 of them: what is optimised for, straight-through. None: any phase.
    pub levels: Option<Vec<f64>>,
    /// Bytes that the windows of pupils in flight may take, as float32; stored as halves the same ones take half of it.
    pub window_bytes: usize,
    /// How complex fields are stored while solving: halves take half the memory, at a price (docs/measurements.md).
    pub storage: Storage,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            frames: 8,
            method: Method::Slfh,
            optimizer: Optimizer::projection(),
            steps: 60,
            pupils: 16,
            seconds: None,
            psnr: None,
            efficiency: None,
            window: WindowFactor::One,
            diameter: [2e-3, 20e-3],
            depth: [-3e-3, 3e-3],
            diameters: Diameters::LogUniform,
            sequence: Sequence::Sobol,
            seed: 0,
            stft_filter: 0.95,
            stft_samples: None,
            evenness: 0.5,
            patches: 9,
            levels: None,
            window_bytes: 256 << 20,
            storage: Storage::F32,
        }
    }
}

impl Settings {
    /// Refuses settings that cannot be.
    ///
    /// # Errors
    /// [`SolveError::Setting`].
    pub fn check(&self) -> Result<(), SolveError> {
        let wrong = |what, value: String, right| Err(SolveError::Setting { what, value, right });
        if !(1..=4096).contains(&self.frames) {
            return wrong("the number of sub-frames", self.frames.to_string(), "1 to 4096");
        }
        if !(1..=65536).contains(&self.pupils) {
            return wrong("the number of pupils a step", self.pupils.to_string(), "1 to 65536");
        }
        let [low, high] = self.diameter;
        if !(low > 0.0 && low <= high && high.is_finite()) {
            return wrong(
                "the range of pupil diameters (mm)",
                format!("{}..{}", low * 1e3, high * 1e3),
                "positive, smallest first",
            );
        }
        let [near, far] = self.depth;
        if !(near <= far && near.is_finite() && far.is_finite()) {
            return wrong(
                "the range of depths (mm)",
                format!("{}..{}", near * 1e3, far * 1e3),
                "finite, smallest first",
            );
        }
        if !(self.stft_filter > 0.0 && self.stft_filter <= 2.0) {
            let right = "above 0, at most 2: times the eyebox";
            return wrong("the diameter of the STFT's filter", self.stft_filter.to_string(), right);
        }
        if let Some(samples) = self.stft_samples.filter(|n| !(1..=256).contains(n)) {
            return wrong("the window of the STFT (samples)", samples.to_string(), "1 to 256");
        }
        if !(self.evenness >= 0.0 && self.evenness <= 1e6) {
            return wrong("the weight of the eyebox's evenness", self.evenness.to_string(), "0 to 1e6");
        }
        if !(1..=eyebox_kernels::energy::MOST as usize).contains(&self.patches) {
            return wrong("the number of patches along the eyebox", self.patches.to_string(), "1 to 16");
        }
        if let Some(levels) = &self.levels {
            if !(1..=eyebox_kernels::quantise::MOST).contains(&levels.len()) {
                return wrong("the number of phase levels", levels.len().to_string(), "1 to 256");
            }
            if let Some(level) = levels.iter().find(|l| !(l.is_finite() && l.abs() < 1e6)) {
                return wrong("a phase level (rad)", level.to_string(), "a finite number of ordinary size");
            }
        }
        match self.efficiency {
            Some(e) if !(e > 0.0 && e <= 1.0) => wrong("the efficiency", e.to_string(), "above 0, at most 1"),
            _ => Ok(()),
        }
    }
}

/// `n` levels evenly spaced over a turn, the first at 0: what a linear SLM of `n` grey levels shows.
pub fn even_levels(n: usize) -> Vec<f64> {
    (0..n).map(|i| i as f64 * std::f64::consts::TAU / n as f64).collect()
}

/// Levels as the kernel `quantise` takes them: wrapped, ascending, filled up.
pub(crate) fn level_table(levels: &[f64]) -> Vec<f32> {
    let mut table: Vec<f32> = levels.iter().map(|l| eyebox_kernels::trig::wrap(*l as f32)).collect();
    table.sort_by(f32::total_cmp);
    table.resize(eyebox_kernels::quantise::MOST, f32::MAX);
    table
}

/// A half cosine from `from` to `to` as `progress` goes from 0 to 1.
pub fn cosine([from, to]: [f64; 2], progress: f64) -> f64 {
    to + (from - to) * 0.5 * (1.0 + (std::f64::consts::PI * progress.clamp(0.0, 1.0)).cos())
}
