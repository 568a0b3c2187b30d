//! Refines a hologram for the position of the eye (OPTICS 6d).
//!
//! Steps use pupils around the eye, and a few over the whole eyebox, so that a sudden look elsewhere is never dark.

mod draw;
mod sharing;
mod sources;

use super::carry::Carry;
use super::error::{SolveError, require};
use super::motion::Motion;
use super::pace::Pace;
use super::problem::Problem;
use super::refine_settings::{RefineSettings, Strategy};
use super::sampling::{Points, Sequence};
use super::start_table::StartTable;
use crate::engine::{Buffer, Engine, EngineError, PendingStep, PhasesOnDevice};
use crate::evaluate::{self, Sums};
use crate::optics::{Geometry, Pupil, PupilDistribution};
use crate::plan::{Planner, PupilPass, Step, StepLists, Viewpoint, mean_loss};
use std::ops::Range;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Diameter of an average pupil, in meters.
const USUAL_EYE: f64 = 4e-3;
/// Range of drawn diameters in meters, which is an eye's pupil of 2 to 8 mm and half a millimeter around it. The other
/// constant is the number of diameters that are tested for their windows.
const EYES: [f64; 2] = [1.5e-3, 8.5e-3];
const DIAMETERS: u32 = 6000;
/// Number of window sizes whose pipelines exist before the first step. Their pupils are nearest to the usual one. A
/// driver of a GPU takes 0.1 to 0.3 s of a core for each pipeline.
const FIRST_WINDOWS: usize = 8;

/// A hologram under refinement, which is one color on one engine.
pub struct Refiner {
    problem: Problem,
    planner: Planner,
    steering: RefineSettings,
    engine: Box<dyn Engine>,
    exposure: f64,
    pub(super) aim: PupilDistribution,
    /// The distribution for which the pupils of the last step were drawn.
    drawn_for: PupilDistribution,
    points: Points,
    /// The movement of eye and content, its value for the pupils of the last step, and the source of its random
    /// numbers.
    motion: Motion,
    moved_for: Motion,
    moves: Points,
    /// Pupils over the whole eyebox that are due.
    due: f64,
    drawing: Drawing,
    /// Steps since new phases or a new aim, which Adam's corrections count.
    since: usize,
    /// Durations of the steps that draw pupils, and of the steps that reuse the pupils of the step before.
    paces: [Pace; 2],
    /// The step that was begun last, if it has not ended.
    under_way: Option<UnderWay>,
    carry: Carry,
}

/// A step that was begun.
struct UnderWay {
    begun: PendingStep,
    /// Pixels of the windows of its pupil passes.
    pixels: Vec<usize>,
    kind: usize,
    /// Seconds of the host's work for it.
    host: f64,
}

/// The last drawn pupils, and lists that the next step fills without new allocations.
#[derive(Default)]
struct Drawing {
    /// The pupil passes of the last step, and memory for its kernels.
    lists: StepLists,
    /// True if the drawn pupils are valid. `used` counts the steps that used them.
    drawn: bool,
    used: usize,
    /// Pupil passes that the last step did not need.
    spare: Vec<PupilPass>,
    viewpoints: Vec<Viewpoint>,
    /// The parts of the step's list that have to run.
    parts: Vec<Range<usize>>,
    /// Memory for the sizes of its windows.
    pixels: Vec<usize>,
}

impl Drawing {
    /// Invalidates the drawn pupils and keeps their memory.
    fn forget(&mut self) {
        self.drawn = false;
    }

    fn take_lists(&mut self) -> StepLists {
        std::mem::take(&mut self.lists)
    }

    /// Takes back the lists of a step that was begun. It returns the pixels of the windows of its pupil passes.
    fn take_back(&mut self, step: Step) -> Vec<usize> {
        let mut pixels = std::mem::take(&mut self.pixels);
        pixels.clear();
        pixels.extend(step.pupil_passes.iter().map(PupilPass::count));
        self.lists = step.into();
        pixels
    }
}

impl Refiner {
    /// Starts with these phases (frames, height, width) in radians, solved for `exposure`, and aims at the whole
    /// eyebox.
    ///
    /// # Errors
    /// [`SolveError::Setting`] for another number of phases or for invalid values, and [`SolveError::Engine`] if the
    /// engine fails.
    pub fn new(
        problem: Problem,
        phases: &[f32],
        exposure: f64,
        steering: RefineSettings,
        engine: Box<dyn Engine>,
    ) -> Result<Self, SolveError> {
        Self::with_powers(problem, phases, exposure, &[], steering, engine)
    }

    /// Starts in the light of a laser of these powers per sub-frame. No powers mean equal ones.
    fn with_powers(
        problem: Problem,
        phases: &[f32],
        exposure: f64,
        powers: &[f64],
        steering: RefineSettings,
        mut engine: Box<dyn Engine>,
    ) -> Result<Self, SolveError> {
        let pixels = problem.optics.height * problem.optics.width;
        let frames = phases.len() / pixels.max(1);
        let are_whole = frames > 0 && frames * pixels == phases.len() && phases.iter().all(|p| p.is_finite());
        require(are_whole, "the number of phases to refine", phases.len(), "whole sub-frames, all finite")?;
        steering.check()?;
        problem.check_blur(USUAL_EYE)?;
        require(exposure > 0.0 && exposure.is_finite(), "the exposure", exposure, "a positive, finite number")?;
        let storage = steering.storage.unwrap_or_else(|| engine.preferred_storage());
        let plain = problem.planner(frames, steering.window).with_fewer_modes(problem.eyebox);
        let planner = Planner { storage, binary_angles: true, powers: powers.into(), ..plain };
        let purpose = steering.strategy.purpose();
        engine.load(&planner.shape(purpose), Some(Arc::clone(&problem.pyramid)))?;
        let (half, centre) = (problem.eyebox / 2.0, problem.optics.center());
        let diameter = [half / 4.0, half / 2.0];
        let aim = PupilDistribution { centre, spread: half, diameter, focus: [0.0, 0.0], elsewhere: 1.0 };
        let points = Points::new(Sequence::Sobol, steering.seed ^ 0x0073_7465_6572);
        let mut refiner = Self {
            problem,
            planner,
            steering,
            engine,
            exposure,
            aim,
            drawn_for: aim,
            points,
            motion: Motion::default(),
            moved_for: Motion::default(),
            moves: Points::new(Sequence::Sobol, steering.seed ^ 0x6d6f_7469_6f6e),
            due: 0.0,
            drawing: Drawing::default(),
            since: 0,
            paces: Default::default(),
            under_way: None,
            carry: Carry::default(),
        };
        refiner.restart(phases)?;
        refiner.engine.keep(Buffer::Phases)?;
        refiner.prepare()?;
        Ok(refiner)
    }

    /// Restarts with the original phases, those for the whole eyebox. On a device nothing passes through the host.
    ///
    /// # Errors
    /// [`EngineError`] if the engine fails.
    pub fn begin_again(&mut self) -> Result<(), EngineError> {
        self.since = 0;
        self.engine.restore()
    }

    /// Restarts with other phases of the same hologram.
    ///
    /// # Errors
    /// [`EngineError`] if the engine fails.
    pub fn restart(&mut self, phases: &[f32]) -> Result<(), EngineError> {
        self.engine.write(Buffer::Phases, phases)?;
        self.forget()
    }

    /// Replaces the scene with one for the same optics.
    ///
    /// The new views replace the old ones, and the phases stay. They are refined for `exposure` from now on.
    ///
    /// # Errors
    /// [`EngineError`] if the engine fails.
    pub fn follow(&mut self, problem: Problem, exposure: f64) -> Result<(), EngineError> {
        self.settle()?;
        self.engine.take_views(Arc::clone(&problem.pyramid))?;
        self.planner.views = problem.planner(self.planner.frames, self.planner.factor).views;
        self.drawing.forget();
        // The lit sources stay the same.
        let (choice, regions) = (self.problem.choice.take(), Arc::clone(&self.problem.regions));
        (self.problem, self.exposure) = (Problem { choice, regions, ..problem }, exposure);
        Ok(())
    }

    /// Continues with the first phases of the scene, as [`restart`](Self::restart) does.
    ///
    /// # Errors
    /// [`EngineError`] if the engine fails.
    pub fn look_up(&mut self, table: &StartTable) -> Result<(), EngineError> {
        self.settle()?;
        match table.look_up(&self.problem, self.exposure) {
            Some(look_up) => self.engine.look_up(&look_up)?,
            None => self.engine.write(Buffer::Phases, &table.phases(&self.problem, self.exposure)?)?,
        }
        self.forget()
    }

    /// Restarts with other phases of the same hologram, to which [`begin_again`](Self::begin_again) returns from now
    /// on.
    ///
    /// # Errors
    /// [`EngineError`] if the engine fails.
    pub fn begin_with(&mut self, phases: &[f32]) -> Result<(), EngineError> {
        self.settle()?;
        self.restart(phases)?;
        self.engine.keep(Buffer::Phases)
    }

    /// Returns the loss of the current phases through the pupils of the next step.
    ///
    /// # Errors
    /// [`EngineError`] if the engine fails.
    pub fn loss(&mut self) -> Result<f64, EngineError> {
        self.settle()?;
        let update = self.steering.strategy.update(self.since + 1);
        if self.is_fresh() {
            self.draw(update);
        }
        let step = update.step(&self.planner, self.drawing.take_lists(), usize::MAX);
        let losses = self.engine.run_part(&step, 0..step.before_update());
        let loss = losses.as_ref().map_or(f64::NAN, |losses| step.mean_loss(losses));
        self.drawing.lists = step.into();
        self.engine.recycle(losses?);
        Ok(loss)
    }

    /// Returns the problem that is refined.
    pub fn problem(&self) -> &Problem {
        &self.problem
    }

    /// Moves each sub-frame's phases by whole pixels (x, y), as its picture moved, if the loss then is lower.
    ///
    /// It returns true if it moved them. In the far field a phase that is added to them moves the picture.
    ///
    /// # Errors
    /// [`EngineError`] if the engine fails.
    pub fn move_phases(&mut self, shifts: &[[f64; 2]]) -> Result<bool, EngineError> {
        let before = self.loss()?;
        self.carry_phases(shifts)?;
        if self.loss()? < before {
            return Ok(true);
        }
        self.engine.write(Buffer::Phases, self.carry.before())?;
        self.engine.clear_moments()?;
        Ok(false)
    }

    /// Moves each sub-frame's phases by whole pixels (x, y), regardless of the loss.
    ///
    /// The count of steps since the last jump of the eye continues. Velocities belong to other pixels afterwards. They
    /// are cleared if all sub-frames move, and otherwise move with the phases.
    ///
    /// # Errors
    /// [`EngineError`] if the engine fails.
    pub fn carry_phases(&mut self, shifts: &[[f64; 2]]) -> Result<(), EngineError> {
        self.settle()?;
        let Self { carry, engine, planner, .. } = self;
        let mut carried = |buffer| carry.shift(engine.as_mut(), planner, buffer, shifts);
        if shifts.iter().all(|shift| *shift != [0.0; 2]) {
            carried(Buffer::Phases)?;
            return self.engine.clear_moments();
        }
        match (planner.slm.geometry, self.steering.strategy) {
            // In the far field each phase stays at its pixel, and another one is added to it.
            (Geometry::FarField, _) => {}
            (Geometry::Relay, Strategy::Projection { .. }) => carried(Buffer::Momentum)?,
            (Geometry::Relay, Strategy::Adam { .. }) => {
                carried(Buffer::Momentum)?;
                carried(Buffer::Second)?;
            }
        }
        // Phases are moved last, because the caller may restore them.
        carried(Buffer::Phases)
    }

    /// Aims at a new position of the eye. Velocities are cleared after a jump, because they belong to the old position.
    ///
    /// # Errors
    /// [`EngineError`] if the engine fails.
    pub fn aim(&mut self, aim: PupilDistribution) -> Result<(), EngineError> {
        let jumped = aim.distance(&self.aim) > 0.5 * (aim.diameter[0] + self.aim.diameter[0]).max(aim.spread);
        if !aim.is_served_by(&self.drawn_for) {
            self.drawing.forget();
        }
        self.aim = aim;
        self.choose_sources();
        if jumped { self.forget() } else { Ok(()) }
    }

    /// Sets the movement while the sub-frames are lit, from now on.
    ///
    /// # Errors
    /// [`SolveError::Setting`] for invalid values.
    pub fn moves(&mut self, motion: Motion) -> Result<(), SolveError> {
        motion.check(self.planner.frames)?;
        if !motion.is_served_by(&self.moved_for) {
            self.drawing.forget();
        }
        self.motion = motion;
        Ok(())
    }

    /// Returns the movement while the sub-frames are lit.
    pub fn motion(&self) -> Motion {
        self.motion
    }

    fn forget(&mut self) -> Result<(), EngineError> {
        self.since = 0;
        self.engine.clear_moments()
    }

    /// Takes one step and returns its loss. If the loss is NaN or infinite, the phases stay as they were.
    ///
    /// # Errors
    /// [`EngineError`] if the engine fails.
    pub fn step(&mut self) -> Result<f64, EngineError> {
        self.settle()?;
        let loss = self.advance()?;
        Ok(self.settle()?.or(loss).unwrap_or(f64::NAN))
    }

    /// Begins a step. On a device it is still under way at the return, and the result is the loss of the step before if
    /// that had not ended. Elsewhere the result is its own loss.
    ///
    /// # Errors
    /// [`EngineError`] if the engine fails.
    pub fn advance(&mut self) -> Result<Option<f64>, EngineError> {
        let (start, kind) = (Instant::now(), self.kind());
        let step = self.next();
        let begun = self.engine.begin_step(&step, &self.drawing.parts);
        let pixels = self.drawing.take_back(step);
        let this = UnderWay { begun: begun?, pixels, kind, host: start.elapsed().as_secs_f64() };
        if this.begun.is_over() {
            return self.end(this).map(Some);
        }
        let before = self.under_way.replace(this);
        before.map(|before| self.end(before)).transpose()
    }

    /// Waits for the step that is under way, if there is one, and returns its loss.
    ///
    /// # Errors
    /// [`EngineError`] if the engine fails.
    pub fn settle(&mut self) -> Result<Option<f64>, EngineError> {
        self.under_way.take().map(|step| self.end(step)).transpose()
    }

    fn end(&mut self, UnderWay { begun, pixels, kind, host }: UnderWay) -> Result<f64, EngineError> {
        let taken = self.engine.end_step(begun)?;
        let loss = mean_loss(&taken.losses, pixels.iter().copied());
        self.engine.recycle(taken.losses);
        self.drawing.pixels = pixels;
        if loss.is_finite() {
            // The slower of device and host decides how fast steps follow each other.
            self.paces[kind].took(taken.seconds.max(host));
        } else {
            self.drawing.forget();
        }
        Ok(loss)
    }

    /// Returns the longest expected duration of the step that is under way.
    pub fn backlog(&self) -> Duration {
        Duration::from_secs_f64(self.under_way.as_ref().map_or(0.0, |step| self.paces[step.kind].expected()))
    }

    /// Returns the factor on the intensities.
    pub fn exposure(&self) -> f64 {
        self.exposure
    }

    /// Returns the expected duration of the next step. It is the longest recent one, without delayed steps.
    pub fn expected(&self) -> Duration {
        Duration::from_secs_f64(self.paces[self.kind()].expected())
    }

    /// Takes at most `most` steps that are expected to end before `deadline`, and returns their number.
    ///
    /// If no step fits before several deadlines, the expected duration decreases until one is tried.
    ///
    /// # Errors
    /// [`EngineError`] if the engine fails.
    pub fn refine_until(&mut self, deadline: Instant, most: usize) -> Result<usize, EngineError> {
        let mut taken = 0;
        while taken < most {
            let (left, kind) = (deadline.saturating_duration_since(Instant::now() + self.backlog()), self.kind());
            if !self.paces[kind].may_begin(left.as_secs_f64(), taken) {
                break;
            }
            self.advance()?;
            taken += 1;
        }
        self.settle()?;
        Ok(taken)
    }

    /// Returns the current phases (frames, height, width), radians in -pi .. pi.
    ///
    /// # Errors
    /// [`EngineError`] if the engine fails.
    pub fn phases(&mut self) -> Result<Vec<f32>, EngineError> {
        self.engine.read(Buffer::Phases)
    }

    /// Reads the current phases into existing memory, which is resized to their number. The errors equal the ones of
    /// [`phases`](Self::phases).
    pub fn phases_into(&mut self, to: &mut Vec<f32>) -> Result<(), EngineError> {
        to.resize(self.planner.frames * self.planner.slm.height * self.planner.slm.width, 0.0);
        self.engine.read_into(Buffer::Phases, to)
    }

    /// Returns the phases in a device's memory, if they are there, for an encoder on that device.
    pub fn phases_on_device(&self) -> Option<PhasesOnDevice<'_>> {
        self.engine.phases_on_device()
    }

    /// Returns the sums of image and target image for each of these pupils, from which exposure and PSNR follow.
    ///
    /// # Errors
    /// [`EngineError`] if the engine fails.
    pub fn look(&mut self, pupils: &[Pupil]) -> Result<Vec<Sums>, EngineError> {
        self.look_through(&pupils.iter().map(|p| Viewpoint::Pupil(*p)).collect::<Vec<_>>())
    }

    /// Returns the image that an eye sees through this pupil, without exposure, and its target image.
    ///
    /// Both have the size [`Optics::image_size`](crate::optics::Optics::image_size) and linear light.
    ///
    /// # Errors
    /// [`EngineError`] if the engine fails.
    pub fn pictures(&mut self, pupil: Pupil) -> Result<[Vec<f32>; 2], EngineError> {
        self.drawing.forget();
        let mut seen = evaluate::views(self.engine.as_mut(), &self.planner, &[pupil])?;
        let mut wanted = evaluate::photographs(self.engine.as_mut(), &self.planner, &[pupil])?;
        Ok([&mut seen, &mut wanted].map(|pictures| pictures.pop().unwrap_or_default()))
    }

    /// Returns the sums as [`look`](Self::look) does, for any viewpoints, such as eyes that move.
    ///
    /// # Errors
    /// [`EngineError`] if the engine fails.
    pub fn look_through(&mut self, viewpoints: &[Viewpoint]) -> Result<Vec<Sums>, EngineError> {
        // The first slot will hold other pupil passes than a step has.
        self.drawing.forget();
        evaluate::sums(self.engine.as_mut(), &self.planner, viewpoints)
    }
}
