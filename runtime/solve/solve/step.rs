//! Builds and takes one step for a solve, its forecast, a refinement and a far field in tiles.

use super::method::Method;
use super::optimizer::{Optimizer, cosine};
use super::problem::Problem;
use super::settings::Settings;
use super::viewpoints::Viewpoints;
use crate::engine::{Buffer, Engine, EngineError, Memory, Step};
use crate::plan::{Comparison, Kernel, Planner, PupilPass, StepLists, Viewpoint};
use eyebox_kernels::{adam, compare, project};
use std::ops::Range;
use std::slice;

/// The way in which one step moves the phases.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Update {
    /// The pupil-wise projection (OPTICS 6b). It replaces every retinal amplitude by the target amplitude, as Gerchberg
    /// and Saxton do. It combines the changes of all pupils as in ptychography (ePIE, Maiden and Rodenburg 2009).
    Projection {
        /// Share of the way to the solution that the phases move.
        gain: f64,
        /// Share of the velocity that each step keeps.
        momentum: f64,
        /// Exponent of the number of overlapping pupils by which the change is divided.
        overlap_power: f64,
    },
    /// Adam (Kingma and Ba 2015) on the closed-form Wirtinger gradient (OPTICS 4).
    Adam {
        /// Learning rate in radians.
        rate: f64,
        /// Compares amplitudes instead of intensities.
        amplitude: bool,
        /// Number of the step since the moments were zero, from 1.
        step: usize,
    },
}

impl Update {
    /// Returns the mode of the kernel `compare` for the comparison of images with their targets.
    fn mode(self) -> u32 {
        match self {
            Self::Projection { .. } => compare::PROJECTION,
            Self::Adam { amplitude: true, .. } => compare::AMPLITUDE,
            Self::Adam { amplitude: false, .. } => compare::INTENSITY,
        }
    }

    /// Returns the pupil passes of these viewpoints, for a step over all of them.
    pub fn pupil_passes(self, planner: &Planner, viewpoints: &[Viewpoint], exposure: f64) -> Vec<PupilPass> {
        let mut passes = Vec::with_capacity(viewpoints.len());
        self.refill(planner, viewpoints, exposure, &mut passes, &mut Vec::new());
        passes
    }

    /// Refills finished pupil passes and their lists for these viewpoints. Excess passes move to `spare`, and missing
    /// ones are taken from there.
    pub(crate) fn refill(
        self,
        planner: &Planner,
        viewpoints: &[Viewpoint],
        exposure: f64,
        passes: &mut Vec<PupilPass>,
        spare: &mut Vec<PupilPass>,
    ) {
        let batch = viewpoints.len();
        let comparison = Comparison { mode: self.mode(), exposure, batch, ..Comparison::default() };
        spare.extend(passes.drain(batch.min(passes.len())..));
        while passes.len() < batch {
            passes.push(spare.pop().unwrap_or_else(PupilPass::empty));
        }
        for (pass, viewpoint) in passes.iter_mut().zip(viewpoints) {
            planner.look_through(pass, viewpoint, &comparison);
        }
    }

    /// Returns the step over these pupil passes, with `in_flight` values of windows at a time.
    pub fn step(self, planner: &Planner, lists: impl Into<StepLists>, in_flight: usize) -> Step {
        match self {
            Self::Projection { gain, momentum, overlap_power } => {
                planner.project_step(lists, in_flight, overlap_power, gain, momentum)
            }
            Self::Adam { rate, step, .. } => planner.adam_step(lists, in_flight, step, rate),
        }
    }
}

/// The sequence of the steps of a solve.
pub(super) struct Steps<'a> {
    problem: &'a Problem,
    planner: &'a Planner,
    settings: &'a Settings,
    exposure: f64,
    viewpoints: Viewpoints,
    /// Number of values of windows at a time.
    in_flight: usize,
    taken: usize,
    /// Steps since the moments were zero.
    since: usize,
    /// Factor on the length of steps.
    stride: f64,
}

/// Factor on the length of steps after each validation that finds no better state.
const SHORTER: f64 = 0.5;

impl<'a> Steps<'a> {
    /// Starts at the first step for this exposure, on an engine whose buffers are in `memory`.
    pub(super) fn new(
        problem: &'a Problem,
        planner: &'a Planner,
        settings: &'a Settings,
        exposure: f64,
        memory: Memory,
    ) -> Self {
        let viewpoints = Viewpoints::new(problem, settings, settings.seed);
        Self {
            problem,
            planner,
            settings,
            exposure,
            viewpoints,
            in_flight: settings.in_flight(memory),
            taken: 0,
            since: 0,
            stride: 1.0,
        }
    }

    /// Makes all device objects of the first `count` steps at once, so that none is made while steps are taken.
    ///
    /// Pupils repeat, so the first steps are enough for many.
    ///
    /// # Errors
    /// [`EngineError`] if the engine fails.
    pub(super) fn prepare(mut self, count: usize, engine: &mut dyn Engine) -> Result<(), EngineError> {
        const PUPILS: usize = 2048;
        if engine.memory() == Memory::Host {
            return Ok(());
        }
        let count = count.min(PUPILS.div_ceil(self.settings.pupils.max(1)));
        engine.prepare(&mut (0..count).map(|_| self.next(0.0)), None)
    }

    /// Shortens all further steps. The engine has set its moments to zero.
    pub(super) fn shorten(&mut self) {
        self.stride *= SHORTER;
        self.since = 0;
    }

    /// Returns the next step over the next viewpoints, at this position in the schedule (0 to 1).
    pub(super) fn next(&mut self, progress: f64) -> Step {
        let Self { settings, planner, .. } = *self;
        self.taken += 1;
        self.since += 1;
        let update = self.update(progress);
        let viewpoints: Vec<Viewpoint> = (0..settings.pupils).map(|_| self.viewpoints.draw()).collect();
        let pupil_passes = update.pupil_passes(planner, &viewpoints, self.exposure);
        let mut step = update.step(planner, pupil_passes, self.in_flight);
        // Levels are enforced gradually. If a phase jumps between levels from the start, it finds no good one.
        step.quantise.hardness = progress.powi(2) as f32;
        step.project.step = self.taken as u32;
        release_early(planner, progress, &mut step);
        if settings.method == Method::PupilAware {
            return planner.with_equalised_eyebox(step, self.problem.eyebox, settings.patches, settings.evenness);
        }
        step
    }

    fn update(&self, progress: f64) -> Update {
        let batch = self.settings.pupils;
        match self.settings.optimizer {
            Optimizer::Projection { gain, momentum, overlap_power } => {
                // A power of the overlap below one grows with the batch, so the strength with ten pupils is the unit
                // (OPTICS 6e).
                let share = (batch as f64 / 10.0).powf(1.0 - overlap_power);
                let overlap = self.viewpoints.overlap(batch).map_or(1.0, |n| n.powf(overlap_power));
                let (gain, momentum) = strides(self.planner, gain, momentum);
                let gain = self.stride * cosine(gain, progress) / (share * overlap);
                Update::Projection { gain, momentum, overlap_power }
            }
            Optimizer::Adam { rate, amplitude } => {
                Update::Adam { rate: self.stride * cosine(rate, progress), amplitude, step: self.since }
            }
        }
    }
}

/// Shares of the variance of random drive values that crosstalk leaves. Below the first one, phases are bounded from
/// the first step on. If the share is at least the second one, they are bounded only in the last part of the schedule,
/// from [`LAST_PART`] on.
const RELEASED: [f64; 2] = [0.55, 0.65];
const LAST_PART: f64 = 0.7;
/// Shares of the variance between which the first gain falls from [`LONGER`] times its usual size to the usual size.
/// The way back through strong crosstalk shortens turns. Under weaker crosstalk such strides diverge if the source is
/// uneven or light is undiffracted.
const LENGTHENED: [f64; 2] = [0.45, 0.6];
const LONGER: f64 = 1.6;
/// Least momentum with bounded phases.
const BOUND_MOMENTUM: f64 = 0.7;

/// Returns the position of the display's remaining variance under crosstalk between these two shares, 0 to 1.
fn weakness(planner: &Planner, [low, high]: [f64; 2]) -> f64 {
    ((planner.variance_left() - low) / (high - low)).clamp(0.0, 1.0)
}

/// Returns the gains of the first and last step and the momentum of the projection on this display.
pub fn strides(planner: &Planner, gain: [f64; 2], momentum: f64) -> ([f64; 2], f64) {
    if !planner.bounds_phases() {
        return (gain, momentum);
    }
    let longer = LONGER + (1.0 - LONGER) * weakness(planner, LENGTHENED);
    ([longer * gain[0], gain[1]], momentum.max(BOUND_MOMENTUM))
}

/// Lets the phases of a projection step wrap in the early part of the schedule, although the display's crosstalk bounds
/// them later.
///
/// If strides are long, a bounded phase is caught at an end of the range. If they are short, few phases try to cross
/// it, and each crossing puts light in the wrong place (docs/results/solver-and-model.json).
pub fn release_early(planner: &Planner, progress: f64, step: &mut Step) {
    if progress < LAST_PART * weakness(planner, RELEASED) {
        step.project.bound = 0.0;
    }
}

/// Takes a step, or these parts of its list in order, and returns its [loss](Step::mean_loss).
///
/// All losses are computed before phases may change. If the loss is not a finite number, the phases stay as they were.
///
/// # Errors
/// [`EngineError`] if the engine fails.
pub fn take(engine: &mut dyn Engine, step: &Step, parts: &[Range<usize>]) -> Result<f64, EngineError> {
    let begun = engine.begin_step(step, parts)?;
    Ok(step.mean_loss(&engine.end_step(begun)?.losses))
}

/// Takes a step whose intensities come from outside.
///
/// For each of its pupil passes, `see` receives the model's intensity on the window of the pass and the fields behind
/// it (sub-frame, row, column). It returns the measured intensity. The phase of the field still comes from the model.
/// The step holds all its pupil passes at once (one group). Everything else is as in `take`.
///
/// # Errors
/// The errors of `see`, and [`EngineError`] if the engine fails.
pub fn take_seen<E: From<EngineError>>(
    engine: &mut dyn Engine,
    step: &Step,
    mut see: impl FnMut(usize, &[f32], &[f32]) -> Result<Vec<f32>, E>,
) -> Result<f64, E> {
    let place = step.list.iter().position(|d| d.kernel == Kernel::Compare).unwrap_or(step.list.len());
    debug_assert!(step.list.get(place).is_none_or(|d| d.pupil_passes.len() == step.pupil_passes.len()), "one group");
    engine.run_part(step, 0..place)?;
    for slot in 0..step.pupil_passes.len() {
        let (image, fields) = (engine.read(Buffer::Image(slot))?, engine.read(Buffer::Window(slot))?);
        engine.write(Buffer::Image(slot), &see(slot, &image, &fields)?)?;
    }
    Ok(take(engine, step, slice::from_ref(&(place..step.list.len())))?)
}

/// Runs the step again, kernel by kernel, up to the change of phases, and returns the first kernel whose output is not
/// finite. The result is `None` if the phases themselves are not finite, or if no such kernel is found.
///
/// # Errors
/// [`EngineError`] if the engine fails.
pub(super) fn first_fault(engine: &mut dyn Engine, step: &Step) -> Result<Option<Kernel>, EngineError> {
    if !finite(&engine.read(Buffer::Phases)?) {
        return Ok(None);
    }
    for i in 0..step.before_update() {
        let dispatch = &step.list[i];
        let losses = engine.run_part(step, i..i + 1)?;
        if !losses.iter().all(|l| l.is_finite()) {
            return Ok(Some(dispatch.kernel));
        }
        for resource in dispatch.kernel.writes() {
            let slots = if resource.is_shared() { 1 } else { dispatch.pupil_passes.len() };
            for buffer in (0..slots).filter_map(|slot| resource.buffer(slot)) {
                if !finite(&engine.read(buffer)?) {
                    return Ok(Some(dispatch.kernel));
                }
            }
        }
    }
    Ok(None)
}

fn finite(values: &[f32]) -> bool {
    values.iter().all(|v| v.is_finite())
}

/// The data by which a step moves its phases, without its lists.
#[derive(Debug, Clone, Copy)]
pub(super) struct Turns {
    /// Gain and momentum of the projection, and the position of the SLM in the grid.
    pub(super) project: project::Args,
    pub(super) adam: adam::Args,
    /// True if the projection moves the phases.
    pub(super) projects: bool,
}

impl Turns {
    /// Copies the data of this step.
    pub(super) fn of(step: &Step) -> Self {
        let projects = step.list.last().is_some_and(|d| d.kernel == Kernel::Project);
        Self { project: step.project, adam: step.adam, projects }
    }
}

/// Runs these parts of a step's list in order, without the move of its phases, and reads the requested change of the
/// field.
///
/// It returns the loss. If the loss is not finite, the change is not read.
///
/// # Errors
/// [`EngineError`] if the engine fails.
pub(super) fn ask(
    engine: &mut dyn Engine,
    step: &Step,
    parts: &[Range<usize>],
    change: &mut [f32],
) -> Result<f64, EngineError> {
    let end = step.list.len().saturating_sub(1);
    let known = step.before_update().min(end);
    let mut losses = vec![0.0; step.pupil_passes.len()];
    for part in within(parts, 0..known) {
        let of_part = engine.run_part(step, part)?;
        losses.iter_mut().zip(&of_part).for_each(|(sum, loss)| *sum += loss);
        engine.recycle(of_part);
    }
    let loss = step.mean_loss(&losses);
    if loss.is_finite() {
        for part in within(parts, known..end) {
            let none = engine.run_part(step, part)?;
            engine.recycle(none);
        }
        engine.read_into(Buffer::Change, change)?;
    }
    Ok(loss)
}

/// Returns the parts clipped to a range.
fn within(parts: &[Range<usize>], range: Range<usize>) -> impl Iterator<Item = Range<usize>> {
    let cut = move |part: &Range<usize>| part.start.max(range.start)..part.end.min(range.end);
    parts.iter().map(cut).filter(|part| !part.is_empty())
}
