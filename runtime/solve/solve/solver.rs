//! Checks, loads and chooses everything that a solve needs before its first step.

use super::dpac;
use super::error::{SolveError, require};
use super::levels::Levels;
use super::outcome::{Flow, Progress, Solution, Stop, Warm};
use super::problem::Problem;
use super::run::{Ready, Run};
use super::settings::Settings;
use crate::engine::{Buffer, Engine};
use crate::plan::Purpose;
use std::time::Instant;

/// First phases that depend on the exposure, with that exposure (linear light) and the position in the schedule at
/// which the solve then begins.
pub(super) struct Beginning {
    pub phases: Vec<f32>,
    pub exposure: f64,
    pub progress: f64,
}

/// Returns the first phases of a solve for an exposure, or `None` for random phases.
pub(super) type Begin<'a> =
    dyn FnMut(f64, &mut dyn FnMut(&Progress) -> Flow) -> Result<Option<Beginning>, SolveError> + 'a;

/// Solves as [`solve_from`](super::solve_from) does. `begin` provides the first phases if none are given.
pub(super) fn solve_begun_by(
    problem: &Problem,
    settings: &Settings,
    from: Option<Warm<'_>>,
    begin: &mut Begin<'_>,
    engine: &mut dyn Engine,
    observe: &mut dyn FnMut(&Progress) -> Flow,
) -> Result<Solution, SolveError> {
    super::source::check(&problem.modes, settings)?;
    super::source::check_mask(problem.has_mask(), settings.method)?;
    let right = "all of a scene's for simultaneous color (`solve_joint`)";
    require(settings.joint.is_none(), "the number of colors", 1, right)?;
    if let Some(Warm { phases, progress }) = from {
        let wanted = settings.frames * problem.optics.height * problem.optics.width;
        let fit = phases.len() == wanted && phases.iter().all(|p| p.is_finite());
        let right = "as many as the hologram has, all of them finite";
        require(fit, "the number of phases to begin with", phases.len(), right)?;
        require((0.0..=1.0).contains(&progress), "the place in the schedule to begin at", progress, "0 to 1")?;
    }
    let right = "any or a list, such as `Levels::of(&display)`";
    require(settings.levels != Levels::Display, "the choice of phase levels", "the display's", right)?;
    let start = Instant::now();
    let shown = settings.frames;
    let settings = &settings.as_computed();
    let frames = settings.frames;
    let given = if settings.method.is_iterative() { None } else { Some(dpac::phases(problem, settings, engine)?) };
    let solution = |phases: Vec<f32>, exposure: f64, validation, steps, step_seconds, stop| Solution {
        phases: phases.repeat(shown / frames),
        exposure,
        efficiency: problem.mean / exposure,
        validation,
        steps,
        seconds: start.elapsed().as_secs_f64(),
        step_seconds,
        stop,
    };
    let purpose = if given.is_some() { Purpose::View } else { settings.optimizer.purpose() };
    let ready = Ready::new(problem, settings, purpose, engine)?;
    if let Some(phases) = given {
        engine.write(Buffer::Phases, &phases)?;
        let validation = ready.validator.score(engine, &ready.planner)?.in_units_of(ready.unit);
        let phases = if ready.planner.levels > 0 { engine.read(Buffer::Shown)? } else { phases };
        let exposure = validation.exposure;
        return Ok(solution(phases, exposure, validation, 0, 0.0, Stop::Steps));
    }
    let looked_up: Vec<f32>;
    let mut run = Run::new(&ready, settings, from, engine, start);
    run.exposure = run.choose_exposure(observe)?;
    if from.is_none()
        && let Some(Beginning { phases, exposure, progress }) = begin(run.exposure * ready.unit, observe)?
    {
        run.exposure = exposure / ready.unit;
        looked_up = phases;
        run.from = Some(Warm { phases: &looked_up, progress });
    }
    let exposure = run.exposure * ready.unit;
    let (best, steps, stop) = run.descend(settings.steps, observe)?;
    let mut durations = run.durations;
    let kept = engine.kept()?;
    durations.sort_by(f64::total_cmp);
    let step_seconds = durations.get(durations.len() / 2).copied().unwrap_or(0.0);
    Ok(solution(kept, exposure, best, steps, step_seconds, stop))
}
