//! The loop.

use super::exposure::{BrightEnd, peak};
use super::method::Sights;
use super::{Judge, Method, Optimizer, Problem, Settings, Verdict, cosine, dpac, random_phases};
use crate::engine::{Buffer, Engine, EngineError};
use crate::optics::WindowFactor;
use crate::plan::{Comparison, Planner, Purpose, Step};
use eyebox_kernels::compare;
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
    /// Numbers left the range of float32.
    #[error("the loss was not finite in step {step}; the settings drive it out of range (try a smaller gain or rate)")]
    NotFinite {
        /// Which step, from 1.
        step: usize,
    },
    /// From the engine.
    #[error(transparent)]
    Engine(#[from] EngineError),
}

impl Settings {
    /// Refuses settings that cannot be.
    ///
    /// # Errors
    /// [`SolveError::Setting`].
    pub fn check(&self) -> Result<(), SolveError> {
        let wrong = |what, value: String, right| Err(SolveError::Setting { what, value, right });
        if !(1..=4096).contains(&self.frames) {
            return wrong("the number of sub-frames", self.frames.to_string(), "1 to 4096");
        }
        if !(1..=65536).contains(&self.pupils) {
            return wrong("the number of pupils a step", self.pupils.to_string(), "1 to 65536");
        }
        let [low, high] = self.diameter;
        if !(low > 0.0 && low <= high && high.is_finite()) {
            return wrong(
                "the range of pupil diameters (mm)",
                format!("{}..{}", low * 1e3, high * 1e3),
                "positive, smallest first",
            );
        }
        let [near, far] = self.depth;
        if !(near <= far && near.is_finite() && far.is_finite()) {
            return wrong(
                "the range of depths (mm)",
                format!("{}..{}", near * 1e3, far * 1e3),
                "finite, smallest first",
            );
        }
        if !(self.stft_filter > 0.0 && self.stft_filter <= 2.0) {
            let right = "above 0, at most 2: times the eyebox";
            return wrong("the diameter of the STFT's filter", self.stft_filter.to_string(), right);
        }
        if let Some(samples) = self.stft_samples.filter(|n| !(1..=256).contains(n)) {
            return wrong("the window of the STFT (samples)", samples.to_string(), "1 to 256");
        }
        if !(self.evenness >= 0.0 && self.evenness <= 1e6) {
            return wrong("the weight of the eyebox's evenness", self.evenness.to_string(), "0 to 1e6");
        }
        if !(1..=eyebox_kernels::energy::MOST as usize).contains(&self.patches) {
            return wrong("the number of patches along the eyebox", self.patches.to_string(), "1 to 16");
        }
        match self.efficiency {
            Some(e) if !(e > 0.0 && e <= 1.0) => wrong("the efficiency", e.to_string(), "above 0, at most 1"),
            _ => Ok(()),
        }
    }
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
    settings.check()?;
    let start = Instant::now();
    let frames = settings.frames;
    let mut computed =
        Settings { frames: if settings.method.repeats_frames() { 1 } else { settings.frames }, ..settings.clone() };
    if settings.method == Method::Smooth && matches!(settings.optimizer, Optimizer::Projection { .. }) {
        computed.optimizer = Optimizer::adam();
    }
    let given = if settings.method.is_iterative() { None } else { Some(dpac::phases(problem, settings, engine)?) };
    let planner = problem.planner(computed.frames, settings.window);
    let purpose = if matches!(computed.optimizer, Optimizer::Adam { .. }) { Purpose::Adam } else { Purpose::Project };
    let purpose = if given.is_some() { Purpose::View } else { purpose };
    engine.load(&planner.shape(purpose), Some(Arc::clone(&problem.pyramid)))?;
    // Held out: what the method looks through (pupils by the paper's distribution), from another seed.
    let uniform = Settings { diameters: super::Diameters::Uniform, ..computed.clone() };
    let mut held_out = Sights::new(problem, &uniform, !settings.seed);
    let judge = Judge::new(engine, &planner, (0..8).map(|_| held_out.draw()).collect())?;
    if let Some(phases) = given {
        engine.write(Buffer::Phases, &phases)?;
        let verdict = judge.judge(engine, &planner)?;
        let (exposure, seconds) = (verdict.exposure, start.elapsed().as_secs_f64());
        let efficiency = problem.mean / exposure;
        return Ok(Solution { phases, exposure, efficiency, verdict, steps: 0, seconds, stop: Stop::Steps });
    }
    let settings = &computed;
    let mut run =
        Run { problem, planner: &planner, settings, engine, judge: &judge, start, exposure: 0.0, pilot: false };
    run.exposure = match settings.efficiency {
        // A black scene has no efficiency: any exposure shows it.
        Some(efficiency) if problem.mean > 0.0 => problem.mean / efficiency,
        _ => run.choose_exposure(judge.bright_end(), observe)?,
    };
    let exposure = run.exposure;
    let (best, steps, stop) = run.descend(settings.steps, observe)?;
    let (verdict, phases, _) = best;
    let phases = phases.repeat(frames / settings.frames);
    let efficiency = problem.mean / exposure;
    Ok(Solution { phases, exposure, efficiency, verdict, steps, seconds: start.elapsed().as_secs_f64(), stop })
}

/// A verdict, the phases that it is about, and the step after which it was given.
type Judged = (Verdict, Vec<f32>, usize);

/// A solve under way.
struct Run<'a> {
    problem: &'a Problem,
    planner: &'a Planner,
    settings: &'a Settings,
    engine: &'a mut dyn Engine,
    judge: &'a Judge,
    start: Instant,
    exposure: f64,
    /// Whether this is a pilot: it stops only when asked.
    pilot: bool,
}

/// Steps of a pilot solve.
const PILOT_STEPS: usize = 24;
/// A longer solve wants more light than its pilot (docs/measurements.md).
const PILOT_RISE: f64 = 1.25;
/// Adam does best with less light to spare than the projection (docs/measurements.md).
const ADAM_EXPOSURE: f64 = 0.85;

impl Run<'_> {
    /// From the scene's bright end, by pilot solves where its two measures part.
    fn choose_exposure(
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

    /// The `t`-th step, counted from 1, over the next sights.
    fn step(&self, sights: &mut Sights, progress: f64, t: usize) -> Step {
        let Self { settings, planner, .. } = *self;
        let batch = settings.pupils;
        let mode = match settings.optimizer {
            Optimizer::Projection { .. } => compare::PROJECTION,
            Optimizer::Adam { amplitude: true, .. } => compare::AMPLITUDE,
            Optimizer::Adam { .. } => compare::INTENSITY,
        };
        let comparison = Comparison { mode, exposure: self.exposure, batch, ..Comparison::default() };
        let lanes = (0..batch).map(|_| planner.sight(&sights.draw(), &comparison)).collect();
        let in_flight = settings.window_bytes / size_of::<eyebox_kernels::Complex32>();
        let step = match settings.optimizer {
            Optimizer::Projection { gain, momentum, overlap_power } => {
                // Overlap to a power below one grows with the batch: what ten pupils ask for is the unit (OPTICS 6e).
                let share = (batch as f64 / 10.0).powf(1.0 - overlap_power);
                let overlap = sights.overlap(batch).map_or(1.0, |n| n.powf(overlap_power));
                let gain = cosine(gain, progress) / (share * overlap);
                planner.project_step(lanes, in_flight, overlap_power, gain, momentum)
            }
            Optimizer::Adam { rate, .. } => planner.adam_step(lanes, in_flight, t, cosine(rate, progress)),
        };
        if settings.method == Method::PupilAware {
            return planner.with_even(step, self.problem.eyebox, settings.patches, settings.evenness);
        }
        step
    }

    /// From the first phases, `steps` steps at most.
    fn descend(
        &mut self,
        steps: usize,
        observe: &mut dyn FnMut(&Progress) -> Flow,
    ) -> Result<(Judged, usize, Stop), SolveError> {
        let Self { settings, planner, judge, .. } = *self;
        let pixels = settings.frames * planner.slm.height * planner.slm.width;
        let zeros = vec![0.0; pixels];
        let first = match settings.method {
            Method::Smooth => zeros.clone(),
            _ => random_phases(pixels, settings.seed),
        };
        self.engine.write(Buffer::Phases, &first)?;
        self.engine.write(Buffer::Momentum, &zeros)?;
        if matches!(settings.optimizer, Optimizer::Adam { .. }) {
            self.engine.write(Buffer::Second, &zeros)?;
        }
        drop((zeros, first));
        let mut sights = Sights::new(self.problem, settings, settings.seed);
        let limit = settings.seconds.filter(|_| !self.pilot);
        let wanted = settings.psnr.filter(|_| !self.pilot);
        let begun = self.start.elapsed().as_secs_f64();
        // Ten verdicts where quality is to stop the solve, else three: a verdict costs about two steps.
        let every = if wanted.is_some() { steps.div_ceil(10) } else { steps.div_ceil(3) }.max(3);
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
            let next = self.step(&mut sights, progress, step + 1);
            let losses = self.engine.run(&next)?;
            step += 1;
            let loss = losses.iter().zip(&next.lanes).map(|(loss, lane)| loss / lane.count() as f64).sum::<f64>()
                / losses.len() as f64;
            if !loss.is_finite() {
                if best.is_none() {
                    return Err(SolveError::NotFinite { step });
                }
                break Stop::Asked;
            }
            if step.is_multiple_of(every) || step == steps {
                consider(judge, self.engine, planner, step, &mut best)?;
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
            consider(judge, self.engine, planner, step, &mut best)?;
        }
        Ok((best.expect("a verdict was just given"), step, stop))
    }
}

fn consider(
    judge: &Judge,
    engine: &mut dyn Engine,
    planner: &Planner,
    step: usize,
    best: &mut Option<(Verdict, Vec<f32>, usize)>,
) -> Result<(), EngineError> {
    let planner = Planner { factor: WindowFactor::Full, ..planner.clone() };
    let verdict = judge.judge(engine, &planner)?;
    if best.as_ref().is_none_or(|b| verdict.mean() >= b.0.mean()) {
        *best = Some((verdict, engine.read(Buffer::Phases)?, step));
    }
    Ok(())
}
