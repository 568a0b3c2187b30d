//! What goes into a solve beside its settings, what it says while it runs, and what comes of it.

use super::validation::ValidationScore;
use crate::plan::Kernel;

/// Why a solve ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stop {
    /// All steps were taken.
    Steps,
    /// Time was up.
    Seconds,
    /// The quality asked for was reached.
    Quality,
    /// The observer said so.
    Asked,
    /// A loss was not a finite number: the step was not taken, and the state before it is what is left.
    NotFinite {
        /// Which step, from 1.
        step: usize,
        /// The first kernel that gave such a number; None where the phases themselves were not finite.
        kernel: Option<Kernel>,
    },
}

/// What the observer is shown after each step.
#[derive(Debug, Clone, Copy)]
#[non_exhaustive]
pub struct Progress<'a> {
    /// Steps of the short solves that choose the exposure, taken and in all, while they run; the numbers below are of the
    /// solve that follows them, but for the loss.
    pub pilot: Option<[usize; 2]>,
    /// Share of the table of first phases that is fitted, while it is: once for a display, before the first step.
    pub fitting: Option<f64>,
    /// Steps taken.
    pub step: usize,
    /// Steps asked for.
    pub steps: usize,
    /// Since the start.
    pub seconds: f64,
    /// Mean squared difference over this step's pupils and pixels.
    pub loss: f64,
    /// The best score on validation pupils so far, if there was one.
    pub validation: Option<&'a ValidationScore>,
}

/// The observer's answer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Flow {
    /// Go on.
    Continue,
    /// Stop, and keep the best so far.
    Stop,
}

/// A solved colour.
#[derive(Debug, Clone)]
pub struct Solution {
    /// (frames, height, width), radians in -pi .. pi.
    pub phases: Vec<f32>,
    /// The exposure that it was solved for.
    pub exposure: f64,
    /// Mean of the scene over the exposure.
    pub efficiency: f64,
    /// Of the phases, on validation pupils.
    pub validation: ValidationScore,
    /// Steps taken.
    pub steps: usize,
    /// Seconds taken.
    pub seconds: f64,
    /// Seconds of a step, the median; 0 without steps.
    pub step_seconds: f64,
    /// Why it ended.
    pub stop: Stop,
}

/// Phases to begin with, instead of random ones: those of a scene that is nearly the same.
#[derive(Debug, Clone, Copy)]
pub struct Warm<'a> {
    /// (frames, height, width), radians.
    pub phases: &'a [f32],
    /// How far along its schedule the solve begins, 0 to 1: what is nearly right wants smaller steps.
    pub progress: f64,
}
