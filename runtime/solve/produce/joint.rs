//! All colours of a hologram at once.

use super::colors::check_memory;
use super::{ProduceError, SceneEvent};
use crate::engine::Engine;
use crate::optics::{Color, JointColor, Laser, reference_of};
use crate::quality::Subject;
use crate::solve::{Flow, JointProblem, JointSolution, Progress, Settings, Solution, solve_joint};

/// Colours that were solved together, each with the phases that it has of the shared drives, and how they are shown.
pub type JointColors = (Vec<(Color, Solution)>, JointColor);

/// Solves all colours at once (OPTICS 13), as `settings.joint` says, with every pixel, view and sub-frame of the subject; with these
/// exposures, or with those that each colour's scene asks for.
///
/// # Errors
/// [`ProduceError`].
pub fn solve_joint_colors(
    subject: &Subject,
    colors: &[Color],
    settings: &Settings,
    exposures: Option<&[f64]>,
    engine: &mut dyn Engine,
    observe: &mut dyn FnMut(&SceneEvent) -> Flow,
) -> Result<JointColors, ProduceError> {
    let settings = &settings.for_joint_colors();
    let mut problems = Vec::with_capacity(colors.len());
    for &color in colors {
        let subject = Subject { color, ..subject.clone() };
        check_memory(&subject, settings, engine.memory())?;
        problems.push(subject.prepare(settings)?.problem);
    }
    let slopes = subject.display.slopes(colors);
    let problem = JointProblem { colors: &problems, slopes: &slopes, exposures, powers: None };
    let reference = reference_of(slopes.iter().copied()).unwrap_or(0);
    let mut stepped =
        |progress: &Progress| observe(&SceneEvent::Step { hologram: 0, color: colors[reference], progress });
    let JointSolution { colors: solutions, powers } = solve_joint(&problem, settings, None, engine, &mut stepped)?;
    let lasers = colors.iter().zip(&slopes).zip(powers);
    let lasers = lasers.map(|((color, slope), powers)| (*color, Laser { slope: *slope, powers })).collect();
    let solutions: Vec<_> = colors.iter().copied().zip(solutions).collect();
    for (color, solution) in &solutions {
        observe(&SceneEvent::Solved { hologram: 0, color: *color, solution });
    }
    Ok((solutions, JointColor { lasers }))
}
