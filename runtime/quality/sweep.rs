//! What to try next: not a grid, for nobody has time for one.
//!
//! First the default, then a spine of more and more steps that draws the front's outline: at its end as many steps as a
//! trial has time for, and about a fifth and a twentieth of them, where `balanced` and `fast` will be looked for. Then each
//! setting changed alone around the default, and points of a low-discrepancy sequence (Halton's, shifted by the seed). At last the front itself is refined: neighbours, one or two settings
//! away, of the trials that would be recommended, and of those beside the front's widest gaps.

use super::{Quality, Trial, front, recommend};
use crate::optics::WindowFactor;
use crate::plan::Storage;
use crate::solve::{Diameters, Levels, Optimizer, PaddingRule, Settings, SplitMix};
use std::collections::VecDeque;

/// What there is to choose from.
#[derive(Debug, Clone, Copy)]
pub struct Space {
    /// Sub-frames shown.
    pub frames: usize,
    /// Rows and columns of views.
    pub views: [usize; 2],
    /// Whether the engine saves anything by storing fields as halves.
    pub halves: bool,
    /// Whether the SLM's levels can be optimised for.
    pub levels: bool,
    /// Whether the scene asks for padding.
    pub padding: bool,
    /// Whether the SLM can be solved at half its resolution.
    pub pixel: bool,
}

const STEPS: [usize; 25] =
    [1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64, 96, 128, 192, 256, 384, 512, 768, 1024, 1536, 2048, 3072, 4096, 8192];
const PUPILS: [usize; 12] = [1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64];
const WINDOWS: [WindowFactor; 3] = [WindowFactor::One, WindowFactor::Two, WindowFactor::Full];
const DIAMETERS: [Diameters; 3] = [Diameters::Uniform, Diameters::LogUniform, Diameters::Reciprocal];
/// Points of the sequence.
const POINTS: usize = 12;
/// Tries to find a neighbour that was not tried.
const TRIES: usize = 200;

/// Parts of the longest trial's steps that are tried too: a little less than what balanced and fast may take.
const PARTS: [f64; 4] = [0.185, 0.045, 0.15, 0.035];

/// What is decided beforehand.
enum Item {
    This(Box<Settings>),
    /// The spine with as many steps as there is time for.
    Longest,
    /// The spine with so many of the longest trial's steps.
    Part(f64),
}

/// Decides what to try next. The same trials and the same seed give the same next.
pub struct Sweep {
    space: Space,
    queue: VecDeque<Item>,
    random: SplitMix,
}

impl Sweep {
    /// From the start.
    pub fn new(space: Space, seed: u64) -> Self {
        let mut sweep = Self { space, queue: VecDeque::new(), random: SplitMix(seed ^ 0x0073_7765_6570) };
        sweep.queue.push_back(Item::This(Box::default()));
        sweep.queue.extend([8, 24, 64, 128].map(|steps| Item::This(Box::new(spine(steps, WindowFactor::One)))));
        sweep.queue.extend([16, 32, 64, 128, 256].map(|steps| Item::This(Box::new(spine(steps, WindowFactor::Two)))));
        sweep.queue.push_back(Item::Longest);
        sweep.queue.extend(PARTS.map(Item::Part));
        sweep.queue.push_back(Item::This(Box::new(Settings::adam(200, 8))));
        let alone = sweep.alone();
        sweep.queue.extend(alone.into_iter().map(|s| Item::This(Box::new(s))));
        let shift: [f64; 5] = [0; 5].map(|_| sweep.random.unit());
        for i in 1..=POINTS {
            let point: [f64; 5] = std::array::from_fn(|d| (halton(i, [2, 3, 5, 7, 11][d]) + shift[d]).fract());
            let recipe = sweep.at(point);
            sweep.queue.push_back(Item::This(Box::new(recipe)));
        }
        sweep
    }

    /// The recipe at a point of the unit cube (steps, pupils, window, views, optimiser).
    fn at(&self, [steps, pupils, window, views, optimizer]: [f64; 5]) -> Settings {
        let log = |u: f64, from: f64, to: f64| (from * (to / from).powf(u)).round() as usize;
        Settings {
            steps: log(steps, 6.0, 200.0),
            pupils: log(pupils, 4.0, 24.0),
            window: if window < 0.5 { WindowFactor::One } else { WindowFactor::Two },
            views: if views < 0.7 { 1 } else { self.space.thinnest().min(2) },
            optimizer: if optimizer < 0.4 { Optimizer::projection() } else { Optimizer::momentum() },
            ..Settings::default()
        }
    }

    /// What is to be tried next, which is expected (`expect`, milliseconds) to take at most `longest`; nothing where
    /// nothing is left that fits.
    pub fn next(&mut self, trials: &[Trial], longest: f64, expect: &dyn Fn(&Settings) -> f64) -> Option<Settings> {
        let fresh = |recipe: &Settings| !trials.iter().any(|t| t.recipe == *recipe) && expect(recipe) <= longest;
        let dearest = trials.iter().max_by(|a, b| a.milliseconds.total_cmp(&b.milliseconds));
        while let Some(item) = self.queue.pop_front() {
            let recipe = match item {
                Item::This(recipe) => Some(*recipe),
                // One that went on where it was has been there.
                Item::Longest if dearest.is_some_and(|t| t.milliseconds > 0.5 * longest) => None,
                Item::Longest => STEPS.iter().rev().map(|n| spine(*n, WindowFactor::Two)).find(&fresh),
                Item::Part(part) => dearest.map(|t| {
                    let steps = (t.recipe.steps as f64 * part).round() as usize;
                    Settings { steps: steps.max(1), ..t.recipe.clone() }
                }),
            };
            if let Some(recipe) = recipe.filter(&fresh) {
                return Some(recipe);
            }
        }
        (0..TRIES).find_map(|i| {
            // Dear ones rarely, for many cheap ones have the same price; at last, whatever there is.
            let most = if 2 * i < TRIES { longest * self.random.unit().powi(3) } else { longest };
            let around = self.around(trials)?;
            let mut all = self.neighbours(&around);
            let mut next = self.pick(&mut all)?;
            if self.random.unit() < 0.4 {
                let mut more = self.neighbours(&next);
                next = self.pick(&mut more)?;
            }
            (fresh(&next) && expect(&next) <= most).then_some(next)
        })
    }

    /// The trial whose neighbourhood is worth a look.
    fn around(&mut self, trials: &[Trial]) -> Option<Settings> {
        let front = front(trials, |t| t.milliseconds, |t| t.mean);
        let recommended = recommend(trials)?;
        let place = |q: Quality| {
            let wanted = &recommended[q as usize].trial.recipe;
            front.iter().position(|t| t.recipe == *wanted).unwrap_or(0)
        };
        let u = self.random.unit();
        let at = match () {
            _ if u < 0.35 => place(Quality::Balanced),
            _ if u < 0.65 => place(Quality::Fast),
            _ if u < 0.75 => place(Quality::Accurate),
            _ => {
                // The widest gap, an octave of time counting as a decibel.
                let gap = |i: usize| {
                    let (a, b) = (front[i], front[i + 1]);
                    (b.milliseconds / a.milliseconds).log2() + (b.mean - a.mean)
                };
                (0..front.len().saturating_sub(1)).max_by(|&i, &j| gap(i).total_cmp(&gap(j))).unwrap_or(0)
            }
        };
        // Or its neighbour on the front: what is better there may beat it.
        let beside = [at.saturating_sub(1), at, at + 1][(3.0 * self.random.unit()) as usize % 3];
        front.get(beside).or(front.get(at)).map(|t| t.recipe.clone())
    }

    fn pick(&mut self, all: &mut Vec<Settings>) -> Option<Settings> {
        if all.is_empty() {
            return None;
        }
        let i = (self.random.unit() * all.len() as f64) as usize;
        Some(all.swap_remove(i.min(all.len() - 1)))
    }

    /// Each setting alone, well away from the default; steps are what the spine is about.
    fn alone(&self) -> Vec<Settings> {
        let start = Settings::default();
        let with = |change: &dyn Fn(&mut Settings)| {
            let mut to = start.clone();
            change(&mut to);
            to
        };
        let mut all = vec![
            with(&|r| r.window = WindowFactor::Two),
            with(&|r| r.pupils /= 2),
            with(&|r| r.pupils *= 2),
            with(&|r| r.optimizer = Optimizer::momentum()),
            with(&|r| r.diameters = Diameters::Uniform),
            with(&|r| r.diameters = Diameters::Reciprocal),
        ];
        // What takes something away from the problem, and what adds to it, as far as there is something.
        let thins = |views: &usize| Settings { views: *views, ..start.clone() }.thinned(self.space.views).0 == *views;
        let views = (2..=self.space.thinnest().min(3)).filter(thins);
        all.extend(views.map(|views| with(&|r| r.views = views)));
        let may = [
            (self.space.frames.is_multiple_of(2), with(&|r| r.repeats = 2)),
            (self.space.padding, with(&|r| r.padding = PaddingRule::Always)),
            (self.space.halves, with(&|r| r.storage = Storage::F16)),
            (self.space.levels, with(&|r| r.levels = Levels::Display)),
            (self.space.pixel, with(&|r| r.pixel = 2)),
            (true, with(&|r| r.window = WindowFactor::Full)),
        ];
        all.extend(may.into_iter().filter(|m| m.0).map(|m| m.1));
        all
    }

    /// Everything one setting away.
    fn neighbours(&self, from: &Settings) -> Vec<Settings> {
        let mut all = Vec::new();
        let mut with = |change: &dyn Fn(&mut Settings)| {
            let mut to = from.clone();
            change(&mut to);
            if to != *from && to.is_sound() {
                all.push(to);
            }
        };
        for steps in beside(&STEPS, from.steps) {
            with(&|r| r.steps = steps);
        }
        // Between the marks too: the front is steep at its fast end.
        for part in [0.85, 1.18] {
            with(&|r| r.steps = (r.steps as f64 * part).round() as usize);
        }
        for pupils in beside(&PUPILS, from.pupils) {
            with(&|r| r.pupils = pupils);
            // As much work, otherwise shared out.
            with(&|r| {
                r.steps = (r.steps as f64 * r.pupils as f64 / pupils as f64).round() as usize;
                r.pupils = pupils;
            });
        }
        for window in WINDOWS {
            with(&|r| r.window = window);
        }
        if matches!(from.optimizer, Optimizer::Projection { .. }) {
            for optimizer in [Optimizer::projection(), Optimizer::momentum()] {
                with(&|r| r.optimizer = optimizer);
            }
        }
        for diameters in DIAMETERS {
            with(&|r| r.diameters = diameters);
        }
        for repeats in [from.repeats / 2, from.repeats * 2] {
            if repeats >= 1 && self.space.frames.is_multiple_of(repeats) {
                with(&|r| r.repeats = repeats);
            }
        }
        for views in [from.views - 1, from.views + 1] {
            let thin = Settings { views, ..Settings::default() };
            if views >= 1 && thin.thinned(self.space.views).0 == views && views <= self.space.thinnest() {
                with(&|r| r.views = views);
            }
        }
        if self.space.halves {
            for storage in Storage::ALL {
                with(&|r| r.storage = storage);
            }
        }
        if self.space.levels {
            with(&|r| r.levels = if r.levels == Levels::Any { Levels::Display } else { Levels::Any });
        }
        if self.space.padding {
            with(&|r| {
                r.padding = if r.padding == PaddingRule::Never { PaddingRule::Always } else { PaddingRule::Never }
            });
        }
        if self.space.pixel {
            with(&|r| r.pixel = 3 - r.pixel);
        }
        all
    }
}

impl Space {
    /// The largest step between views that leaves at least 2 along an axis.
    fn thinnest(&self) -> usize {
        let most = self.views[0].max(self.views[1]);
        let leaves = |n: &usize| {
            let (every, [[_, rows], [_, columns]]) = Settings { views: *n, ..Settings::default() }.thinned(self.views);
            every == *n && rows.max(columns) >= 2
        };
        (1..=most.min(8)).rev().find(leaves).unwrap_or(1)
    }
}

/// So many steps of 16 pupils.
fn spine(steps: usize, window: WindowFactor) -> Settings {
    Settings { steps, window, optimizer: Optimizer::momentum(), ..Settings::default() }
}

/// The marks next to a value, on both sides.
fn beside(marks: &[usize], value: usize) -> impl Iterator<Item = usize> {
    let below = marks.iter().rfind(|m| **m < value).copied();
    let above = marks.iter().find(|m| **m > value).copied();
    below.into_iter().chain(above)
}

/// The `i`-th point of van der Corput's sequence in a base: coordinates of Halton's.
fn halton(mut i: usize, base: usize) -> f64 {
    let (mut x, mut digit) = (0.0, 1.0 / base as f64);
    while i > 0 {
        x += (i % base) as f64 * digit;
        i /= base;
        digit /= base as f64;
    }
    x
}

#[cfg(test)]
mod tests {
    use super::*;

    const SPACE: Space = Space { frames: 8, views: [9, 9], halves: true, levels: true, padding: true, pixel: true };

    /// A machine of which all is known: time is work, quality has diminishing returns.
    fn measure(recipe: &Settings) -> Trial {
        let window = match recipe.window {
            WindowFactor::One => 1.0,
            WindowFactor::Two => 2.5,
            WindowFactor::Full => 8.0,
        };
        let ms = 40.0 + recipe.steps as f64 * (2.0 + 0.4 * recipe.pupils as f64 * window) / recipe.repeats as f64;
        let seen = (recipe.steps * recipe.pupils) as f64;
        let mut db = 31.0 - 60.0 / seen.powf(0.7) + if recipe.window == WindowFactor::One { -1.0 } else { 0.0 };
        db -= 3.0 * (recipe.repeats as f64).log2()
            + 0.5 * (recipe.views as f64 - 1.0)
            + 8.0 * (recipe.pixel as f64 - 1.0);
        Trial::new(recipe.clone(), ms, vec![db], 1)
    }

    fn run(seed: u64, count: usize, longest: f64) -> Vec<Trial> {
        let mut sweep = Sweep::new(SPACE, seed);
        let mut trials: Vec<Trial> = Vec::new();
        while trials.len() < count {
            let expect = |r: &Settings| measure(r).milliseconds;
            let Some(recipe) = sweep.next(&trials, longest, &expect) else { break };
            assert!(recipe.is_sound() && expect(&recipe) <= longest, "{recipe:?}");
            assert!(trials.iter().all(|t| t.recipe != recipe), "{recipe:?} twice");
            trials.push(measure(&recipe));
        }
        trials
    }

    #[test]
    fn nothing_is_tried_twice_and_every_setting_is_tried() {
        let trials = run(0, 120, 20_000.0);
        assert_eq!(trials.len(), 120);
        let any = |f: &dyn Fn(&Settings) -> bool| trials.iter().any(|t| f(&t.recipe));
        assert!(
            any(&|r| r.views > 1)
                && any(&|r| r.repeats > 1)
                && any(&|r| r.pixel > 1)
                && any(&|r| r.padding == PaddingRule::Always)
        );
        assert!(
            any(&|r| r.levels == Levels::Display)
                && any(&|r| r.storage == Storage::F16)
                && any(&|r| r.window == WindowFactor::Full)
                && any(&|r| r.steps >= 512)
        );
        assert!(any(&|r| matches!(r.optimizer, Optimizer::Adam { .. })) && any(&|r| r.steps <= 8));
        assert_eq!(run(0, 120, 20_000.0), trials, "the same seed, the same trials");
        assert_ne!(run(1, 120, 20_000.0), trials);
    }

    #[test]
    fn refinement_finds_what_the_start_did_not() {
        // Twice as many trials bring the three closer to what twenty times as many would find.
        let (early, late, far) = (run(3, 45, 9000.0), run(3, 110, 9000.0), run(4, 900, 9000.0));
        let short = |some: &[Trial]| {
            let three = recommend(some).unwrap();
            three.map(|r| super::super::short_of(&far, r.trial.milliseconds, r.trial.mean))
        };
        let (before, after) = (short(&early), short(&late));
        assert!(after.iter().sum::<f64>() <= before.iter().sum::<f64>() + 1e-9, "{before:?} {after:?}");
        assert!(after.iter().all(|db| *db < 0.3), "{after:?}");
        assert!(recommend(&late).unwrap().iter().all(|r| r.met));
    }

    #[test]
    fn small_spaces_are_searched_to_their_end() {
        let space = Space { frames: 1, views: [1, 1], halves: false, levels: false, padding: false, pixel: false };
        let mut sweep = Sweep::new(space, 0);
        // Nothing takes so little.
        assert_eq!(sweep.next(&[], 0.0, &|_| 1.0), None);
        let mut sweep = Sweep::new(space, 0);
        let mut trials = Vec::new();
        while let Some(recipe) = sweep.next(&trials, 45.0, &|r| measure(r).milliseconds) {
            assert!(
                recipe.repeats == 1
                    && recipe.views == 1
                    && recipe.pixel == 1
                    && recipe.padding == PaddingRule::Never
                    && recipe.levels == Levels::Any
            );
            trials.push(measure(&recipe));
            assert!(trials.len() < 5000);
        }
    }

    #[test]
    fn haltons_sequence() {
        let x: Vec<f64> = (1..6).map(|i| halton(i, 2)).collect();
        assert_eq!(x, [0.5, 0.25, 0.75, 0.125, 0.625]);
        assert!((halton(5, 3) - (2.0 / 3.0 + 1.0 / 9.0)).abs() < 1e-12);
        assert_eq!(beside(&[1, 2, 4], 2).collect::<Vec<_>>(), [1, 4]);
        assert_eq!(beside(&[1, 2, 4], 4).collect::<Vec<_>>(), [2]);
    }
}
