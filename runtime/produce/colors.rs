//! Every colour of a hologram.

use super::{ProduceError, SceneEvent};
use crate::engine::Engine;
use crate::optics::Color;
use crate::quality::{Reference, Subject};
use crate::solve::{Flow, Progress, Settings, Solution};

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
