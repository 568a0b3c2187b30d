//! Solves all colors at once in sub-frames that every laser lights, each with its own power (OPTICS 13).
//!
//! The method is simultaneous color (Markley et al. 2023, Kavakli et al. 2023). A step runs the list of each color's
//! own step, at the phases that the shared drive values give this color, up to the change of its field. The host adds
//! up the changes that the colors request of the drive values, so any engine is suitable. Powers are weights of
//! sub-frames in the same lists. They are fitted to target images every few steps.

mod check;
mod drives;
mod powers;
mod refine;
#[cfg(test)]
mod refine_tests;
mod run;
mod shared;
#[cfg(test)]
mod tests;

use super::error::{SolveError, require};
use super::outcome::{Flow, Progress, Warm};
use super::problem::Problem;
use super::run::{Ready, Run};
use super::settings::{Joint, Settings};
use super::start_table;
use super::start_table::shared::BeginJoint;
use crate::engine::Engine;
use crate::optics::Laser;
pub use refine::for_joint_colors;
pub use refine::{JointPart, JointRefiner};
pub use run::JointSolution;
use run::{JointRun, Lit};
pub use shared::SharedDrives;
use std::sync::Arc;
use std::time::Instant;

/// The input of [`solve_joint`] besides its settings.
#[derive(Debug, Clone, Copy)]
pub struct JointProblem<'a> {
    /// The colors, all on one SLM and one grid.
    pub colors: &'a [Problem],
    /// Turns of each color's light per turn of the drive value ([`Display::slopes`](crate::optics::Display::slopes)).
    pub slopes: &'a [f64],
    /// Exposures of the colors, or `None` to derive each one from its scene.
    pub exposures: Option<&'a [f64]>,
    /// First powers (color, sub-frame), or `None` for equal ones.
    pub powers: Option<&'a [Vec<f64>]>,
}

impl JointProblem<'_> {
    fn check(&self, joint: &Joint, settings: &Settings) -> Result<(), SolveError> {
        let (count, brightness) = (self.colors.len(), joint.brightness);
        let fits = count == 0 || brightness <= count as f64;
        require(fits, "the brightness of joint colors", brightness, "1 to the number of colors")?;
        check::colors(&self.colors.iter().collect::<Vec<_>>(), self.slopes)?;
        if let Some(powers) = self.powers {
            check::powers(powers.iter().map(Vec::as_slice), count, settings.frames)?;
        }
        let fit = |e: &[f64]| e.len() == count && e.iter().all(|e| *e > 0.0 && e.is_finite());
        let exposures = format_args!("{:?}", self.exposures);
        require(self.exposures.is_none_or(fit), "the exposures of the colors", exposures, "positive, one per color")
    }
}

/// Solves all colors at once with the settings in `settings.joint`, and calls `observe` after every step.
///
/// The same seed gives the same phases and powers on one engine, bit for bit.
///
/// # Errors
/// [`SolveError`]. If the engine fails, the best state is lost with this call.
pub fn solve_joint(
    problem: &JointProblem<'_>,
    settings: &Settings,
    from: Option<Warm<'_>>,
    engine: &mut dyn Engine,
    observe: &mut dyn FnMut(&Progress) -> Flow,
) -> Result<JointSolution, SolveError> {
    solve_joint_begun_by(problem, settings, from, &mut start_table::shared::beginning, engine, observe)
}

/// Solves as [`solve_joint`] does. `begin` provides the first drive values if none are given.
pub(super) fn solve_joint_begun_by(
    problem: &JointProblem<'_>,
    settings: &Settings,
    from: Option<Warm<'_>>,
    begin: &mut BeginJoint<'_>,
    engine: &mut dyn Engine,
    observe: &mut dyn FnMut(&Progress) -> Flow,
) -> Result<JointSolution, SolveError> {
    let joint = settings.joint.unwrap_or_default();
    let settings = &Settings { joint: Some(joint), ..settings.clone() }.for_joint_colors();
    settings.check()?;
    let settings = &Settings { joint: None, ..settings.clone() };
    problem.check(&joint, settings)?;
    for color in problem.colors {
        color.check_eye(settings)?;
    }
    if let Some(Warm { phases, .. }) = from {
        let optics = problem.colors[0].optics;
        let fits = phases.len() == settings.frames * optics.height * optics.width;
        require(fits, "the number of phases to begin with", phases.len(), "as many as the hologram has")?;
    }
    let start = Instant::now();
    let mut lit = Vec::with_capacity(problem.colors.len());
    for (color, of_color) in problem.colors.iter().enumerate() {
        lit.push(prepare(problem, color, of_color, settings, start, engine, observe)?);
    }
    let begun = match from {
        Some(_) => None,
        None => first_drives(problem, &mut lit, settings, start, begin, observe)?,
    };
    let begun = begun.as_deref().map(|phases| Warm { phases, progress: start_table::shared::PROGRESS });
    let from = from.or(begun);
    let shape = lit[0].ready.planner.shape(settings.optimizer.purpose());
    engine.load(&shape, Some(Arc::clone(&problem.colors[0].pyramid)))?;
    let most = problem.colors.len() as f64 / joint.brightness;
    JointRun::new(lit, settings, most, problem.powers, from, start).solve(engine, observe)
}

/// Returns the drive values from a table as phases of one turn, if a solve begins with one.
///
/// Without a step the exposures are then higher, as for one color, unless they are given.
fn first_drives(
    joint: &JointProblem<'_>,
    lit: &mut [Lit<'_>],
    settings: &Settings,
    start: Instant,
    begin: &mut BeginJoint<'_>,
    observe: &mut dyn FnMut(&Progress) -> Flow,
) -> Result<Option<Vec<f32>>, SolveError> {
    let alike = || vec![1.0; settings.frames];
    let powers = |color: usize| joint.powers.map_or_else(alike, |powers| powers[color].clone());
    let lasers = joint.slopes.iter().enumerate().map(|(color, slope)| Laser { slope: *slope, powers: powers(color) });
    let lasers: Vec<Laser> = lasers.collect();
    let brighter = if settings.steps == 0 && joint.exposures.is_none() { start_table::UNSTEPPED } else { 1.0 };
    let exposures: Vec<f64> = lit.iter().map(|lit| brighter * lit.exposure * lit.ready.unit).collect();
    let begun = begin((joint.colors, &lasers, &exposures), settings, start, observe)?;
    if begun.is_some() {
        lit.iter_mut().for_each(|lit| lit.exposure *= brighter);
    }
    Ok(begun)
}

/// Prepares the plans, the validation and the exposure of one color.
fn prepare<'a>(
    joint: &JointProblem<'a>,
    color: usize,
    problem: &'a Problem,
    settings: &Settings,
    start: Instant,
    engine: &mut dyn Engine,
    observe: &mut dyn FnMut(&Progress) -> Flow,
) -> Result<Lit<'a>, SolveError> {
    let mut ready = Ready::new(problem, settings, settings.optimizer.purpose(), engine)?;
    let exposure = match joint.exposures {
        Some(exposures) => exposures[color] / ready.unit,
        // The exposure is chosen as for a single color.
        None => Run::new(&ready, settings, None, engine, start).choose_exposure(observe)?,
    };
    ready.planner.powers = vec![1.0; settings.frames].into();
    Ok(Lit { ready, slope: joint.slopes[color], exposure })
}
