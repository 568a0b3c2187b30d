//! The trials themselves, within their budget; each is kept as soon as it is made.

use super::found::LevelRow;
use crate::Failure;
use crate::evaluate::keep::Keep;
use crate::progress::{self, JobBar};
use eyebox::engine::{Engine, Memory};
use eyebox::optics::{Padding, WindowFactor};
use eyebox::quality::{Quality, Reference, Solved, Space, Subject, Sweep, Trial, recommend};
use eyebox::solve::{Flow, Levels, Settings, ValidationScore, even_levels};
use serde::{Deserialize, Serialize};
use std::time::Instant;

/// Shares of the budget: a single trial, the sweep, and all that is measured.
const TRIAL: f64 = 1.0 / 5.0;
const SWEEP: f64 = 0.78;
const LEVELS: f64 = 0.88;
const ALL: f64 = 0.97;
/// A trial that takes so many times what it may is given up.
const PATIENCE: f64 = 2.0;
/// Levels that are compared, besides the SLM's own.
const COMPARED: [usize; 4] = [2, 4, 8, 16];

/// What is kept between runs.
#[derive(Default, Serialize, Deserialize)]
struct State {
    spent_s: f64,
    trials: Vec<Trial>,
    levels: Vec<LevelRow>,
    levels_recipe: String,
}

/// A run under way.
pub struct Work<'a> {
    pub subject: Subject<'a>,
    pub engine: &'a mut dyn Engine,
    pub keep: &'a Keep,
    pub made_by: String,
    pub budget: f64,
    pub seed: u64,
    /// When this run began.
    pub begun: Instant,
    pub quiet: bool,
}

/// What is left when all is measured, or there was no time for it.
pub struct Done {
    pub trials: Vec<Trial>,
    pub levels: Vec<LevelRow>,
    pub levels_recipe: String,
    pub spent_s: f64,
}

struct Clock<'a> {
    before: f64,
    begun: Instant,
    bar: &'a JobBar,
}

impl Clock<'_> {
    /// Seconds spent in all.
    fn spent(&self) -> f64 {
        let spent = self.before + self.begun.elapsed().as_secs_f64();
        self.bar.at(spent * BAR);
        spent
    }
}

/// Marks of the bar a second: it moves smoothly.
const BAR: f64 = 10.0;

impl Work<'_> {
    /// Measures: first `wanted`, then what the sweep decides.
    pub fn run(&mut self, wanted: &[Settings]) -> Result<Done, Failure> {
        let bar = JobBar::new(self.budget * ALL * BAR, self.quiet);
        let mut state: State = self.keep.load("trials", &self.made_by).unwrap_or_default();
        let clock = Clock { before: state.spent_s, begun: self.begun, bar: &bar };
        bar.say("photographs");
        let reference = Reference::new(&self.subject, self.seed, self.engine)?;
        let mut rate = self.warm_up()?;
        let mut sweep = Sweep::new(self.space()?, self.seed);
        for recipe in wanted {
            if !state.trials.iter().any(|t| t.recipe == *recipe) && !progress::interrupted() {
                self.trial(recipe, f64::INFINITY, &reference, &clock, &mut state)?;
            }
        }
        loop {
            if !state.trials.is_empty() {
                rate = self.rate(&state.trials)?;
            }
            let left = SWEEP * self.budget - clock.spent();
            if progress::interrupted() || left <= 0.0 && !state.trials.is_empty() {
                break;
            }
            let longest = if state.trials.is_empty() { f64::INFINITY } else { 1e3 * left.min(TRIAL * self.budget) };
            let memory = self.engine.memory();
            let expect = |r: &Settings| self.subject.cost(r, memory).map_or(f64::INFINITY, |c| c.work() * rate);
            let Some(recipe) = sweep.next(&state.trials, longest, &expect) else { break };
            self.trial(&recipe, longest, &reference, &clock, &mut state)?;
        }
        self.levels(reference, &clock, &mut state)?;
        self.time_again(&clock, &mut state)?;
        state.spent_s = clock.spent();
        self.keep.save("trials", &self.made_by, &state)?;
        bar.finish();
        let State { trials, levels, levels_recipe, spent_s } = state;
        Ok(Done { trials, levels, levels_recipe, spent_s })
    }

    fn space(&self) -> Result<Space, Failure> {
        let coarse = Settings { pixel: 2, ..Settings::default() };
        Ok(Space {
            frames: self.subject.base.frames,
            views: self.subject.field.grid,
            halves: self.engine.memory() != Memory::Host,
            levels: self.subject.levels != Levels::Any,
            padding: self.subject.required_padding()? != Padding::default(),
            pixel: coarse.fits(self.subject.display)
                && self.subject.display.height.min(self.subject.display.width) >= 4,
        })
    }

    /// Milliseconds of a unit of work, from a few steps that nobody looks at: the first solve plans its transforms and
    /// compiles its kernels.
    fn warm_up(&mut self) -> Result<f64, Failure> {
        let recipe = Settings { steps: 3, window: WindowFactor::Two, ..Settings::default() };
        let mut go = || self.subject.solve(&recipe, self.engine, &mut |_| Flow::Continue);
        go()?;
        let solved = go()?;
        Ok(solved.milliseconds / self.subject.cost(&recipe, self.engine.memory())?.work())
    }

    /// The median over all trials.
    fn rate(&self, trials: &[Trial]) -> Result<f64, Failure> {
        let mut rates = Vec::new();
        for t in trials {
            rates.push(t.milliseconds / self.subject.cost(&t.recipe, self.engine.memory())?.work());
        }
        rates.sort_by(f64::total_cmp);
        Ok(rates[rates.len() / 2])
    }

    /// Solves a recipe; nothing where it was interrupted, or takes far longer than it may (milliseconds).
    fn solve(&mut self, recipe: &Settings, longest: f64, clock: &Clock) -> Result<Option<Solved>, Failure> {
        let (start, mut late) = (Instant::now(), false);
        let solved = self.subject.solve(recipe, self.engine, &mut |_| {
            clock.spent();
            late |= start.elapsed().as_secs_f64() * 1e3 > PATIENCE * longest;
            if late || progress::interrupted() { Flow::Stop } else { Flow::Continue }
        })?;
        Ok((!late && !progress::interrupted()).then_some(solved))
    }

    /// Measures a recipe: its time, of short ones several times, and once its quality, which the same seed gives again.
    fn trial(
        &mut self,
        recipe: &Settings,
        longest: f64,
        reference: &Reference,
        clock: &Clock,
        state: &mut State,
    ) -> Result<(), Failure> {
        clock.bar.say(&format!("trial {}: {recipe}", state.trials.len() + 1));
        let Some(solved) = self.solve(recipe, longest, clock)? else { return Ok(()) };
        let score = self.score(&solved, reference)?;
        let bytes = self.subject.cost(recipe, self.engine.memory())?.bytes();
        let mut trial = Trial::new(recipe.clone(), solved.milliseconds, score.psnr, bytes);
        let more = match solved.milliseconds {
            ms if ms < 400.0 => 2,
            ms if ms < 1000.0 => 1,
            _ => 0,
        };
        for _ in 0..more {
            let Some(again) = self.solve(recipe, longest, clock)? else { break };
            trial.timed(again.milliseconds);
        }
        if trial.is_sound() {
            state.trials.push(trial);
            state.spent_s = clock.spent();
            self.keep.save("trials", &self.made_by, state)?;
        }
        Ok(())
    }

    /// Only the sub-frames that differ: the others repeat them.
    fn score(&mut self, solved: &Solved, reference: &Reference) -> Result<ValidationScore, Failure> {
        let pixels = self.subject.display.height * self.subject.display.width;
        Ok(reference.score(&solved.solution.phases[..solved.frames * pixels], self.engine)?)
    }

    /// Levels after the fact, and optimised for.
    fn levels(&mut self, mut reference: Reference, clock: &Clock, state: &mut State) -> Result<(), Failure> {
        let mut wanted: Vec<Vec<f64>> = COMPARED.map(even_levels).to_vec();
        if let Some(own) = self.subject.levels.given().filter(|l| l.len() < 256) {
            wanted.retain(|l| l.len() != own.len());
            wanted.push(own.to_vec());
        }
        wanted.sort_by_key(Vec::len);
        // Balanced where there is time for it, else the default, as long as they took.
        let time = |t: &Trial| t.milliseconds * (wanted.len() + 1) as f64 * 1e-3;
        let left = LEVELS * self.budget - clock.spent();
        let balanced = recommend(&state.trials).map(|r| r[Quality::Balanced as usize].trial.clone());
        let default = state.trials.iter().find(|t| t.recipe == Settings::default()).cloned();
        let chosen = balanced.into_iter().chain(default).find(|t| time(t) < left);
        let Some(recipe) = chosen.filter(|_| state.levels.is_empty() && !progress::interrupted()) else {
            return Ok(());
        };
        let recipe = Settings { levels: Levels::Any, ..recipe.recipe };
        clock.bar.say("levels of the SLM");
        let Some(free) = self.solve(&recipe, f64::INFINITY, clock)? else { return Ok(()) };
        reference = reference.with_levels(Levels::Any);
        let two = |v: ValidationScore| [v.mean(), v.worst()];
        let without = two(self.score(&free, &reference)?);
        let mut rows = Vec::new();
        for levels in wanted {
            reference = reference.with_levels(Levels::Given(levels.clone()));
            let after = two(self.score(&free, &reference)?);
            let before = std::mem::replace(&mut self.subject.levels, Levels::Given(levels.clone()));
            let solved = self.solve(&Settings { levels: Levels::Display, ..recipe.clone() }, f64::INFINITY, clock);
            self.subject.levels = before;
            let Some(solved) = solved? else { break };
            let optimised = two(self.score(&solved, &reference)?);
            let milliseconds = [free.milliseconds, solved.milliseconds];
            rows.push(LevelRow { levels: levels.len(), free: without, after, optimised, milliseconds });
        }
        (state.levels, state.levels_recipe) = (rows, recipe.to_string());
        Ok(())
    }

    /// What is recommended is timed again, until chance has no part in it or the budget ends.
    fn time_again(&mut self, clock: &Clock, state: &mut State) -> Result<(), Failure> {
        loop {
            let Some(three) = recommend(&state.trials) else { return Ok(()) };
            let left = 1e3 * (ALL * self.budget - clock.spent());
            let enough = |t: &Trial| if t.milliseconds < 10_000.0 { 3 } else { 2 };
            let next = three.iter().map(|r| &r.trial).find(|t| t.times.len() < enough(t) && t.milliseconds < left);
            let Some(recipe) = next.map(|t| t.recipe.clone()).filter(|_| !progress::interrupted()) else {
                return Ok(());
            };
            clock.bar.say(&format!("once more: {recipe}"));
            let Some(solved) = self.solve(&recipe, f64::INFINITY, clock)? else { return Ok(()) };
            if let Some(trial) = state.trials.iter_mut().find(|t| t.recipe == recipe) {
                trial.timed(solved.milliseconds);
            }
            state.spent_s = clock.spent();
            self.keep.save("trials", &self.made_by, state)?;
        }
    }
}
