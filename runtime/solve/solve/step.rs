//! One step: how it is built and how it is taken, the same for a solve, its forecast, a refinement and a far field in
//! tiles.

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

/// How one step moves the phases.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Update {
    /// The pupil-wise projection (OPTICS 6b): every retinal amplitude is replaced by the wanted one, as Gerchberg and
    /// Saxton do, and the changes of all pupils are put together as in ptychography (ePIE, Maiden and Rodenburg 2009).
    Projection {
        /// Share of the way that the phases go.
        gain: f64,
        /// Share of the velocity that is kept.
        momentum: f64,
        /// The change is divided by the number of pupils that overlap to this power.
        overlap_power: f64,
    },
    /// Adam (Kingma and Ba 2015) on the closed-form Wirtinger gradient (OPTICS 4).
    Adam {
        /// Learning rate, radians.
        rate: f64,
        /// Compare amplitudes, not intensities.
        amplitude: bool,
        /// Which step since the moments were zero, from 1.
        step: usize,
    },
}

impl Update {
    /// How images are compared with their targets: a mode of the kernel `compare`.
    fn mode(self) -> u32 {
        match self {
            Self::Projection { .. } => compare::PROJECTION,
            Self::Adam { amplitude: true, .. } => compare::AMPLITUDE,
            Self::Adam { amplitude: false, .. } => compare::INTENSITY,
        }
    }

    /// What these viewpoints need in a step over all of them.
    pub fn pupil_passes(self, planner: &Planner, viewpoints: &[Viewpoint], exposure: f64) -> Vec<PupilPass> {
        let mut passes = Vec::with_capacity(viewpoints.len());
        self.refill(planner, viewpoints, exposure, &mut passes, &mut Vec::new());
        passes
    }

    /// Makes the same of pupil passes that are over, in the lists that they have: those that are too many become `spare`, and
    /// come back where they are too few.
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

    /// The step over these pupil passes, `in_flight` values of window at a time.
    pub fn step(self, planner: &Planner, lists: impl Into<StepLists>, in_flight: usize) -> Step {
        match self {
            Self::Projection { gain, momentum, overlap_power } => {
                planner.project_step(lists, in_flight, overlap_power, gain, momentum)
            }
            Self::Adam { rate, step, .. } => planner.adam_step(lists, in_flight, step, rate),
        }
    }
}

/// The steps of a solve, one after the other.
pub(super) struct Steps<'a> {
    problem: &'a Problem,
    planner: &'a Planner,
    settings: &'a Settings,
    exposure: f64,
    viewpoints: Viewpoints,
    /// Values of windows at a time.
    in_flight: usize,
    taken: usize,
    /// Steps since the moments were zero.
    since: usize,
    /// Factor on the length of steps.
    stride: f64,
}

/// Factor on the length of steps after each state that was worse than one before.
const SHORTER: f64 = 0.5;

impl<'a> Steps<'a> {
    /// From the first, for this exposure, on an engine whose buffers lie in `memory`.
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

    /// Makes what `count` steps from the first on ask a device for, all at once: nothing is made while they are taken. Pupils
    /// repeat themselves: of many steps the first will do.
    ///
    /// # Errors
    /// Those of the engine.
    pub(super) fn prepare(mut self, count: usize, engine: &mut dyn Engine) -> Result<(), EngineError> {
        const PUPILS: usize = 2048;
        if engine.memory() == Memory::Host {
            return Ok(());
        }
        let count = count.min(PUPILS.div_ceil(self.settings.pupils.max(1)));
        engine.prepare(&mut (0..count).map(|_| self.next(0.0)), None)
    }

    /// Steps are shorter from now on; the engine has made its moments zero.
    pub(super) fn shorten(&mut self) {
        self.stride *= SHORTER;
        self.since = 0;
    }

    /// The next step, over the next viewpoints, so far along the schedule (0 to 1).
    pub(super) fn next(&mut self, progress: f64) -> Step {
        let Self { settings, planner, .. } = *self;
        self.taken += 1;
        self.since += 1;
        let update = self.update(progress);
        let viewpoints: Vec<Viewpoint> = (0..settings.pupils).map(|_| self.viewpoints.draw()).collect();
        let pupil_passes = update.pupil_passes(planner, &viewpoints, self.exposure);
        let mut step = update.step(planner, pupil_passes, self.in_flight);
        // Levels come on softly: a phase that is thrown from level to level from the start finds no good one.
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
                // Overlap to a power below one grows with the batch: what ten pupils ask for is the unit (OPTICS 6e).
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

/// Shares of the variance of random drives that crosstalk leaves. Below the first, phases are bounded from the first step on. From
/// the second on they are bounded in the last part of the schedule only; it begins at [`LAST_PART`].
const RELEASED: [f64; 2] = [0.55, 0.65];
const LAST_PART: f64 = 0.7;
/// Shares of the variance between which the first gain falls from [`LONGER`] times as large to the ordinary one. The way back
/// through strong crosstalk shortens turns. Under weaker crosstalk such strides diverge if the source is uneven or light is
/// undiffracted.
const LENGTHENED: [f64; 2] = [0.45, 0.6];
const LONGER: f64 = 1.6;
/// Momentum under a bound, at least.
const BOUND_MOMENTUM: f64 = 0.7;

/// Where the share of the variance that the display's crosstalk leaves is between these two, 0 to 1.
fn weakness(planner: &Planner, [low, high]: [f64; 2]) -> f64 {
    ((planner.variance_left() - low) / (high - low)).clamp(0.0, 1.0)
}

/// Gain, first and last, and momentum of the projection on this display.
pub fn strides(planner: &Planner, gain: [f64; 2], momentum: f64) -> ([f64; 2], f64) {
    if !planner.bounds_phases() {
        return (gain, momentum);
    }
    let longer = LONGER + (1.0 - LONGER) * weakness(planner, LENGTHENED);
    ([longer * gain[0], gain[1]], momentum.max(BOUND_MOMENTUM))
}

/// Lets the phases of a projection step wrap in the early part of the schedule, although the display's crosstalk bounds them later.
/// While strides are long, a bounded phase is caught at an end of the range. While they are short, few phases try to cross it,
/// and each crossing puts light in the wrong place (docs/results/solver-and-model.json).
pub fn release_early(planner: &Planner, progress: f64, step: &mut Step) {
    if progress < LAST_PART * weakness(planner, RELEASED) {
        step.project.bound = 0.0;
    }
}

/// Takes a step, or these parts of its list, in order; its [loss](Step::mean_loss). All losses are known before phases may
/// change: with a loss that is not a finite number the phases stay as they were.
///
/// # Errors
/// Those of the engine.
pub fn take(engine: &mut dyn Engine, step: &Step, parts: &[Range<usize>]) -> Result<f64, EngineError> {
    let begun = engine.begin_step(step, parts)?;
    Ok(step.mean_loss(&engine.end_step(begun)?.losses))
}

/// Takes a step whose intensities come from outside: `see` is given, for each of its pupil passes, the model's intensity on the
/// pass's window and the fields behind it (sub-frame, row, column), and answers the intensity that is there. The field's phase
/// stays the model's. The step holds all its pupil passes at once (one group); the rest is as in `take`.
///
/// # Errors
/// Those of the engine and of `see`.
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

/// Runs the step again, kernel by kernel, up to where phases would change, and names the first whose output is not
/// finite. None if the phases are to blame themselves, or if nothing is found.
///
/// # Errors
/// Those of the engine.
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

/// How a step moves what it is taken for: what it says of that, without its lists.
#[derive(Debug, Clone, Copy)]
pub(super) struct Turns {
    /// Gain and momentum of the projection, and where the SLM lies in the grid.
    pub(super) project: project::Args,
    pub(super) adam: adam::Args,
    /// Whether it is the projection that moves it.
    pub(super) projects: bool,
}

impl Turns {
    /// Those of this step.
    pub(super) fn of(step: &Step) -> Self {
        let projects = step.list.last().is_some_and(|d| d.kernel == Kernel::Project);
        Self { project: step.project, adam: step.adam, projects }
    }
}

/// Runs these parts of a step's list, in order, up to what would move its phases, and reads the change of the field that it asks for:
/// its loss, and the change unless that is no finite number.
///
/// # Errors
/// Those of the engine.
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

/// What of these parts is in a range.
fn within(parts: &[Range<usize>], range: Range<usize>) -> impl Iterator<Item = Range<usize>> {
    let cut = move |part: &Range<usize>| part.start.max(range.start)..part.end.min(range.end);
    parts.iter().map(cut).filter(|part| !part.is_empty())
}
