//! What a solve will take, before anything runs: seconds a step from rates that were measured on this machine, bytes from
//! the plan itself.

use super::method::Viewpoints;
use super::{Optimizer, Problem, Settings, random_phases};
use crate::engine::{Buffer, Engine, EngineError, Memory};
use crate::optics::{Display, Optics, WindowFactor};
use crate::plan::{self, Comparison, Group, Planner, Slots, Step, Storage};
use crate::scene::{Pyramid, ViewGrid};
use eyebox_kernels::compare;
use serde::{Deserialize, Serialize};
use std::ops::Range;
use std::sync::Arc;
use std::time::Instant;

/// Seconds per unit of work at one size of the grid.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Rate {
    /// Points of the grid.
    pub points: f64,
    /// Per group of kernels, in the order of [`Group::ALL`].
    pub seconds: [f64; Group::ALL.len()],
}

/// Rates of an engine on a machine, measured ([`Rates::measure`]).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Rates {
    /// With the projection, smallest grid first.
    pub project: Vec<Rate>,
    /// With Adam.
    pub adam: Vec<Rate>,
}

/// Sides of the square grids that are timed.
const SIDES: [usize; 4] = [128, 256, 512, 1024];
/// Timed steps of each, in groups and whole.
const ROUNDS: usize = 4;
/// A step that takes longer than this is the last to be timed, seconds.
const LONGEST: f64 = 0.6;
/// Staging between host and device, and what a Vulkan driver keeps to compile kernels, bytes (measured on a software
/// device).
const STAGING: u64 = 112 << 20;

impl Rates {
    /// Times steps of an ordinary solve (8 sub-frames, 16 pupils of 2 to 20 mm, 9 x 9 views) on `engine`, with fields
    /// stored so: one to three seconds on a CPU.
    ///
    /// # Errors
    /// Those of the engine.
    pub fn measure(engine: &mut dyn Engine, storage: Storage) -> Result<Self, EngineError> {
        let mut rates = Self { project: Vec::new(), adam: Vec::new() };
        for side in SIDES {
            let views = noise(side);
            let mut longest = 0.0f64;
            for (optimizer, rates) in
                [(Optimizer::projection(), &mut rates.project), (Optimizer::adam(), &mut rates.adam)]
            {
                let (rate, seconds) =
                    measure(engine, side, &views, Settings { optimizer, storage, ..Settings::default() })?;
                rates.push(rate);
                longest = longest.max(seconds);
            }
            if longest > LONGEST {
                break;
            }
        }
        Ok(rates)
    }

    /// Whether these can be rates: read from a file, they might be anything.
    pub fn is_sound(&self) -> bool {
        let sound = |rates: &Vec<Rate>| {
            !rates.is_empty()
                && rates.windows(2).all(|r| r[0].points < r[1].points)
                && rates.iter().all(|r| r.points >= 1.0 && r.seconds.iter().all(|s| s.is_finite() && *s >= 0.0))
        };
        sound(&self.project) && sound(&self.adam)
    }

    /// Seconds per unit of work on a grid of so many points: between measured sizes by their logarithm.
    fn at(&self, optimizer: &Optimizer, points: f64) -> [f64; Group::ALL.len()] {
        let rates = if matches!(optimizer, Optimizer::Adam { .. }) { &self.adam } else { &self.project };
        let above = rates.iter().position(|r| r.points >= points);
        let (low, high) = match above {
            Some(0) => (rates[0], rates[0]),
            Some(i) => (rates[i - 1], rates[i]),
            None => (rates[rates.len() - 1], rates[rates.len() - 1]),
        };
        let span = (high.points / low.points).ln();
        let share = if span > 0.0 { (points / low.points).ln() / span } else { 0.0 };
        std::array::from_fn(|i| low.seconds[i] + share * (high.seconds[i] - low.seconds[i]))
    }
}

/// Views of noise on the timed grid.
fn noise(side: usize) -> Arc<Pyramid> {
    let phases = random_phases(side * side, 1);
    let view: Vec<f32> = phases.iter().map(|p| p.abs()).collect();
    Arc::new(Pyramid::new(&vec![view; 81], side, side))
}

/// One size, one optimiser; also the seconds of a whole step.
fn measure(
    engine: &mut dyn Engine,
    side: usize,
    views: &Arc<Pyramid>,
    settings: Settings,
) -> Result<(Rate, f64), EngineError> {
    let display = Display::preset("paper").expect("a preset");
    let optics =
        Optics { height: side, width: side, ..display.optics(display.wavelengths[1].color).expect("a colour") };
    let eyebox = display.eyebox_min();
    let grid = ViewGrid { rows: 9, columns: 9, cell: eyebox / 9.0 };
    let problem = Problem {
        optics,
        padding: Default::default(),
        eyebox,
        views: grid,
        center: [0.0; 2],
        pyramid: Arc::clone(views),
        mean: 0.5,
        share: 1.0,
    };
    let planner =
        Planner { levels: 16, storage: settings.storage, ..problem.planner(settings.frames, settings.window) };
    let shape = planner.shape(settings.optimizer.purpose());
    engine.load(&shape, Some(Arc::clone(views)))?;
    engine.write(Buffer::Phases, &random_phases(settings.frames * side * side, 2))?;
    engine.write(Buffer::Levels, &super::settings::level_table(&super::even_levels(16)))?;
    let mut viewpoints = Viewpoints::new(&problem, &settings, 3);
    let mut best = [f64::INFINITY; Group::ALL.len()];
    for round in 0..=ROUNDS {
        let step = step(&planner, &settings, &mut viewpoints);
        let work = plan::work(&step, &shape);
        let mut seconds = [0.0; Group::ALL.len()];
        for (group, part) in parts(&step) {
            let start = Instant::now();
            engine.run_part(&step, part)?;
            seconds[group as usize] += start.elapsed().as_secs_f64();
        }
        // The first warms up: it makes buffers, plans and pipelines.
        if round > 0 {
            for ((best, seconds), work) in best.iter_mut().zip(seconds).zip(work) {
                *best = best.min(seconds / work.max(1.0));
            }
        }
    }
    // Groups that run by themselves wait for their slowest pupil each; in a step only the last one does. And a step is
    // what it is on average, not at its best.
    let (mut expected, mut taken) = (0.0, 0.0);
    for _ in 0..ROUNDS {
        let step = step(&planner, &settings, &mut viewpoints);
        expected += plan::work(&step, &shape).iter().zip(best).map(|(w, s)| w * s).sum::<f64>();
        let state = super::fault::before_state(&step);
        let start = Instant::now();
        engine.run_part(&step, 0..state)?;
        engine.run_part(&step, state..step.list.len())?;
        taken += start.elapsed().as_secs_f64();
    }
    let seconds = best.map(|s| s * taken / expected.max(1e-12));
    Ok((Rate { points: (side * side) as f64, seconds }, taken / ROUNDS as f64))
}

/// Runs of neighbouring kernels of one group.
fn parts(step: &Step) -> Vec<(Group, Range<usize>)> {
    let mut parts: Vec<(Group, Range<usize>)> = Vec::new();
    for (i, dispatch) in step.list.iter().enumerate() {
        let group = dispatch.kernel.group();
        match parts.last_mut() {
            Some((last, range)) if *last == group => range.end = i + 1,
            _ => parts.push((group, i..i + 1)),
        }
    }
    parts
}

/// A step as the solver would take it; what its numbers are does not change what it costs.
fn step(planner: &Planner, settings: &Settings, viewpoints: &mut Viewpoints) -> Step {
    let adam = matches!(settings.optimizer, Optimizer::Adam { .. });
    let mode = if adam { compare::INTENSITY } else { compare::PROJECTION };
    let comparison = Comparison { mode, batch: settings.pupils, ..Comparison::default() };
    let pupil_passes = (0..settings.pupils).map(|_| planner.viewpoint(&viewpoints.draw(), &comparison)).collect();
    let in_flight = settings.window_bytes / size_of::<eyebox_kernels::Complex32>();
    match settings.optimizer {
        Optimizer::Projection { overlap_power, .. } => {
            planner.project_step(pupil_passes, in_flight, overlap_power, 1.0, 0.5)
        }
        Optimizer::Adam { .. } => planner.adam_step(pupil_passes, in_flight, 1, 0.1),
    }
}

/// What one colour of a solve will take.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Forecast {
    /// Seconds of a step, on average.
    pub step_seconds: f64,
    /// The same per group of kernels, in the order of [`Group::ALL`].
    pub group_seconds: [f64; Group::ALL.len()],
    /// What memory goes to, bytes: the peak is their sum.
    pub memory: Vec<(&'static str, u64)>,
    /// Smallest and largest window, points along the longer axis.
    pub windows: [usize; 2],
}

impl Forecast {
    /// Peak of the process, bytes.
    pub fn peak_bytes(&self) -> u64 {
        self.memory.iter().map(|m| m.1).sum()
    }
}

/// What a scene has in memory beside the colour that is solved.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Loaded {
    /// Values of all its views in all loaded colours, as float32.
    pub values: usize,
    /// Bytes of the program with its engine open, before it loads anything: with a Vulkan driver, many times what it is
    /// without.
    pub program: u64,
    /// Where the engine's buffers lie.
    pub memory: Memory,
    /// Colours solved before this one: their phases are kept, and the engine keeps the last one's views until it is given
    /// this one's.
    pub done: usize,
}

/// Predicts a solve of one colour. Nothing runs, and no views are needed: `problem.pyramid` is looked at for nothing.
pub fn forecast(problem: &Problem, settings: &Settings, rates: &Rates, loaded: Loaded) -> Forecast {
    let grid = problem.padding.grid(problem.optics);
    let views = plan::Views::of_size(problem.views, grid.height, grid.width);
    let pyramid = views.bytes();
    let planner = Planner {
        views: Some(views),
        levels: settings.levels.as_ref().map_or(0, Vec::len),
        storage: settings.storage,
        ..Planner::new(problem.optics, settings.frames, settings.window).with_padding(problem.padding)
    };
    let shape = planner.shape(settings.optimizer.purpose());
    let mut viewpoints = Viewpoints::new(problem, settings, settings.seed);
    let rates = rates.at(&settings.optimizer, shape.points() as f64);
    // On the host, halves are rounded to and not stored.
    let complex = if loaded.memory == Memory::Host { 8 } else { settings.storage.bytes() as u64 };
    let mut slots = Slots::default();
    let mut group_seconds = [0.0; Group::ALL.len()];
    let mut windows = [usize::MAX, 0];
    // Pupils repeat themselves: so many show what all do.
    let steps = settings.steps.clamp(1, 1 + 512 / settings.pupils.max(1));
    for _ in 0..steps {
        let step = step(&planner, settings, &mut viewpoints);
        slots.see(&step, settings.frames, complex);
        let work = plan::work(&step, &shape);
        for ((sum, work), rate) in group_seconds.iter_mut().zip(work).zip(rates) {
            *sum += work * rate / steps as f64;
        }
        for side in step.pupil_passes.iter().map(|l| l.window.rows.max(l.window.columns)) {
            windows = [windows[0].min(side), windows[1].max(side)];
        }
    }
    // A verdict looks through one whole spectrum at a time.
    let whole = Planner { factor: WindowFactor::Full, ..planner.clone() };
    let one = whole.viewpoint(&viewpoints.draw(), &Comparison::default());
    let verdict = plan::pupil_pass_bytes(&one, settings.frames, complex);
    let phases = 4 * (shape.pixels() * settings.frames) as u64;
    let mut memory = vec![("program", loaded.program), ("scene", 4 * loaded.values as u64), ("views", pyramid)];
    if loaded.done > 0 {
        memory.push(("views before", pyramid));
    }
    if loaded.memory != Memory::Host {
        memory.push(("driver", STAGING));
    }
    if loaded.memory == Memory::Shared {
        memory.push(("views on the device", pyramid));
    }
    if loaded.memory != Memory::Device {
        memory.push(("buffers", plan::shared_bytes(&shape, complex)));
        memory.push(("windows", slots.bytes_with(verdict)));
    }
    // The best so far, the next while it is read, and colours that are done.
    memory.push(("results", (2 + loaded.done as u64) * phases));
    Forecast { step_seconds: group_seconds.iter().sum(), group_seconds, memory, windows }
}
