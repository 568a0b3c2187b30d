//! What a solve takes, before anything runs: work and bytes, counted from the very steps that it would take.

use super::optimizer::Optimizer;
use super::problem::Problem;
use super::rates::Rates;
use super::run::{PUPILS, interval};
use super::settings::Settings;
use super::step::Steps;
use super::viewpoints::Viewpoints;
use crate::engine::Memory;
use crate::optics::{DisplayModel, WindowFactor};
use crate::plan::{self, Comparison, Group, Planner, Slots};
use serde::Serialize;

/// What the terms of the display's model add to a step's work: each by itself, and all of them (`"all"`), as shares of the step
/// of an ideal display. None where the display is ideal.
pub fn model_work(problem: &Problem, settings: &Settings) -> Vec<(&'static str, f64)> {
    let Some(tables) = &problem.model else { return Vec::new() };
    let model = tables.model();
    let step = |model: DisplayModel| {
        let model = tables.with_model(model);
        let cost = Cost::new(&Problem { model, ..problem.clone() }, settings, Memory::Host, settings.pupils);
        cost.step.iter().sum::<f64>()
    };
    let ideal = step(DisplayModel::default());
    let share = |model| step(model) / ideal - 1.0;
    let each = model.terms().into_iter().map(|term| (term, share(model.only(term))));
    each.chain([("all", share(model.clone()))]).collect()
}

/// What one colour takes.
#[derive(Debug, Clone, PartialEq)]
pub struct Cost {
    /// Work of a step, on average, in the order of [`Group::ALL`]; a unit is about a nanosecond of one core.
    pub step: [f64; Group::ALL.len()],
    /// Work beside the steps: the views' pyramid, and validation.
    pub beside: f64,
    /// Steps.
    pub steps: usize,
    /// What memory goes to, bytes: the peak is their sum.
    pub memory: Vec<(&'static str, u64)>,
    /// Smallest and largest window, points along the longer axis; zeros where no step is taken.
    pub windows: [usize; 2],
}

/// Staging between host and device, and what a Vulkan driver keeps to compile kernels, bytes (measured on a software
/// device).
const STAGING: u64 = 112 << 20;
/// Work for a pixel of a view, from light to all levels of its pyramid.
const PIXEL_OF_A_VIEW: f64 = 1.0;

impl Cost {
    /// Of a solve on an engine whose buffers lie in `memory`, from its first steps, until they have drawn so many pupils:
    /// pupils repeat themselves. Nothing runs, and an [outline](Problem::outline) will do.
    pub fn new(problem: &Problem, settings: &Settings, memory: Memory, pupils: usize) -> Self {
        let settings = settings.as_computed();
        let planner = problem.planner_of(&settings);
        let purpose = settings.optimizer.purpose();
        let shape = planner.shape(purpose);
        // On the host, halves are rounded to and not stored.
        let complex = if memory == Memory::Host { 8 } else { settings.storage.bytes() as u64 };
        let steps = if settings.method.is_iterative() { settings.steps } else { 0 };
        let seen = steps.min(pupils.div_ceil(settings.pupils.max(1)));
        let (mut slots, mut step, mut windows) = (Slots::default(), [0.0; Group::ALL.len()], Vec::new());
        let mut schedule = Steps::new(problem, &planner, &settings, 1.0, memory);
        for _ in 0..seen {
            let next = schedule.next(0.0);
            slots.see(&next, settings.frames, complex);
            for (sum, work) in step.iter_mut().zip(plan::work(&next, &shape)) {
                *sum += work / seen as f64;
            }
            windows.extend(next.pupil_passes.iter().map(|l| l.window.rows.max(l.window.columns)));
        }
        // Validation looks through one whole spectrum at a time.
        let whole = Planner { factor: WindowFactor::Full, ..planner.clone() };
        let mut viewpoints = Viewpoints::new(problem, &settings, settings.seed);
        let looks: Vec<_> = (0..PUPILS).map(|_| whole.viewpoint(&viewpoints.draw(), &Comparison::default())).collect();
        let look = plan::pupil_pass_bytes(&looks[0], settings.frames, complex);
        let validation = plan::work(&whole.exposure_step(looks), &shape).iter().sum::<f64>();
        let times = 1 + steps / interval(steps, settings.psnr.is_some());
        let pyramid = problem.pyramid.bytes() as u64;
        let beside = validation * times as f64 + PIXEL_OF_A_VIEW * (problem.pyramid.count * shape.points()) as f64;

        let mut parts = vec![("views", pyramid)];
        if memory == Memory::Shared {
            parts.push(("views on the device", pyramid));
        }
        if memory != Memory::Device {
            parts.push(("buffers", plan::shared_bytes(&shape, complex)));
            parts.push(("windows", slots.bytes_with(look)));
        }
        // The best so far, and the next while it is read.
        parts.push(("results", 2 * 4 * (shape.pixels() * settings.frames) as u64));
        let windows = [windows.iter().min(), windows.iter().max()].map(|n| n.copied().unwrap_or(0));
        Self { step, beside, steps, memory: parts, windows }
    }

    /// Work in all.
    pub fn work(&self) -> f64 {
        self.steps as f64 * self.step.iter().sum::<f64>() + self.beside
    }

    /// Bytes of all parts.
    pub fn bytes(&self) -> u64 {
        self.memory.iter().map(|m| m.1).sum()
    }
}

/// What one colour of a solve will take.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Forecast {
    /// Seconds of a step, on average.
    pub step_seconds: f64,
    /// The same per group of kernels, in the order of [`Group::ALL`].
    pub group_seconds: [f64; Group::ALL.len()],
    /// What memory goes to when most is held, bytes: the peak is their sum.
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
    /// Bytes of the program at most while it loaded the scene; 0 where the system does not say. Views may be larger as
    /// they are read than as they are solved.
    pub loading: u64,
    /// Where the engine's buffers lie.
    pub memory: Memory,
    /// Colours solved before this one: their phases are kept, and the engine keeps the last one's views until it is given
    /// this one's.
    pub done: usize,
}

/// Pupils whose steps are looked at.
const SEEN: usize = 512;

/// Predicts a solve of one colour. Nothing runs, and an [outline](Problem::outline) will do.
pub fn forecast(problem: &Problem, settings: &Settings, rates: &Rates, loaded: Loaded) -> Forecast {
    let cost = Cost::new(problem, settings, loaded.memory, SEEN);
    let optimizer = settings.as_computed().optimizer;
    let grid = problem.padding.grid(problem.optics);
    let points = grid.height * grid.width;
    let rates = rates.at(matches!(optimizer, Optimizer::Adam { .. }), points as f64);
    let group_seconds: [f64; Group::ALL.len()] = std::array::from_fn(|i| cost.step[i] * rates[i]);
    let pyramid = problem.pyramid.bytes() as u64;
    let scene = [("program", loaded.program), ("scene", 4 * loaded.values as u64)];
    let phases = 4 * (problem.optics.height * problem.optics.width * settings.frames) as u64;
    let mut before = Vec::new();
    if loaded.memory != Memory::Host {
        before.push(("driver", STAGING));
    }
    if loaded.done > 0 {
        before.extend([("views before", pyramid), ("results before", loaded.done as u64 * phases)]);
    }
    let solving = [&scene[..], &before, &cost.memory].concat();
    // Views that are padded, or smaller than the image, are made as float32 before they are stored; no fields are held yet.
    let copies = grid != problem.optics || problem.share < 1.0;
    let copied = if copies { 4 * (problem.pyramid.count * points) as u64 } else { 0 };
    let preparing = [&scene[..], &before, &[("views", pyramid), ("views as they are made", copied)]].concat();
    let loading = vec![("program", loaded.program), ("loading", loaded.loading.saturating_sub(loaded.program))];
    let bytes = |parts: &Vec<(&str, u64)>| parts.iter().map(|p| p.1).sum::<u64>();
    let memory = [loading, preparing, solving].into_iter().max_by_key(bytes).unwrap_or_default();
    Forecast { step_seconds: group_seconds.iter().sum(), group_seconds, memory, windows: cost.windows }
}
