//! The loop.

use super::method::Viewpoints;
use super::run::Run;
use super::settings::level_table;
use super::{Judge, Method, Optimizer, Problem, Settings, Verdict, dpac};
use crate::engine::{Buffer, Engine, EngineError};
use crate::optics::OpticsError;
use crate::plan::{Kernel, Purpose};
use std::sync::Arc;
use std::time::Instant;

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
pub struct Progress<'a> {
    /// Steps taken.
    pub step: usize,
    /// Steps asked for.
    pub steps: usize,
    /// Since the start.
    pub seconds: f64,
    /// Mean squared difference over this step's pupils and pixels.
    pub loss: f64,
    /// The last verdict over held-out pupils, if there was one.
    pub verdict: Option<&'a Verdict>,
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
    /// Of the phases, over held-out pupils.
    pub verdict: Verdict,
    /// Steps taken.
    pub steps: usize,
    /// Seconds taken.
    pub seconds: f64,
    /// Seconds of a step, the median; 0 without steps.
    pub step_seconds: f64,
    /// Why it ended.
    pub stop: Stop,
}

/// Why a solve failed.
#[derive(Debug, thiserror::Error)]
pub enum SolveError {
    /// A setting that cannot be.
    #[error("{what} is {value}: it must be {right}")]
    Setting {
        /// Which, with its unit.
        what: &'static str,
        /// Its value.
        value: String,
        /// What would be right.
        right: &'static str,
    },
    /// A colour or a size that the display does not have.
    #[error(transparent)]
    Optics(#[from] OpticsError),
    /// From the engine.
    #[error(transparent)]
    Engine(#[from] EngineError),
}

/// Solves one colour. `observe` is called after every step.
///
/// The same seed gives the same phases, bit for bit, on one engine.
///
/// # Errors
/// [`SolveError`]; a failing engine loses nothing that was judged before only if the caller kept it: the best state
/// lives in this call.
pub fn solve(
    problem: &Problem,
    settings: &Settings,
    engine: &mut dyn Engine,
    observe: &mut dyn FnMut(&Progress) -> Flow,
) -> Result<Solution, SolveError> {
    solve_from(problem, settings, None, engine, observe)
}

/// Phases to begin with, instead of random ones: those of a scene that is nearly the same.
#[derive(Debug, Clone, Copy)]
pub struct Warm<'a> {
    /// (frames, height, width), radians.
    pub phases: &'a [f32],
    /// How far along its schedule the solve begins, 0 to 1: what is nearly right wants smaller steps.
    pub progress: f64,
}

/// [`solve`] from phases that are given. Methods in closed form have no use for them.
///
/// # Errors
/// Those of [`solve`]; [`SolveError::Setting`] for another number of phases.
pub fn solve_from(
    problem: &Problem,
    settings: &Settings,
    from: Option<Warm<'_>>,
    engine: &mut dyn Engine,
    observe: &mut dyn FnMut(&Progress) -> Flow,
) -> Result<Solution, SolveError> {
    settings.check()?;
    if let Some(from) = from {
        let wanted = settings.frames * problem.optics.height * problem.optics.width;
        if from.phases.len() != wanted || !from.phases.iter().all(|p| p.is_finite()) {
            let (what, right) = ("the number of phases to begin with", "that of the hologram, all of them finite");
            return Err(SolveError::Setting { what, value: from.phases.len().to_string(), right });
        }
        if !(0.0..=1.0).contains(&from.progress) {
            let (what, right) = ("the place in the schedule to begin at", "0 to 1");
            return Err(SolveError::Setting { what, value: from.progress.to_string(), right });
        }
    }
    let start = Instant::now();
    let frames = settings.frames;
    let mut computed =
        Settings { frames: if settings.method.repeats_frames() { 1 } else { settings.frames }, ..settings.clone() };
    if settings.method == Method::Smooth && matches!(settings.optimizer, Optimizer::Projection { .. }) {
        computed.optimizer = Optimizer::adam();
    }
    let given = if settings.method.is_iterative() { None } else { Some(dpac::phases(problem, settings, engine)?) };
    let mut planner = problem.planner(computed.frames, settings.window);
    planner.levels = settings.levels.as_ref().map_or(0, Vec::len);
    planner.storage = settings.storage;
    // A scene of 1e30, or of 1e-30, is solved as if its brightest value were about 1.
    let unit = problem.unit();
    if let Some(views) = &mut planner.views {
        views.unit /= unit;
    }
    let purpose = if given.is_some() { Purpose::View } else { computed.optimizer.purpose() };
    engine.load(&planner.shape(purpose), Some(Arc::clone(&problem.pyramid)))?;
    if let Some(levels) = &settings.levels {
        engine.write(Buffer::Levels, &level_table(levels))?;
    }
    // Held out: what the method looks through (pupils by the paper's distribution), from another seed.
    let uniform = Settings { diameters: super::Diameters::Uniform, ..computed.clone() };
    let mut held_out = Viewpoints::new(problem, &uniform, !settings.seed);
    let judge = Judge::new(engine, &planner, (0..8).map(|_| held_out.draw()).collect())?;
    if let Some(phases) = given {
        engine.write(Buffer::Phases, &phases)?;
        let verdict = judge.judge(engine, &planner)?.in_units_of(unit);
        let phases = if planner.levels > 0 { engine.read(Buffer::Shown)? } else { phases };
        let (exposure, seconds) = (verdict.exposure, start.elapsed().as_secs_f64());
        let efficiency = problem.mean / exposure;
        return Ok(Solution {
            phases,
            exposure,
            efficiency,
            verdict,
            steps: 0,
            seconds,
            step_seconds: 0.0,
            stop: Stop::Steps,
        });
    }
    let settings = &computed;
    let mut run = Run {
        problem,
        planner: &planner,
        settings,
        engine,
        judge: &judge,
        from,
        start,
        exposure: 0.0,
        unit,
        pilot: false,
        durations: Vec::new(),
    };
    run.exposure = match settings.efficiency {
        // A black scene has no efficiency: any exposure shows it.
        Some(efficiency) if problem.mean > 0.0 => problem.mean / efficiency / unit,
        _ => run.choose_exposure(judge.bright_end(), observe)?,
    };
    let exposure = run.exposure * unit;
    let (best, steps, stop) = run.descend(settings.steps, observe)?;
    let (verdict, phases, _) = best;
    let mut durations = run.durations;
    durations.sort_by(f64::total_cmp);
    let step_seconds = durations.get(durations.len() / 2).copied().unwrap_or(0.0);
    let phases = phases.repeat(frames / settings.frames);
    let (efficiency, seconds) = (problem.mean / exposure, start.elapsed().as_secs_f64());
    Ok(Solution { phases, exposure, efficiency, verdict, steps, seconds, step_seconds, stop })
}
