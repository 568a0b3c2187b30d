//! Every colour of a hologram.

use super::{ProduceError, SceneEvent};
use crate::engine::{Engine, Memory};
use crate::memory;
use crate::optics::Color;
use crate::quality::{Reference, Subject};
use crate::scene::SceneError;
use crate::solve::{Flow, Progress, Settings, Solution};

/// Refuses a colour that takes more than there is, by the count of a plan.
pub(super) fn check_memory(subject: &Subject, settings: &Settings, memory: Memory) -> Result<(), ProduceError> {
    let bytes = subject.cost(settings, memory)?.bytes();
    let what = || format!("{} sub-frames of {} x {}", settings.frames, subject.display.height, subject.display.width);
    let remedy = "take fewer `frames`, `views` or `pupils`, or a smaller `size`";
    Ok(memory::check_available(what, bytes, remedy).map_err(SceneError::from)?)
}

/// Solves every colour in turn with settings of this quality. Once `observe` answers [`Flow::Stop`] the colours that are left
/// get one step each, so that the hologram is whole.
///
/// Where the settings [reduce](Settings::reduces) the problem, each solution is scored against all of it.
///
/// # Errors
/// [`ProduceError`].
pub fn solve_colors(
    subject: &Subject,
    colors: &[Color],
    settings: &Settings,
    engine: &mut dyn Engine,
    observe: &mut dyn FnMut(&SceneEvent) -> Flow,
) -> Result<Vec<(Color, Solution)>, ProduceError> {
    let mut solved = Vec::with_capacity(colors.len());
    for &color in colors {
        let subject = Subject { color, ..subject.clone() };
        check_memory(&subject, settings, engine.memory())?;
        let mut stepped = |progress: &Progress| observe(&SceneEvent::Step { hologram: 0, color, progress });
        let mut solution = subject.solve(settings, engine, &mut stepped)?.solution;
        if settings.reduces() {
            // Its own validation is about less than the problem.
            let reference = Reference::new(&subject, subject.base.seed, engine)?;
            solution.validation = reference.score(&solution.phases, engine)?;
            if settings.pixel > 1 {
                solution.exposure = solution.validation.exposure;
            }
        }
        observe(&SceneEvent::Solved { hologram: 0, color, solution: &solution });
        solved.push((color, solution));
    }
    Ok(solved)
}
