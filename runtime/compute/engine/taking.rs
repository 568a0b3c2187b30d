//! How a step is taken: begun, and ended when its losses are known.

/// What came of a step.
#[derive(Debug, Clone, PartialEq)]
pub struct StepResult {
    /// The loss (a sum over pixels) of each pupil pass. Where one is no finite number the phases stayed as they were.
    pub losses: Vec<f64>,
    /// Seconds that it took: by the device's clock, where it has one.
    pub seconds: f64,
}

/// A step that was begun: what [`Engine::end_step`](super::Engine::end_step) takes.
#[derive(Debug)]
pub struct PendingStep(pub(super) State);

/// Whether it is over.
#[derive(Debug)]
pub(super) enum State {
    Over(StepResult),
    /// Under way, by the number that its engine gave it.
    #[cfg_attr(not(feature = "vulkan"), allow(dead_code))]
    UnderWay(u64),
}

impl PendingStep {
    /// Whether its losses are known already.
    pub fn is_over(&self) -> bool {
        matches!(self.0, State::Over(_))
    }
}
