//! Runs a joint solve, with the steps of every color, the fits of powers, and validation.

use super::drives::Drives;
use super::powers::PowerFit;
use crate::engine::{Buffer, Engine, EngineError};
use crate::optics::{WindowFactor, reference_of};
use crate::plan::{Comparison, Kernel, Planner};
use crate::solve::error::SolveError;
use crate::solve::outcome::{Flow, Progress, Solution, Stop, Warm};
use crate::solve::run::{Ready, interval};
use crate::solve::sampling::random_phases;
use crate::solve::settings::Settings;
use crate::solve::step::{Steps, Turns, ask, first_fault};
use crate::solve::validation::ValidationScore;
use crate::solve::viewpoints::Viewpoints;
use std::slice;
use std::sync::Arc;
use std::time::Instant;

/// The solutions of colors that were solved together.
#[derive(Debug, Clone)]
pub struct JointSolution {
    /// One solution per color, in the order of the problems. Its phases follow from the shared drive values.
    pub colors: Vec<Solution>,
    /// Power of each color's laser in each sub-frame, relative to its mean (color, sub-frame).
    pub powers: Vec<Vec<f64>>,
}

/// One color in the light of its laser.
pub(super) struct Lit<'a> {
    /// The planner in it lights all sub-frames equally.
    pub(super) ready: Ready<'a>,
    /// Turns of its light per turn of the drive value.
    pub(super) slope: f64,
    /// The exposure in units of its scene.
    pub(super) exposure: f64,
}

/// The best state of a joint solve.
struct Best {
    /// Mean over the colors in dB.
    score: f64,
    /// Mean PSNR of the colors that are not black, in dB.
    quality: Option<f64>,
    step: usize,
    /// Phases of each color.
    phases: Vec<Vec<f32>>,
    powers: Vec<Vec<f64>>,
    validation: Vec<ValidationScore>,
}

/// Steps from one fit of the powers to the next, and the share of the way to the fitted powers that they move. The
/// result for one set of pupils is only a part of the data.
const FIT_EVERY: usize = 3;
const FIT_SHARE: f64 = 0.5;
/// Number of pupils to which powers are fitted.
const FIT_PUPILS: usize = 6;

/// A joint solve that is under way.
pub(super) struct JointRun<'a> {
    lit: Vec<Lit<'a>>,
    settings: &'a Settings,
    drives: Drives,
    powers: Vec<Vec<f64>>,
    /// Largest power relative to the mean.
    most: f64,
    /// Position in the schedule at which it begins.
    begun_at: f64,
    start: Instant,
    best: Option<Best>,
    /// The change of one color's field.
    change: Vec<f32>,
}

impl<'a> JointRun<'a> {
    /// Starts with these powers, or equal ones, and with the drive values of `from` as phases of one turn, or random
    /// ones.
    pub(super) fn new(
        lit: Vec<Lit<'a>>,
        settings: &'a Settings,
        most: f64,
        powers: Option<&[Vec<f64>]>,
        from: Option<Warm<'_>>,
        start: Instant,
    ) -> Self {
        let (slm, grid) = (lit[0].ready.planner.slm, lit[0].ready.planner.grid);
        let size = [slm.height, slm.width];
        let phases = match from {
            Some(from) => from.phases.to_vec(),
            None => random_phases(settings.frames * size[0] * size[1], settings.seed),
        };
        Self {
            drives: Drives::new(&phases, size),
            powers: powers.map_or_else(|| vec![vec![1.0; settings.frames]; lit.len()], <[_]>::to_vec),
            change: vec![0.0; 2 * settings.frames * grid.height * grid.width],
            begun_at: from.map_or(0.0, |from| from.progress),
            best: None,
            lit,
            settings,
            most,
            start,
        }
    }

    /// Takes all steps and returns the solution.
    pub(super) fn solve(
        mut self,
        engine: &mut dyn Engine,
        observe: &mut dyn FnMut(&Progress) -> Flow,
    ) -> Result<JointSolution, SolveError> {
        let settings = self.settings;
        let lit = std::mem::take(&mut self.lit);
        let memory = engine.memory();
        let mut schedules: Vec<Steps<'_>> =
            lit.iter().map(|l| Steps::new(l.ready.problem, &l.ready.planner, settings, l.exposure, memory)).collect();
        // These pupils are separate, because the best powers for the pupils of a step are not the best for others.
        let mut fitted_to = Viewpoints::new(lit[0].ready.problem, settings, settings.seed ^ 0x706f_7765_7273);
        let (every, begun) = (interval(settings.steps, settings.psnr.is_some()), self.start.elapsed().as_secs_f64());
        let (mut durations, mut step) = (Vec::new(), 0);
        let stop = loop {
            let seconds = self.start.elapsed().as_secs_f64();
            if step >= settings.steps {
                break Stop::Steps;
            }
            if settings.seconds.is_some_and(|most| seconds >= most) {
                break Stop::Seconds;
            }
            let share = settings.seconds.map_or(0.0, |most| (seconds - begun) / (most - begun).max(1e-9));
            let progress = (step as f64 / settings.steps as f64).max(share);
            let mark = Instant::now();
            let loss =
                match self.step(&lit, &mut schedules, self.begun_at + (1.0 - self.begun_at) * progress, engine)? {
                    Ok(loss) => loss,
                    Err(stop) => break Stop::NotFinite { step: step + 1, kernel: stop },
                };
            step += 1;
            if step.is_multiple_of(FIT_EVERY) && self.most > 1.0 && settings.frames > 1 {
                self.fit_powers(&lit, &mut fitted_to, engine)?;
            }
            durations.push(mark.elapsed().as_secs_f64());
            if step.is_multiple_of(every) || step == settings.steps {
                self.validate(&lit, step, engine)?;
            }
            // The color at whose wavelength drive values are phases represents all.
            let reference = reference_of(lit.iter().map(|l| l.slope)).unwrap_or(0);
            let validation = self.best.as_ref().map(|best| &best.validation[reference]);
            let (steps, seconds) = (settings.steps, self.start.elapsed().as_secs_f64());
            if observe(&Progress { pilot: None, fitting: None, step, steps, seconds, loss, validation }) == Flow::Stop {
                break Stop::Asked;
            }
            let quality = self.best.as_ref().and_then(|best| best.quality);
            if quality.zip(settings.psnr).is_some_and(|(db, wanted)| db >= wanted) {
                break Stop::Quality;
            }
        };
        let judged = self.best.as_ref().map(|best| best.step);
        if judged.is_none() || judged != Some(step) && !matches!(stop, Stop::NotFinite { .. }) {
            self.validate(&lit, step, engine)?;
        }
        durations.sort_by(f64::total_cmp);
        let step_seconds = durations.get(durations.len() / 2).copied().unwrap_or(0.0);
        Ok(self.solution(&lit, step, step_seconds, stop))
    }

    /// Takes one step of all colors, and returns the mean loss over them. If numbers are not finite, it returns the
    /// kernel that computed them, and no drive value moves.
    fn step(
        &mut self,
        lit: &[Lit<'_>],
        schedules: &mut [Steps<'_>],
        progress: f64,
        engine: &mut dyn Engine,
    ) -> Result<Result<f64, Option<Kernel>>, SolveError> {
        let mut loss = 0.0;
        let mut last = None;
        for (color, (l, schedule)) in lit.iter().zip(schedules).enumerate() {
            let mut step = schedule.next(progress);
            for pass in &mut step.pupil_passes {
                pass.set_powers(&self.powers[color]);
            }
            let phases = self.drives.phases(l.slope);
            show(engine, l, &phases)?;
            let of_color = ask(engine, &step, slice::from_ref(&(0..step.list.len())), &mut self.change)?;
            if !of_color.is_finite() {
                return Ok(Err(first_fault(engine, &step)?));
            }
            loss += of_color / lit.len() as f64;
            // A gradient is the derivative of the loss alone.
            let turns = Turns::of(&step);
            let share = |p: &f64| if turns.projects { *p } else { 0.0 };
            let undiffracted = self.powers[color].iter().map(share).collect::<Vec<_>>();
            self.drives.ask(l.slope, &phases, &self.change, &undiffracted, &turns);
            last = Some(turns);
        }
        if let Some(turns) = last {
            let norm = |f: usize| lit.iter().zip(&self.powers).map(|(l, p)| p[f] * l.slope * l.slope).sum::<f64>();
            let norms: Vec<f64> = (0..self.settings.frames).map(norm).collect();
            self.drives.turn(&turns, &norms, lit.len());
        }
        Ok(Ok(loss))
    }

    /// Moves the powers towards the best ones for the current drive values, through further pupils.
    fn fit_powers(
        &mut self,
        lit: &[Lit<'_>],
        viewpoints: &mut Viewpoints,
        engine: &mut dyn Engine,
    ) -> Result<(), SolveError> {
        let drawn: Vec<_> = (0..FIT_PUPILS).map(|_| viewpoints.draw()).collect();
        for (l, powers) in lit.iter().zip(&mut self.powers) {
            show(engine, l, &self.drives.phases(l.slope))?;
            let fit = fit_of(engine, l, &drawn)?;
            let best = fit.best(powers, self.most);
            powers.iter_mut().zip(best).for_each(|(power, best)| *power += FIT_SHARE * (best - *power));
        }
        Ok(())
    }

    /// Scores the current drive values and powers, and keeps them if they are the best.
    fn validate(&mut self, lit: &[Lit<'_>], step: usize, engine: &mut dyn Engine) -> Result<(), SolveError> {
        let (mut validation, mut kept) = (Vec::with_capacity(lit.len()), Vec::with_capacity(lit.len()));
        for (l, powers) in lit.iter().zip(&self.powers) {
            let phases = self.drives.phases(l.slope);
            show(engine, l, &phases)?;
            let planner =
                Planner { factor: WindowFactor::Full, powers: powers.clone().into(), ..l.ready.planner.clone() };
            validation.push(l.ready.validator.score(engine, &planner)?.in_units_of(l.ready.unit));
            kept.push(phases);
        }
        // Colors without light have no quality. If none has light, the remaining light decides which state is kept.
        let lit_colors: Vec<f64> =
            validation.iter().filter_map(ValidationScore::quality).map(|[mean, _]| mean).collect();
        let mean = |all: &[f64]| all.iter().sum::<f64>() / all.len() as f64;
        let quality = (!lit_colors.is_empty()).then(|| mean(&lit_colors));
        let score = quality.unwrap_or_else(|| mean(&validation.iter().map(ValidationScore::mean).collect::<Vec<_>>()));
        if self.best.as_ref().is_none_or(|best| score >= best.score || best.score.is_nan()) {
            self.best = Some(Best { score, quality, step, phases: kept, powers: self.powers.clone(), validation });
        }
        Ok(())
    }

    fn solution(self, lit: &[Lit<'_>], steps: usize, step_seconds: f64, stop: Stop) -> JointSolution {
        let best = self.best.expect("it was just validated");
        let seconds = self.start.elapsed().as_secs_f64();
        let color = |((l, phases), validation): ((&Lit<'_>, Vec<f32>), ValidationScore)| {
            let exposure = l.exposure * l.ready.unit;
            let efficiency = l.ready.problem.mean / exposure;
            Solution { phases, exposure, efficiency, validation, steps, seconds, step_seconds, stop }
        };
        JointSolution {
            colors: lit.iter().zip(best.phases).zip(best.validation).map(color).collect(),
            powers: best.powers,
        }
    }
}

/// Gives an engine the views and phases of one color.
fn show(engine: &mut dyn Engine, lit: &Lit<'_>, phases: &[f32]) -> Result<(), EngineError> {
    engine.take_views(Arc::clone(&lit.ready.problem.pyramid))?;
    engine.write(Buffer::Phases, phases)
}

/// Fits the powers of a color that an engine shows, through these viewpoints.
pub(super) fn fit_of(
    engine: &mut dyn Engine,
    lit: &Lit<'_>,
    viewpoints: &[crate::plan::Viewpoint],
) -> Result<PowerFit, EngineError> {
    let planner = Planner { powers: [].into(), ..lit.ready.planner.clone() };
    let passes = viewpoints.iter().map(|v| planner.viewpoint(v, &Comparison::default())).collect();
    let step = planner.fields_step(passes).pass_by_pass();
    let shared = step.shared();
    engine.run_part(&step, 0..shared)?;
    let each = (step.list.len() - shared) / viewpoints.len().max(1);
    let mut fit = PowerFit::new(planner.frames);
    for (i, pass) in step.pupil_passes.iter().enumerate() {
        engine.run_part(&step, shared + i * each..shared + (i + 1) * each)?;
        let (fields, target) = (engine.read(Buffer::Window(0))?, engine.read(Buffer::Target(0))?);
        let gain = lit.exposure * f64::from(pass.intensity.gain);
        fit.add(bytemuck::cast_slice(&fields[..2 * planner.frames * pass.count()]), gain, &target[..pass.count()]);
    }
    Ok(fit)
}
