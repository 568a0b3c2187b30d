//! Measures the cost of quality on this machine with trials of a grid of recipes within a budget of time.

use super::grid::{Space, grid};
use super::tuned::{Checked, LevelRow, Tuned};
use super::{ColorJob, Quality, QualityError, Recommended, Reference, Solved, Trial, recommend};
use crate::kept::{ResultCache, checksum, identity};
use crate::stoppable::Stoppable;
use crate::watch::{JobObserver, Observe, unless_stopped};
use eyebox::low_level::engine::{Engine, Memory};
use eyebox::low_level::error::Reason;
use eyebox::low_level::evaluate::JodMetric;
use eyebox::low_level::optics::{Padding, WindowFactor};
use eyebox::low_level::solve::{Cost, Flow, Levels, Settings, ValidationScore, even_levels};
use serde::{Deserialize, Serialize};
use serde_json::json;
use std::path::Path;
use std::time::Instant;

/// The share of the budget for the longest trial.
const TRIAL: f64 = 1.0 / 6.0;
/// The share of the budget at whose end the grid stops.
const GRID: f64 = 0.78;
/// The share of the budget at whose end the comparison of levels stops.
const LEVELS: f64 = 0.88;
/// The share of the budget at whose end all measurements stop.
const ALL: f64 = 0.97;
/// A trial is given up if it takes this many times its allowed time.
const TUNE_PATIENCE: f64 = 2.0;
/// The numbers of levels that are compared, in addition to the SLM's own.
const COMPARED: [usize; 4] = [2, 4, 8, 16];

/// The subject of a tuning and its limits.
pub struct Tuning<'a> {
    /// The problem on which recipes are tried.
    pub job: ColorJob<'a>,
    /// The allowed seconds over all runs into one folder.
    pub budget: f64,
    /// The seed of the pupils that score the trials.
    pub seed: u64,
    /// Settings of another run, which are measured as well.
    pub check: Vec<Recommended>,
    /// The number of pupils through which a trial is judged in JOD, in addition to its PSNR. The viewing conditions are
    /// the job's display ([`Viewing`](eyebox::low_level::optics::Viewing)). 0 for none.
    pub judged: usize,
    /// The time at which this run began.
    pub begun: Instant,
}

/// The state that is saved between runs.
#[derive(Default, Serialize, Deserialize)]
#[serde(default)]
struct State {
    spent_s: f64,
    /// The budget, in seconds, for which the grid is complete.
    done_s: f64,
    trials: Vec<Trial>,
    levels: Vec<LevelRow>,
    levels_recipe: String,
}

struct Work<'a, 'b, 'w> {
    tuning: Tuning<'a>,
    engine: &'b mut dyn Engine,
    watch: &'b JobObserver<'w>,
    keep: ResultCache,
    made_by: String,
    /// The seconds spent before this run.
    before: f64,
    what: String,
    ceiling: Option<[f64; 2]>,
    state: State,
}

impl<'a> Tuning<'a> {
    /// Tries recipes until the grid is complete, the budget is spent or `observe` stops it. `folder` stores the trials,
    /// so that the same tuning resumes there.
    ///
    /// # Errors
    /// Returns [`QualityError`] if a trial fails or the folder cannot be written.
    pub fn run(self, folder: &Path, engine: &mut dyn Engine, observe: &mut Observe) -> Result<Tuned, QualityError> {
        let ColorJob { field, color, display, ref base, ref levels } = self.job;
        let device = engine.describe();
        let made_by = json!({
            "version": env!("CARGO_PKG_VERSION"), "format": 1, "device": device, "base": base, "levels": levels,
            "judged": [json!(self.judged), json!(display.viewing), json!(display.pixels_per_degree())],
            "scene": [json!(checksum(field)), json!(field.grid), json!(field.cell(display))], "color": color,
            "display": identity(display),
        });
        let mut tuned = Tuned {
            version: env!("CARGO_PKG_VERSION").into(),
            device,
            scene: field.name.clone(),
            color,
            display: display.name.clone(),
            size: [display.height, display.width],
            frames: base.frames,
            slm_levels: levels.given().map(<[f64]>::len),
            seed: self.seed,
            ceiling: None,
            budget_s: self.budget,
            spent_s: 0.0,
            interrupted: false,
            recommended: Vec::new(),
            trials: Vec::new(),
            levels: Vec::new(),
            levels_recipe: String::new(),
            check: self.check.iter().map(Checked::new).collect(),
        };
        let (keep, made_by) = (ResultCache::new(folder.into())?, made_by.to_string());
        let state: State = keep.load("trials", &made_by).unwrap_or_default();
        let (before, what) = (state.spent_s, String::new());
        let watch = JobObserver::new(observe);
        let stops = || watch.stops();
        let engine = &mut Stoppable { engine, stops: &stops };
        let mut work = Work { tuning: self, engine, watch: &watch, keep, made_by, before, what, ceiling: None, state };
        unless_stopped(work.all())?;
        work.save()?;
        (tuned.ceiling, tuned.interrupted) = (work.ceiling, watch.is_stopped());
        let State { spent_s, trials, levels, levels_recipe, .. } = work.state;
        (tuned.spent_s, tuned.trials, tuned.levels, tuned.levels_recipe) = (spent_s, trials, levels, levels_recipe);
        tuned.settle();
        Ok(tuned)
    }
}

impl Work<'_, '_, '_> {
    /// Returns the seconds spent in all runs.
    fn spent(&self) -> f64 {
        self.before + self.tuning.begun.elapsed().as_secs_f64()
    }

    /// Reports progress. Returns false once the job is stopped.
    fn goes_on(&mut self) -> bool {
        let share = self.spent() / (ALL * self.tuning.budget);
        self.watch.say(&self.what, share.min(1.0))
    }

    fn save(&mut self) -> Result<(), QualityError> {
        self.state.spent_s = self.spent();
        Ok(self.keep.save("trials", &self.made_by, &self.state)?)
    }

    /// Runs all parts of the tuning.
    fn all(&mut self) -> Result<(), QualityError> {
        self.what = "target images".into();
        self.goes_on();
        let reference = Reference::new(&self.tuning.job, self.tuning.seed, self.engine)?;
        self.ceiling = reference.ceiling(self.engine)?;
        let warm = self.warm_up()?;
        let checked: Vec<Settings> = self.tuning.check.iter().map(|c| c.trial.recipe.clone()).collect();
        for recipe in checked.into_iter().filter(|r| !self.tried(r)).collect::<Vec<_>>() {
            if self.goes_on() {
                self.trial(&recipe, f64::INFINITY, &reference)?;
            }
        }
        if self.state.done_s < self.tuning.budget && self.grid(warm, &reference)? {
            self.state.done_s = self.tuning.budget;
        }
        self.levels(reference)?;
        self.time_again()
    }

    fn tried(&self, recipe: &Settings) -> bool {
        self.state.trials.iter().any(|t| t.recipe == *recipe)
    }

    /// Tries the grid, as far as there is time for it. Returns true if it was not interrupted.
    fn grid(&mut self, warm: f64, reference: &Reference) -> Result<bool, QualityError> {
        let budget = self.tuning.budget;
        // The default is first, because its time decides how many steps the budget allows.
        if !self.tried(&Settings::default()) {
            self.trial(&Settings::default(), f64::INFINITY, reference)?;
        }
        let mut rates = Vec::new();
        for trial in &self.state.trials {
            rates.push(trial.milliseconds / self.cost(&trial.recipe)?.work());
        }
        let steps = |steps| Settings { steps, window: WindowFactor::Two, ..Settings::default() };
        let (one, two) = (self.cost(&steps(1))?.work(), self.cost(&steps(2))?.work());
        let steps = ((1e3 * TRIAL * budget / median(&mut rates, warm) - one) / (two - one).max(1.0)).max(1.0);
        // The number of steps is round, so that a resumed run has the same grid.
        let steps = 2f64.powf((2.0 * steps.log2()).floor() / 2.0).min(8192.0) as usize;
        for recipe in grid(&self.space()?, steps) {
            if self.tried(&recipe) {
                continue;
            }
            let left = 1e3 * (GRID * budget - self.spent());
            if !self.goes_on() {
                return Ok(false);
            }
            let work = self.cost(&recipe)?.work();
            if work * median(&mut rates, warm) > left {
                continue;
            }
            if let Some(milliseconds) = self.trial(&recipe, left, reference)? {
                rates.push(milliseconds / work);
            }
        }
        Ok(!self.watch.is_stopped())
    }

    fn cost(&self, recipe: &Settings) -> Result<Cost, QualityError> {
        self.tuning.job.cost(recipe, self.engine.memory())
    }

    fn space(&self) -> Result<Space, QualityError> {
        let job = &self.tuning.job;
        let coarse = Settings { pixel: 2, ..Settings::default() };
        Ok(Space {
            frames: job.base.frames,
            views: job.field.grid,
            halves: self.engine.memory() != Memory::Host,
            levels: job.levels != Levels::Any,
            padding: job.required_padding()? != Padding::default(),
            pixel: coarse.fits(job.display) && job.display.height.min(job.display.width) >= 4,
        })
    }

    /// Returns the milliseconds of a unit of work, from a few steps without a score. The first solve plans its
    /// transforms and compiles its kernels, so it is not timed.
    fn warm_up(&mut self) -> Result<f64, QualityError> {
        let recipe = Settings { steps: 3, window: WindowFactor::Two, ..Settings::default() };
        let mut go = || self.tuning.job.solve(&recipe, self.engine, &mut |_| Flow::Continue);
        go()?;
        let solved = go()?;
        Ok(solved.milliseconds / self.cost(&recipe)?.work())
    }

    /// Solves a recipe. Returns `None` if it was interrupted, or takes far longer than `longest` milliseconds.
    fn solve(&mut self, recipe: &Settings, longest: f64) -> Result<Option<Solved>, QualityError> {
        let (start, mut late) = (Instant::now(), false);
        let Self { tuning, engine, watch, before, what, .. } = self;
        let solved = tuning.job.solve(recipe, *engine, &mut |_| {
            let spent = *before + tuning.begun.elapsed().as_secs_f64();
            late |= start.elapsed().as_secs_f64() * 1e3 > TUNE_PATIENCE * longest;
            let goes_on = watch.say(what, (spent / (ALL * tuning.budget)).min(1.0));
            if late || !goes_on { Flow::Stop } else { Flow::Continue }
        })?;
        Ok((!late && !self.watch.is_stopped()).then_some(solved))
    }

    /// Measures a recipe and returns its time in milliseconds. Short solves are timed several times. The quality is
    /// measured once, because the same seed gives the same quality.
    fn trial(&mut self, recipe: &Settings, longest: f64, reference: &Reference) -> Result<Option<f64>, QualityError> {
        self.what = format!("trial {}: {recipe}", self.state.trials.len() + 1);
        let Some(solved) = self.solve(recipe, longest)? else { return Ok(None) };
        let score = self.score(&solved, reference)?;
        if score.quality().is_none() {
            let what = self.tuning.job.field.name.clone();
            let reason = "black through all pupils of the score, so all settings are equal. Choose a brighter scene.";
            return Err(QualityError::Input { what, reason: Reason::new("black", reason) });
        }
        let jod = self.judge(&solved, score.exposure, reference)?;
        let mut trial = Trial::new(recipe.clone(), solved.milliseconds, score.psnr, self.cost(recipe)?.bytes());
        trial.jod = jod;
        let more = match solved.milliseconds {
            ms if ms < 400.0 => 2,
            ms if ms < 1000.0 => 1,
            _ => 0,
        };
        for _ in 0..more {
            let Some(again) = self.solve(recipe, longest)? else { break };
            trial.timed(again.milliseconds);
        }
        if !trial.is_sound() {
            return Ok(None);
        }
        let milliseconds = trial.milliseconds;
        self.state.trials.push(trial);
        self.save()?;
        Ok(Some(milliseconds))
    }

    /// Scores only the sub-frames that differ, because the others repeat them.
    fn score(&mut self, solved: &Solved, reference: &Reference) -> Result<ValidationScore, QualityError> {
        let pixels = self.tuning.job.display.height * self.tuning.job.display.width;
        reference.score(&solved.solution.phases[..solved.frames * pixels], self.engine)
    }

    /// Judges the same sub-frames in JOD, if this is requested.
    fn judge(
        &mut self,
        solved: &Solved,
        exposure: f64,
        reference: &Reference,
    ) -> Result<Option<[f64; 2]>, QualityError> {
        let (display, judged) = (self.tuning.job.display, self.tuning.judged);
        if judged == 0 {
            return Ok(None);
        }
        let metric = JodMetric::new(&display.viewing, display.pixels_per_degree(), false)?;
        let phases = &solved.solution.phases[..solved.frames * display.height * display.width];
        reference.judge(phases, exposure, &metric, judged, self.engine)
    }

    /// Compares phases that are rounded to levels with phases that are optimized for levels.
    fn levels(&mut self, mut reference: Reference) -> Result<(), QualityError> {
        let mut wanted: Vec<Vec<f64>> = COMPARED.map(even_levels).to_vec();
        if let Some(own) = self.tuning.job.levels.given().filter(|l| l.len() < 256) {
            wanted.retain(|l| l.len() != own.len());
            wanted.push(own.to_vec());
        }
        wanted.sort_by_key(Vec::len);
        // The recipe is balanced if there is time for it, and otherwise the default. Their measured times decide.
        let time = |t: &Trial| t.milliseconds * (wanted.len() + 1) as f64 * 1e-3;
        let left = LEVELS * self.tuning.budget - self.spent();
        let trials = &self.state.trials;
        let balanced = recommend(trials).map(|r| r[Quality::Balanced as usize].trial.clone());
        let default = trials.iter().find(|t| t.recipe == Settings::default()).cloned();
        let chosen = balanced.into_iter().chain(default).find(|t| time(t) < left);
        let Some(trial) = chosen.filter(|_| self.state.levels.is_empty() && self.goes_on()) else {
            return Ok(());
        };
        let recipe = Settings { levels: Levels::Any, ..trial.recipe };
        self.what = "levels of the SLM".into();
        let Some(free) = self.solve(&recipe, f64::INFINITY)? else { return Ok(()) };
        reference = reference.with_levels(Levels::Any);
        let two = |v: ValidationScore| [v.mean(), v.worst()];
        let without = two(self.score(&free, &reference)?);
        let mut rows = Vec::new();
        for levels in wanted {
            reference = reference.with_levels(Levels::Given(levels.clone()));
            let after = two(self.score(&free, &reference)?);
            let before = std::mem::replace(&mut self.tuning.job.levels, Levels::Given(levels.clone()));
            let solved = self.solve(&Settings { levels: Levels::Display, ..recipe.clone() }, f64::INFINITY);
            self.tuning.job.levels = before;
            let Some(solved) = solved? else { break };
            let optimised = two(self.score(&solved, &reference)?);
            let milliseconds = [free.milliseconds, solved.milliseconds];
            rows.push(LevelRow { levels: levels.len(), free: without, after, optimised, milliseconds });
        }
        (self.state.levels, self.state.levels_recipe) = (rows, recipe.to_string());
        Ok(())
    }

    /// Times the recommended trials again, until chance has little influence or the budget ends.
    fn time_again(&mut self) -> Result<(), QualityError> {
        while let Some(three) = recommend(&self.state.trials) {
            let left = 1e3 * (ALL * self.tuning.budget - self.spent());
            let enough = |t: &Trial| if t.milliseconds < 10_000.0 { 3 } else { 2 };
            let next = three.into_iter().map(|r| r.trial).find(|t| t.times.len() < enough(t) && t.milliseconds < left);
            let Some(recipe) = next.map(|t| t.recipe).filter(|_| self.goes_on()) else { break };
            self.what = format!("repeated trial: {recipe}");
            let Some(solved) = self.solve(&recipe, f64::INFINITY)? else { break };
            if let Some(trial) = self.state.trials.iter_mut().find(|t| t.recipe == recipe) {
                trial.timed(solved.milliseconds);
            }
            self.save()?;
        }
        Ok(())
    }
}

/// Returns the middle value, or `without` if there is none.
fn median(values: &mut [f64], without: f64) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(without)
}
