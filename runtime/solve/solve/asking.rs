//! What a step asks of phases, without moving them: for phases that are one colour's share of drives which several colours move.

use crate::engine::{Buffer, Engine, EngineError, Step};
use crate::plan::Kernel;
use eyebox_kernels::{adam, project};
use std::ops::Range;

/// How a step moves what it is taken for: what it says of that, without its lists.
#[derive(Debug, Clone, Copy)]
pub(super) struct Turns {
    /// Gain and momentum of the projection, and where the SLM lies in the grid.
    pub(super) project: project::Args,
    pub(super) adam: adam::Args,
    /// Whether it is the projection that moves it.
    pub(super) projects: bool,
}

impl Turns {
    /// Those of this step.
    pub(super) fn of(step: &Step) -> Self {
        let projects = step.list.last().is_some_and(|d| d.kernel == Kernel::Project);
        Self { project: step.project, adam: step.adam, projects }
    }
}

/// Runs these parts of a step's list, in order, up to what would move its phases, and reads the change of the field that it asks for:
/// its loss, and the change unless that is no finite number.
///
/// # Errors
/// Those of the engine.
pub(super) fn ask(
    engine: &mut dyn Engine,
    step: &Step,
    parts: &[Range<usize>],
    change: &mut [f32],
) -> Result<f64, EngineError> {
    let end = step.list.len().saturating_sub(1);
    let known = step.before_update().min(end);
    let mut losses = vec![0.0; step.pupil_passes.len()];
    for part in within(parts, 0..known) {
        let of_part = engine.run_part(step, part)?;
        losses.iter_mut().zip(&of_part).for_each(|(sum, loss)| *sum += loss);
        engine.recycle(of_part);
    }
    let loss = step.mean_loss(&losses);
    if loss.is_finite() {
        for part in within(parts, known..end) {
            let none = engine.run_part(step, part)?;
            engine.recycle(none);
        }
        engine.read_into(Buffer::Change, change)?;
    }
    Ok(loss)
}

/// What of these parts is in a range.
fn within(parts: &[Range<usize>], range: Range<usize>) -> impl Iterator<Item = Range<usize>> {
    let cut = move |part: &Range<usize>| part.start.max(range.start)..part.end.min(range.end);
    parts.iter().map(cut).filter(|part| !part.is_empty())
}
