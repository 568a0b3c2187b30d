//! A solve under way: exposure, steps, verdicts, and what to do when a number is none.

use super::exposure::{BrightEnd, peak};
use super::fault;
use super::method::Viewpoints;
use super::{
    Flow, Judge, Method, Optimizer, Problem, Progress, Settings, SolveError, Stop, Verdict, Warm, cosine, random_phases,
};
use crate::engine::{Buffer, Engine, EngineError};
use crate::optics::WindowFactor;
use crate::plan::{Comparison, Planner, Step};
use eyebox_kernels::compare;
use std::time::Instant;

/// A verdict, the phases that it is about, and the step after which it was given.
pub(super) type Judged = (Verdict, Vec<f32>, usize);

/// A solve under way.
pub(super) struct Run<'a> {
    pub(super) problem: &'a Problem,
    pub(super) planner: &'a Planner,
    pub(super) settings: &'a Settings,
    pub(super) engine: &'a mut dyn Engine,
    pub(super) judge: &'a Judge,
    /// Where it begins, if not at random phases.
    pub(super) from: Option<Warm<'a>>,
    pub(super) start: Instant,
    pub(super) exposure: f64,
    /// Linear light of the targets' value 1.
    pub(super) unit: f64,
    /// Whether this is a pilot: it stops only when asked.
    pub(super) pilot: bool,
    /// Seconds of each step since the last start, without verdicts.
    pub(super) durations: Vec<f64>,
}

/// Steps of a pilot solve.
const PILOT_STEPS: usize = 24;
/// A longer solve wants more light than its pilot (docs/measurements.md).
const PILOT_RISE: f64 = 1.25;
/// Adam does best with less light to spare than the projection (docs/measurements.md).
const ADAM_EXPOSURE: f64 = 0.85;

impl Run<'_> {
    /// From the scene's bright end, by pilot solves where its two measures part.
    pub(super) fn choose_exposure(
        &mut self,
        end: BrightEnd,
        observe: &mut dyn FnMut(&Progress) -> Flow,
    ) -> Result<f64, SolveError> {
        let adam = matches!(self.settings.optimizer, Optimizer::Adam { .. });
        let Some(candidates) = end.candidates() else {
            return Ok(if adam { (ADAM_EXPOSURE * end.guess()).max(end.mean) } else { end.guess() });
        };
        self.pilot = true;
        let mut tried = Vec::new();
        for exposure in candidates {
            let seconds = self.start.elapsed().as_secs_f64();
            let progress = Progress { step: 0, steps: self.settings.steps, seconds, loss: f64::NAN, verdict: None };
            let late = self.settings.seconds.is_some_and(|most| seconds > 0.5 * most);
            if !tried.is_empty() && (late || observe(&progress) == Flow::Stop) {
                break;
            }
            self.exposure = exposure;
            let (best, ..) = self.descend(PILOT_STEPS, &mut |_| Flow::Continue)?;
            tried.push((exposure, best.0.mean()));
        }
        self.pilot = false;
        let best = (0..tried.len()).max_by(|&i, &j| tried[i].1.total_cmp(&tried[j].1)).unwrap_or(0);
        let found = match tried.get(best.wrapping_sub(1)..=best + 1) {
            Some(&[a, b, c]) => peak([a, b, c]),
            _ => tried[best].0,
        };
        Ok(PILOT_RISE * found)
    }

    /// The `t`-th step, counted from 1, over the next viewpoints.
    fn step(&self, viewpoints: &mut Viewpoints, progress: f64, t: usize) -> Step {
        let Self { settings, planner, .. } = *self;
        let batch = settings.pupils;
        let mode = match settings.optimizer {
            Optimizer::Projection { .. } => compare::PROJECTION,
            Optimizer::Adam { amplitude: true, .. } => compare::AMPLITUDE,
            Optimizer::Adam { .. } => compare::INTENSITY,
        };
        let comparison = Comparison { mode, exposure: self.exposure, batch, ..Comparison::default() };
        let pupil_passes = (0..batch).map(|_| planner.viewpoint(&viewpoints.draw(), &comparison)).collect();
        let in_flight = settings.window_bytes / size_of::<eyebox_kernels::Complex32>();
        let mut step = match settings.optimizer {
            Optimizer::Projection { gain, momentum, overlap_power } => {
                // Overlap to a power below one grows with the batch: what ten pupils ask for is the unit (OPTICS 6e).
                let share = (batch as f64 / 10.0).powf(1.0 - overlap_power);
                let overlap = viewpoints.overlap(batch).map_or(1.0, |n| n.powf(overlap_power));
                let gain = cosine(gain, progress) / (share * overlap);
                planner.project_step(pupil_passes, in_flight, overlap_power, gain, momentum)
            }
            Optimizer::Adam { rate, .. } => planner.adam_step(pupil_passes, in_flight, t, cosine(rate, progress)),
        };
        // Levels come on softly: a phase that is thrown from level to level from the start finds no good one.
        step.quantise.hardness = progress.powi(2) as f32;
        if settings.method == Method::PupilAware {
            return planner.with_equalised_eyebox(step, self.problem.eyebox, settings.patches, settings.evenness);
        }
        step
    }

    /// From the first phases, `steps` steps at most.
    pub(super) fn descend(
        &mut self,
        steps: usize,
        observe: &mut dyn FnMut(&Progress) -> Flow,
    ) -> Result<(Judged, usize, Stop), SolveError> {
        let Self { settings, planner, .. } = *self;
        let pixels = settings.frames * planner.slm.height * planner.slm.width;
        let zeros = vec![0.0; pixels];
        self.engine.write(Buffer::Phases, &self.first_phases(pixels))?;
        self.engine.write(Buffer::Momentum, &zeros)?;
        if matches!(settings.optimizer, Optimizer::Adam { .. }) {
            self.engine.write(Buffer::Second, &zeros)?;
        }
        drop(zeros);
        let mut viewpoints = Viewpoints::new(self.problem, settings, settings.seed);
        let limit = settings.seconds.filter(|_| !self.pilot);
        let wanted = settings.psnr.filter(|_| !self.pilot);
        let begun = self.start.elapsed().as_secs_f64();
        // Ten verdicts where quality is to stop the solve, else three: a verdict costs about two steps.
        let every = if wanted.is_some() { steps.div_ceil(10) } else { steps.div_ceil(3) }.max(3);
        self.durations.clear();
        let mut best: Option<Judged> = None;
        let mut step = 0;
        let stop = loop {
            let seconds = self.start.elapsed().as_secs_f64();
            if step >= steps {
                break Stop::Steps;
            }
            if limit.is_some_and(|most| seconds >= most) {
                break Stop::Seconds;
            }
            let progress = (step as f64 / steps as f64)
                .max(limit.map_or(0.0, |most| (seconds - begun) / (most - begun).max(1e-9)));
            let taken = Instant::now();
            let begun_at = self.from.map_or(0.0, |from| from.progress);
            let next = self.step(&mut viewpoints, begun_at + (1.0 - begun_at) * progress, step + 1);
            // The losses are known before the phases are touched: a bad step is not taken.
            let split = fault::before_state(&next);
            let losses = self.engine.run_part(&next, 0..split)?;
            step += 1;
            let loss = losses
                .iter()
                .zip(&next.pupil_passes)
                .map(|(loss, pupil_pass)| loss / pupil_pass.count() as f64)
                .sum::<f64>()
                / losses.len() as f64;
            if !loss.is_finite() {
                let kernel = fault::first_fault(self.engine, &next)?;
                if kernel.is_none() && best.is_none() {
                    self.engine.write(Buffer::Phases, &self.first_phases(pixels))?;
                }
                break Stop::NotFinite { step, kernel };
            }
            self.engine.run_part(&next, split..next.list.len())?;
            self.durations.push(taken.elapsed().as_secs_f64());
            if step.is_multiple_of(every) || step == steps {
                self.consider(step, &mut best)?;
            }
            let verdict = best.as_ref().map(|b| &b.0);
            if observe(&Progress { step, steps, seconds: self.start.elapsed().as_secs_f64(), loss, verdict })
                == Flow::Stop
            {
                break Stop::Asked;
            }
            if verdict.zip(wanted).is_some_and(|(v, wanted)| v.mean() >= wanted) {
                break Stop::Quality;
            }
        };
        if best.as_ref().is_none_or(|b| b.2 != step) {
            self.consider(step, &mut best)?;
        }
        Ok((best.expect("a verdict was just given"), step, stop))
    }

    fn first_phases(&self, pixels: usize) -> Vec<f32> {
        match (self.from, self.settings.method) {
            // Fewer where all sub-frames come out alike.
            (Some(from), _) => from.phases[..pixels].to_vec(),
            (None, Method::Smooth) => vec![0.0; pixels],
            _ => random_phases(pixels, self.settings.seed),
        }
    }

    /// Judges the engine's phases, and keeps them if they are the best so far. Phases that are not finite never are.
    fn consider(&mut self, step: usize, best: &mut Option<Judged>) -> Result<(), EngineError> {
        let planner = Planner { factor: WindowFactor::Full, ..self.planner.clone() };
        let verdict = self.judge.judge(self.engine, &planner)?.in_units_of(self.unit);
        let better = |b: &Judged| verdict.mean() >= b.0.mean() || b.0.mean().is_nan();
        if best.as_ref().is_none_or(better) {
            // What was judged is what the SLM shows.
            let shown = if self.planner.levels > 0 { Buffer::Shown } else { Buffer::Phases };
            let phases = self.engine.read(shown)?;
            if best.is_none() || phases.iter().all(|p| p.is_finite()) {
                *best = Some((verdict, phases, step));
            }
        }
        Ok(())
    }
}
