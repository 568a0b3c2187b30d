//! Predicts the work and the memory of a solve before it runs, from the steps that it would take.

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

/// Returns the work that each term of the display model adds to a step, and all terms together (`"all"`).
///
/// The values are shares of the step of an ideal display. The list is empty for an ideal display.
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

/// Work and memory of the solve of one color.
#[derive(Debug, Clone, PartialEq)]
pub struct Cost {
    /// Average work of a step, in the order of [`Group::ALL`]. A unit is about a nanosecond of one core.
    pub step: [f64; Group::ALL.len()],
    /// Work besides the steps, which is the pyramid of the views and validation.
    pub beside: f64,
    /// The number of steps.
    pub steps: usize,
    /// Bytes per use of memory. The peak is their sum.
    pub memory: Vec<(&'static str, u64)>,
    /// Smallest and largest window, in points along the longer axis. Both are 0 without steps.
    pub windows: [usize; 2],
}

/// Staging memory between host and device, and the memory that a Vulkan driver keeps to compile kernels, in bytes
/// (measured on a software device).
const STAGING: u64 = 112 << 20;
/// Work per pixel of a view, from light to all levels of its pyramid.
const PIXEL_OF_A_VIEW: f64 = 1.0;

impl Cost {
    /// Counts a solve on an engine whose buffers are in `memory`, from its first steps until they have drawn `pupils`
    /// pupils.
    ///
    /// More are not needed because pupils repeat. Nothing runs, and an [outline](Problem::outline) is enough.
    pub fn new(problem: &Problem, settings: &Settings, memory: Memory, pupils: usize) -> Self {
        let settings = settings.as_computed();
        let planner = problem.planner_of(&settings);
        let purpose = settings.optimizer.purpose();
        let shape = planner.shape(purpose);
        // On the host, values are rounded to halves but stored as float32.
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
        // Validation uses one whole spectrum at a time.
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
        // These are the current best result, and the next one while it is read.
        parts.push(("results", 2 * 4 * (shape.pixels() * settings.frames) as u64));
        let windows = [windows.iter().min(), windows.iter().max()].map(|n| n.copied().unwrap_or(0));
        Self { step, beside, steps, memory: parts, windows }
    }

    /// Returns the total work.
    pub fn work(&self) -> f64 {
        self.steps as f64 * self.step.iter().sum::<f64>() + self.beside
    }

    /// Returns the bytes of all parts.
    pub fn bytes(&self) -> u64 {
        self.memory.iter().map(|m| m.1).sum()
    }
}

/// Predicted time and memory of one color of a solve.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Forecast {
    /// Average seconds per step.
    pub step_seconds: f64,
    /// Average seconds per step and group of kernels, in the order of [`Group::ALL`].
    pub group_seconds: [f64; Group::ALL.len()],
    /// Bytes per use of memory at the time of the highest use. The peak is their sum.
    pub memory: Vec<(&'static str, u64)>,
    /// Smallest and largest window, in points along the longer axis.
    pub windows: [usize; 2],
}

impl Forecast {
    /// Returns the peak memory of the process, in bytes.
    pub fn peak_bytes(&self) -> u64 {
        self.memory.iter().map(|m| m.1).sum()
    }
}

/// Memory that a scene uses besides the color that is solved.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Loaded {
    /// Values of all its views in all loaded colors, as float32.
    pub values: usize,
    /// Bytes of the program with its engine open, before it loads anything. A Vulkan driver multiplies this number.
    pub program: u64,
    /// Peak bytes of the program while it loaded the scene. 0 if the system does not report it. Views can need more
    /// memory while they are read than while they are solved.
    pub loading: u64,
    /// Location of the engine's buffers.
    pub memory: Memory,
    /// Colors solved before this one. Their phases are kept, and the engine keeps the views of the last one until it
    /// receives the views of this one.
    pub done: usize,
}

/// Number of pupils whose steps the forecast counts.
const SEEN: usize = 512;

/// Predicts a solve of one color. Nothing runs, and an [outline](Problem::outline) is enough.
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
    // Views that are padded, or smaller than the image, are made as float32 before they are stored. No fields exist yet
    // at this point.
    let copies = grid != problem.optics || problem.share < 1.0;
    let copied = if copies { 4 * (problem.pyramid.count * points) as u64 } else { 0 };
    let preparing = [&scene[..], &before, &[("views", pyramid), ("views as they are made", copied)]].concat();
    let loading = vec![("program", loaded.program), ("loading", loaded.loading.saturating_sub(loaded.program))];
    let bytes = |parts: &Vec<(&str, u64)>| parts.iter().map(|p| p.1).sum::<u64>();
    let memory = [loading, preparing, solving].into_iter().max_by_key(bytes).unwrap_or_default();
    Forecast { step_seconds: group_seconds.iter().sum(), group_seconds, memory, windows: cost.windows }
}
