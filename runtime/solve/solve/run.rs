//! Runs a solve, with its exposure, its steps, its validation, and its response to a loss that is not finite.

use super::error::SolveError;
use super::exposure::{BrightEnd, peak};
use super::method::Method;
use super::optimizer::Optimizer;
use super::outcome::{Flow, Progress, Stop, Warm};
use super::problem::Problem;
use super::sampling::{Diameters, random_phases};
use super::settings::Settings;
use super::step::{Steps, first_fault};
use super::validation::{ValidationScore, Validator};
use super::viewpoints::Viewpoints;
use crate::engine::{Buffer, Engine, EngineError, PendingStep, Step};
use crate::optics::WindowFactor;
use crate::plan::{ModelTables, Planner, Purpose};
use std::collections::VecDeque;
use std::slice;
use std::sync::Arc;
use std::time::Instant;

/// Number of validation pupils of a solve, or of windows of another kind.
pub(super) const PUPILS: usize = 8;

/// One color before its exposure is chosen, with its planner and its validator.
pub(super) struct Ready<'a> {
    pub problem: &'a Problem,
    pub planner: Planner,
    pub validator: Validator,
    /// Linear light of a target value of 1.
    pub unit: f64,
}

impl<'a> Ready<'a> {
    /// Loads an engine with the data of the problem for this purpose.
    pub fn new(
        problem: &'a Problem,
        settings: &Settings,
        purpose: Purpose,
        engine: &mut dyn Engine,
    ) -> Result<Self, SolveError> {
        let mut planner = problem.planner_of(settings);
        // A scene of 1e30, or of 1e-30, is solved as if its brightest value were about 1.
        let unit = problem.unit();
        planner.divide_targets(unit);
        engine.load(&planner.shape(purpose), Some(Arc::clone(&problem.pyramid)))?;
        if let Some(levels) = settings.levels.table() {
            engine.write(Buffer::Levels, &levels)?;
        }
        // These viewpoints of the method (pupils by the paper's distribution) come from another seed, so that no step
        // uses them.
        let uniform = Settings { diameters: Diameters::Uniform, ..settings.clone() };
        let mut viewpoints = Viewpoints::new(problem, &uniform, !settings.seed);
        let validator = Validator::new(engine, &planner, (0..PUPILS).map(|_| viewpoints.draw()).collect())?;
        Ok(Self { problem, planner, validator, unit })
    }
}

/// The state of a descent from the first phases to the best ones.
struct Descent<'o> {
    /// The largest number of steps, and the steps between two validations.
    steps: usize,
    every: usize,
    /// The PSNR at which it stops, in dB.
    wanted: Option<f64>,
    /// Number of steps that have ended.
    step: usize,
    /// The score of the phases that the engine keeps.
    best: Option<ValidationScore>,
    /// The step after which phases were last validated.
    judged: usize,
    /// True if the last validation found no better phases, so that steps must be shorter.
    shorter: bool,
    /// Steps that were begun and have not ended.
    under_way: VecDeque<(Step, PendingStep)>,
    observe: &'o mut dyn FnMut(&Progress) -> Flow,
}

impl Descent<'_> {
    fn is_verdict(&self, step: usize) -> bool {
        step.is_multiple_of(self.every) || step == self.steps
    }

    /// Returns the step that must end now. If `all` is false, one step may stay under way.
    fn next(&mut self, all: bool) -> Option<(Step, PendingStep)> {
        let last_is_over = self.under_way.back().is_some_and(|(_, begun)| begun.is_over());
        if all || last_is_over || self.under_way.len() > 1 { self.under_way.pop_front() } else { None }
    }
}

/// A solve that is under way.
pub(super) struct Run<'a> {
    ready: &'a Ready<'a>,
    settings: &'a Settings,
    engine: &'a mut dyn Engine,
    /// Phases at which it begins, if they are not random.
    pub(super) from: Option<Warm<'a>>,
    start: Instant,
    pub(super) exposure: f64,
    /// True for a pilot, which stops early only by its observer.
    pilot: bool,
    /// Seconds of each step since the last start, without validation.
    pub(super) durations: Vec<f64>,
}

/// Number of steps of a pilot solve.
const PILOT_STEPS: usize = 24;
/// A state that is worse than the best one by more than this, in dB, is dropped. Steps then continue from the best one.
const FALL_DB: f64 = 0.1;
/// Factor on the exposure of a pilot, because a longer solve needs more light (docs/results/against-pytorch.json).
const PILOT_RISE: f64 = 1.25;
/// Factor on the exposure for Adam, which is best with less excess light than the projection
/// (docs/results/against-pytorch.json).
const ADAM_EXPOSURE: f64 = 0.85;
/// Share of the variance of the drive values below which crosstalk lowers the exposure, in proportion
/// (docs/displays.md).
const CROSSTALK_LEAVES: f64 = 0.6;

/// Returns this share of the exposure that the bright end of a scene requires, or less on a display with crosstalk.
///
/// Light that crosstalk keeps from being directed away falls everywhere, so less excess light is better.
pub(crate) fn exposure_under(model: Option<&ModelTables>, share: f64, end: &BrightEnd) -> f64 {
    let left = model.map_or(1.0, |model| model.variance_left());
    let share = (left / CROSSTALK_LEAVES).min(1.0) * share;
    if share < 1.0 { (share * end.guess()).max(end.mean) } else { end.guess() }
}

impl<'a> Run<'a> {
    /// Creates the run before its exposure is chosen.
    pub(super) fn new(
        ready: &'a Ready<'a>,
        settings: &'a Settings,
        from: Option<Warm<'a>>,
        engine: &'a mut dyn Engine,
        start: Instant,
    ) -> Self {
        Self { ready, settings, engine, from, start, exposure: 0.0, pilot: false, durations: Vec::new() }
    }

    /// Chooses the exposure from the given efficiency, or from the bright end of the scene. If the two measures of that
    /// end differ, pilot solves decide.
    pub(super) fn choose_exposure(&mut self, observe: &mut dyn FnMut(&Progress) -> Flow) -> Result<f64, SolveError> {
        let Ready { problem, ref validator, unit, .. } = *self.ready;
        // A black scene has no efficiency. Any exposure shows it.
        if let Some(efficiency) = self.settings.efficiency.filter(|_| problem.mean > 0.0) {
            return Ok(problem.mean / efficiency / unit);
        }
        let end = validator.bright_end(self.settings.steps_of_projection());
        let adam = matches!(self.settings.optimizer, Optimizer::Adam { .. });
        let Some(candidates) = end.candidates() else {
            let share = if adam { ADAM_EXPOSURE } else { 1.0 };
            return Ok(exposure_under(problem.model.as_deref(), share, &end));
        };
        self.pilot = true;
        let (start, steps, all) = (self.start, self.settings.steps, PILOT_STEPS * candidates.len());
        let at = |taken: usize, loss: f64| {
            let seconds = start.elapsed().as_secs_f64();
            Progress { pilot: Some([taken, all]), fitting: None, step: 0, steps, seconds, loss, validation: None }
        };
        // If the observer stopped at an earlier color, no pilot runs.
        if observe(&at(0, f64::NAN)) == Flow::Stop {
            self.pilot = false;
            return Ok(end.guess());
        }
        let mut tried = Vec::new();
        for exposure in candidates {
            let late = self.settings.seconds.is_some_and(|most| start.elapsed().as_secs_f64() > 0.5 * most);
            if !tried.is_empty() && late {
                break;
            }
            self.exposure = exposure;
            let before = PILOT_STEPS * tried.len();
            let mut observe = |pilot: &Progress| observe(&at(before + pilot.step, pilot.loss));
            let (best, _, stop) = self.descend(PILOT_STEPS, &mut observe)?;
            tried.push((exposure, best.mean()));
            if stop == Stop::Asked {
                break;
            }
        }
        self.pilot = false;
        let best = (0..tried.len()).max_by(|&i, &j| tried[i].1.total_cmp(&tried[j].1)).unwrap_or(0);
        let found = match tried.get(best.wrapping_sub(1)..=best + 1) {
            Some(&[a, b, c]) => peak([a, b, c]),
            _ => tried[best].0,
        };
        Ok(PILOT_RISE * found)
    }

    /// Takes at most `steps` steps from the first phases.
    pub(super) fn descend(
        &mut self,
        steps: usize,
        observe: &mut dyn FnMut(&Progress) -> Flow,
    ) -> Result<(ValidationScore, usize, Stop), SolveError> {
        let (settings, Ready { problem, planner, .. }) = (self.settings, self.ready);
        let pixels = settings.frames * planner.slm.height * planner.slm.width;
        self.engine.write(Buffer::Phases, &self.first_phases(pixels))?;
        self.engine.clear_moments()?;
        let memory = self.engine.memory();
        let mut schedule = Steps::new(problem, planner, settings, self.exposure, memory);
        Steps::new(problem, planner, settings, self.exposure, memory).prepare(steps, self.engine)?;
        let limit = settings.seconds.filter(|_| !self.pilot);
        let wanted = settings.psnr.filter(|_| !self.pilot);
        let begun = self.start.elapsed().as_secs_f64();
        let every = interval(steps, wanted.is_some());
        self.durations.clear();
        let mut descent = Descent {
            steps,
            every,
            wanted,
            step: 0,
            best: None,
            judged: 0,
            shorter: false,
            under_way: VecDeque::new(),
            observe,
        };
        let (mut begun_steps, mut mark) = (0, Instant::now());
        let stop = loop {
            let seconds = self.start.elapsed().as_secs_f64();
            let late = limit.is_some_and(|most| seconds >= most).then_some(Stop::Seconds);
            let end = (begun_steps >= steps).then_some(Stop::Steps).or(late);
            if end.is_none() {
                let progress = (begun_steps as f64 / steps as f64)
                    .max(limit.map_or(0.0, |most| (seconds - begun) / (most - begun).max(1e-9)));
                let begun_at = self.from.map_or(0.0, |from| from.progress);
                let next = schedule.next(begun_at + (1.0 - begun_at) * progress);
                let taken = self.engine.begin_step(&next, slice::from_ref(&(0..next.list.len())))?;
                begun_steps += 1;
                descent.under_way.push_back((next, taken));
            }
            // On a device one step may be under way while the next one is prepared. Validations and the end wait for
            // it.
            let waits = end.is_some() || descent.is_verdict(begun_steps);
            let mut stop = None;
            while let Some((next, taken)) = descent.next(waits || stop.is_some()) {
                stop = self.end(&mut descent, &next, taken, &mut mark, stop)?;
            }
            if std::mem::take(&mut descent.shorter) {
                schedule.shorten();
            }
            if let Some(stop) = stop.or(end) {
                break stop;
            }
        };
        if descent.best.is_none() || descent.judged != descent.step {
            self.validate(&mut descent)?;
        }
        Ok((descent.best.expect("it was just validated"), descent.step, stop))
    }

    /// Ends a step and returns the reason if the descent stops with it. A step that was under way at an earlier `stop`
    /// is taken as well.
    fn end(
        &mut self,
        descent: &mut Descent<'_>,
        next: &Step,
        taken: PendingStep,
        mark: &mut Instant,
        stop: Option<Stop>,
    ) -> Result<Option<Stop>, SolveError> {
        let loss = next.mean_loss(&self.engine.end_step(taken)?.losses);
        descent.step += 1;
        let step = descent.step;
        if !loss.is_finite() {
            // Steps that are still under way do not change phases.
            descent.under_way.clear();
            let kernel = first_fault(self.engine, next)?;
            if kernel.is_none() && descent.best.is_none() {
                let pixels = self.settings.frames * self.ready.planner.slm.height * self.ready.planner.slm.width;
                self.engine.write(Buffer::Phases, &self.first_phases(pixels))?;
            }
            return Ok(Some(Stop::NotFinite { step, kernel }));
        }
        self.durations.push(mark.elapsed().as_secs_f64());
        if descent.is_verdict(step) {
            self.validate(descent)?;
        }
        *mark = Instant::now();
        if stop.is_some() {
            return Ok(stop);
        }
        let (steps, seconds) = (descent.steps, self.start.elapsed().as_secs_f64());
        let validation = descent.best.as_ref();
        if (descent.observe)(&Progress { pilot: None, fitting: None, step, steps, seconds, loss, validation })
            == Flow::Stop
        {
            return Ok(Some(Stop::Asked));
        }
        let is_good = validation
            .zip(descent.wanted)
            .is_some_and(|(v, wanted)| v.quality().is_some_and(|[mean, _]| mean >= wanted));
        Ok(is_good.then_some(Stop::Quality))
    }

    fn first_phases(&self, pixels: usize) -> Vec<f32> {
        match (self.from, self.settings.method) {
            // Fewer phases are needed if all sub-frames are equal.
            (Some(from), _) => from.phases[..pixels].to_vec(),
            (None, Method::Smooth) => vec![0.0; pixels],
            _ => random_phases(pixels, self.settings.seed),
        }
    }

    /// Scores the engine's phases, and keeps them if they are the best.
    ///
    /// Phases that are not finite are never kept because their image has no score. If a score does not rise, steps become
    /// shorter, because a descent whose steps are too long stays at a level and need not fall. Phases that are much worse
    /// than the best are replaced by the best.
    fn validate(&mut self, descent: &mut Descent<'_>) -> Result<(), EngineError> {
        let (step, best) = (descent.step, &mut descent.best);
        descent.judged = step;
        let Ready { planner, validator, unit, .. } = self.ready;
        let whole = Planner { factor: WindowFactor::Full, ..planner.clone() };
        let score = validator.score(self.engine, &whole)?.in_units_of(*unit);
        let better = |b: &ValidationScore| score.mean() >= b.mean() || b.mean().is_nan();
        if best.as_ref().is_none_or(better) {
            // The score belongs to the phases that the SLM shows.
            let shown = if planner.levels > 0 { Buffer::Shown } else { Buffer::Phases };
            let finite = |engine: &mut dyn Engine| Ok(engine.read(shown)?.iter().all(|p| p.is_finite()));
            if best.is_none() || !score.mean().is_nan() || finite(self.engine)? {
                self.engine.keep(shown)?;
                *best = Some(score);
            }
            return Ok(());
        }
        let fell = best.as_ref().is_some_and(|b| score.mean() < b.mean() - FALL_DB);
        descent.shorter = step < descent.steps;
        // Steps do not continue from shown levels because these have lost the phases between them.
        if fell && descent.shorter && planner.levels == 0 {
            self.engine.restore()?;
        } else if descent.shorter {
            self.engine.clear_moments()?;
        }
        Ok(())
    }
}

/// Returns the steps from one validation to the next. There are ten validations if quality stops the solve, and
/// otherwise three, because one costs about two steps.
pub(super) fn interval(steps: usize, stops: bool) -> usize {
    steps.div_ceil(if stops { 10 } else { 3 }).max(3)
}
