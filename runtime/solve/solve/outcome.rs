//! The inputs of a solve besides its settings, its progress, and its results.

use super::validation::ValidationScore;
use crate::plan::Kernel;

/// The reason why a solve ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stop {
    /// All steps were taken.
    Steps,
    /// The time was up.
    Seconds,
    /// The required quality was reached.
    Quality,
    /// The observer stopped it.
    Asked,
    /// A loss was not a finite number. That step was not taken, and the state before it remains.
    NotFinite {
        /// The number of the step, from 1.
        step: usize,
        /// The first kernel that computed such a number. `None` if the phases themselves were not finite.
        kernel: Option<Kernel>,
    },
}

/// The state of a solve that the observer receives after each step.
#[derive(Debug, Clone, Copy)]
#[non_exhaustive]
pub struct Progress<'a> {
    /// Taken and total steps of the pilot solves that choose the exposure, while they run. The other values then belong
    /// to the solve that follows, except for the loss.
    pub pilot: Option<[usize; 2]>,
    /// Fitted share of the table of first phases, while it is fitted. This occurs once per display, before the first
    /// step.
    pub fitting: Option<f64>,
    /// Number of steps taken.
    pub step: usize,
    /// Number of requested steps.
    pub steps: usize,
    /// Seconds since the start.
    pub seconds: f64,
    /// Mean squared difference over the pupils and pixels of this step.
    pub loss: f64,
    /// The best score on validation pupils, if there is one.
    pub validation: Option<&'a ValidationScore>,
}

/// The answer of the observer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Flow {
    /// The solve continues with the next step.
    Continue,
    /// The solve stops and keeps the best state.
    Stop,
}

/// The solution of one color.
#[derive(Debug, Clone)]
pub struct Solution {
    /// Phases (frames, height, width), radians in -pi .. pi.
    pub phases: Vec<f32>,
    /// The exposure for which it was solved.
    pub exposure: f64,
    /// Mean of the scene over the exposure.
    pub efficiency: f64,
    /// Score of the phases on validation pupils.
    pub validation: ValidationScore,
    /// Number of steps taken.
    pub steps: usize,
    /// Duration of the solve in seconds.
    pub seconds: f64,
    /// Median duration of a step in seconds, or 0 without steps.
    pub step_seconds: f64,
    /// The reason why it ended.
    pub stop: Stop,
}

/// First phases from a similar scene, instead of random ones.
#[derive(Debug, Clone, Copy)]
pub struct Warm<'a> {
    /// Phases (frames, height, width), radians.
    pub phases: &'a [f32],
    /// Position in the schedule at which the solve begins, 0 to 1. Nearly correct phases need smaller steps.
    pub progress: f64,
}
