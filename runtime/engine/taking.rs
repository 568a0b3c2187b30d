//! How a step is taken: begun, and ended when its losses are known.

use super::{Engine, EngineError};
use crate::plan::Step;
use std::ops::Range;
use std::time::Instant;

/// What came of a step.
#[derive(Debug, Clone, PartialEq)]
pub struct Taken {
    /// The loss (a sum over pixels) of each pupil pass. Where one is no finite number the phases stayed as they were.
    pub losses: Vec<f64>,
    /// Seconds that it took: by the device's clock, where it has one.
    pub seconds: f64,
}

/// A step that was begun: what [`Engine::end_step`] takes.
#[derive(Debug)]
pub struct Begun(pub(super) State);

/// Whether it is over.
#[derive(Debug)]
pub(super) enum State {
    Over(Taken),
    /// Under way, by the number that its engine gave it.
    #[cfg_attr(not(feature = "vulkan"), allow(dead_code))]
    UnderWay(u64),
}

impl Begun {
    /// Whether its losses are known already.
    pub fn is_over(&self) -> bool {
        matches!(self.0, State::Over(_))
    }
}

/// Takes a step on an engine that ends what it is told before it returns.
pub(super) fn at_once<E: Engine + ?Sized>(
    engine: &mut E,
    step: &Step,
    parts: &[Range<usize>],
) -> Result<Begun, EngineError> {
    let (start, update) = (Instant::now(), step.before_update());
    let mut losses = vec![0.0; step.pupil_passes.len()];
    for part in parts {
        let before = part.start..part.end.min(update).max(part.start);
        for (sum, loss) in losses.iter_mut().zip(engine.run_part(step, before.clone())?) {
            *sum += loss;
        }
        if part.end > update {
            if !losses.iter().all(|loss| loss.is_finite()) {
                break;
            }
            engine.run_part(step, before.end..part.end)?;
        }
    }
    Ok(Begun(State::Over(Taken { losses, seconds: start.elapsed().as_secs_f64() })))
}
