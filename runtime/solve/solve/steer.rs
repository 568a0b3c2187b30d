//! Refining a hologram for where the eye is (OPTICS 6d): steps over pupils around it, and a few over the whole eyebox, so
//! that a sudden look elsewhere never meets the dark.

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

/// A pupil that is neither wide nor narrow, metres.
const USUAL_EYE: f64 = 4e-3;
/// Diameters of an eye's pupil, 2 to 8 mm, and half a millimetre around them, as they are drawn, metres; and how many between
/// are looked at for the windows that they have.
const EYES: [f64; 2] = [1.5e-3, 8.5e-3];
const DIAMETERS: u32 = 6000;

/// A hologram under refinement: one colour on one engine.
pub struct Refiner {
    problem: Problem,
    planner: Planner,
    steering: RefineSettings,
    engine: Box<dyn Engine>,
    exposure: f64,
    pub(super) aim: PupilDistribution,
    /// What the pupils of the last step were drawn for.
    drawn_for: PupilDistribution,
    points: Points,
    /// How eye and content move, what the pupils of the last step were drawn for, and where from.
    motion: Motion,
    moved_for: Motion,
    moves: Points,
    /// Pupils over the whole eyebox that are due.
    due: f64,
    drawing: Drawing,
    /// Steps since phases or aim were set anew: Adam's corrections count them.
    since: usize,
    /// What steps take that draw pupils, and those that use the pupils of the step before.
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
    /// Seconds that the host was at it.
    host: f64,
}

/// What was drawn last, and lists that the next step fills: none is made anew for it.
#[derive(Default)]
struct Drawing {
    /// The pupil passes of the last step, and room for its kernels.
    lists: StepLists,
    /// Steps that look through them are due, but none has been; or so many have.
    drawn: bool,
    used: usize,
    /// Pupil passes that the last step had no use for.
    spare: Vec<PupilPass>,
    viewpoints: Vec<Viewpoint>,
    /// The parts of the step's list that have to run.
    parts: Vec<Range<usize>>,
    /// Room for the sizes of its windows.
    pixels: Vec<usize>,
}

impl Drawing {
    /// What was drawn is of no use any more; what it was drawn into is.
    fn forget(&mut self) {
        self.drawn = false;
    }

    fn take_lists(&mut self) -> StepLists {
        std::mem::take(&mut self.lists)
    }

    /// Takes back the lists of a step that was begun; pixels of the windows of its pupil passes.
    fn take_back(&mut self, step: Step) -> Vec<usize> {
        let mut pixels = std::mem::take(&mut self.pixels);
        pixels.clear();
        pixels.extend(step.pupil_passes.iter().map(PupilPass::count));
        self.lists = step.into();
        pixels
    }
}

impl Refiner {
    /// Begins with these phases ((frames, height, width), radians), solved for `exposure`, and the whole eyebox as aim.
    ///
    /// # Errors
    /// [`SolveError::Setting`] for phases of another number or numbers that cannot be; those of the engine.
    pub fn new(
        problem: Problem,
        phases: &[f32],
        exposure: f64,
        steering: RefineSettings,
        engine: Box<dyn Engine>,
    ) -> Result<Self, SolveError> {
        Self::with_powers(problem, phases, exposure, &[], steering, engine)
    }

    /// In the light of a laser of these powers, sub-frame by sub-frame; none for the same in all.
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

    /// Begins again with the phases that it was made with, those for the whole eyebox: where they are a device's, with nothing
    /// passing through the host.
    ///
    /// # Errors
    /// Those of the engine.
    pub fn begin_again(&mut self) -> Result<(), EngineError> {
        self.since = 0;
        self.engine.restore()
    }

    /// Begins again with other phases of the same hologram.
    ///
    /// # Errors
    /// Those of the engine.
    pub fn restart(&mut self, phases: &[f32]) -> Result<(), EngineError> {
        self.engine.write(Buffer::Phases, phases)?;
        self.forget()
    }

    /// The scene has changed, before the same optics: its views take the place of those before, the phases stay, and `exposure` is
    /// what they are refined for from now on.
    ///
    /// # Errors
    /// Those of the engine.
    pub fn follow(&mut self, problem: Problem, exposure: f64) -> Result<(), EngineError> {
        self.settle()?;
        self.engine.take_views(Arc::clone(&problem.pyramid))?;
        self.planner.views = problem.planner(self.planner.frames, self.planner.factor).views;
        self.drawing.forget();
        // What is lit stays so.
        let (choice, regions) = (self.problem.choice.take(), Arc::clone(&self.problem.regions));
        (self.problem, self.exposure) = (Problem { choice, regions, ..problem }, exposure);
        Ok(())
    }

    /// Goes on with the first phases of the scene, as [`restart`](Self::restart) does.
    ///
    /// # Errors
    /// Those of the engine.
    pub fn look_up(&mut self, table: &StartTable) -> Result<(), EngineError> {
        self.settle()?;
        match table.look_up(&self.problem, self.exposure) {
            Some(look_up) => self.engine.look_up(&look_up)?,
            None => self.engine.write(Buffer::Phases, &table.phases(&self.problem, self.exposure)?)?,
        }
        self.forget()
    }

    /// Other phases of the same hologram, which [`begin_again`](Self::begin_again) comes back to from now on.
    ///
    /// # Errors
    /// Those of the engine.
    pub fn begin_with(&mut self, phases: &[f32]) -> Result<(), EngineError> {
        self.settle()?;
        self.restart(phases)?;
        self.engine.keep(Buffer::Phases)
    }

    /// The loss of the phases as they are, through the pupils that the next step looks through.
    ///
    /// # Errors
    /// Those of the engine.
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

    /// What it is refined for.
    pub fn problem(&self) -> &Problem {
        &self.problem
    }

    /// Goes on with each sub-frame's phases moved by whole pixels (x, y), as its picture has, where these lose less than the phases
    /// as they are; whether they do. In the far field the picture is moved by a phase, which is laid over them.
    ///
    /// # Errors
    /// Those of the engine.
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

    /// Goes on with each sub-frame's phases moved by whole pixels (x, y), whatever they lose. The steps since the eye came there
    /// still count. Velocities were those of other pixels: they go where all sub-frames move, and else move with theirs.
    ///
    /// # Errors
    /// Those of the engine.
    pub fn carry_phases(&mut self, shifts: &[[f64; 2]]) -> Result<(), EngineError> {
        self.settle()?;
        let Self { carry, engine, planner, .. } = self;
        let mut carried = |buffer| carry.shift(engine.as_mut(), planner, buffer, shifts);
        if shifts.iter().all(|shift| *shift != [0.0; 2]) {
            carried(Buffer::Phases)?;
            return self.engine.clear_moments();
        }
        match (planner.slm.geometry, self.steering.strategy) {
            // Each pixel's phase stays its own there, with one more laid over it.
            (Geometry::FarField, _) => {}
            (Geometry::Relay, Strategy::Projection { .. }) => carried(Buffer::Momentum)?,
            (Geometry::Relay, Strategy::Adam { .. }) => {
                carried(Buffer::Momentum)?;
                carried(Buffer::Second)?;
            }
        }
        // The last, for who may want them back.
        carried(Buffer::Phases)
    }

    /// The eye has moved. Velocities go where it is elsewhere altogether: they would carry on for where it was.
    ///
    /// # Errors
    /// Those of the engine.
    pub fn aim(&mut self, aim: PupilDistribution) -> Result<(), EngineError> {
        let jumped = aim.distance(&self.aim) > 0.5 * (aim.diameter[0] + self.aim.diameter[0]).max(aim.spread);
        if !aim.is_served_by(&self.drawn_for) {
            self.drawing.forget();
        }
        self.aim = aim;
        self.choose_sources();
        if jumped { self.forget() } else { Ok(()) }
    }

    /// What moves while the sub-frames are lit, from now on.
    ///
    /// # Errors
    /// [`SolveError::Setting`] for what cannot be.
    pub fn moves(&mut self, motion: Motion) -> Result<(), SolveError> {
        motion.check(self.planner.frames)?;
        if !motion.is_served_by(&self.moved_for) {
            self.drawing.forget();
        }
        self.motion = motion;
        Ok(())
    }

    /// What moves.
    pub fn motion(&self) -> Motion {
        self.motion
    }

    fn forget(&mut self) -> Result<(), EngineError> {
        self.since = 0;
        self.engine.clear_moments()
    }

    /// One step; its loss. With a loss that is NaN or infinite the phases stay as they were.
    ///
    /// # Errors
    /// Those of the engine.
    pub fn step(&mut self) -> Result<f64, EngineError> {
        self.settle()?;
        let loss = self.advance()?;
        Ok(self.settle()?.or(loss).unwrap_or(f64::NAN))
    }

    /// Begins a step. On a device it is under way when this returns, and the loss of the one before is given, if that had not
    /// ended; elsewhere its own.
    ///
    /// # Errors
    /// Those of the engine.
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

    /// Waits for the step that is under way, if there is one; its loss.
    ///
    /// # Errors
    /// Those of the engine.
    pub fn settle(&mut self) -> Result<Option<f64>, EngineError> {
        self.under_way.take().map(|step| self.end(step)).transpose()
    }

    fn end(&mut self, UnderWay { begun, pixels, kind, host }: UnderWay) -> Result<f64, EngineError> {
        let taken = self.engine.end_step(begun)?;
        let loss = mean_loss(&taken.losses, pixels.iter().copied());
        self.engine.recycle(taken.losses);
        self.drawing.pixels = pixels;
        if loss.is_finite() {
            // Steps follow each other as fast as the slower of the two lets them.
            self.paces[kind].took(taken.seconds.max(host));
        } else {
            self.drawing.forget();
        }
        Ok(loss)
    }

    /// What the step that is under way is expected to take, at most.
    pub fn backlog(&self) -> Duration {
        Duration::from_secs_f64(self.under_way.as_ref().map_or(0.0, |step| self.paces[step.kind].expected()))
    }

    /// What the intensities are multiplied by.
    pub fn exposure(&self) -> f64 {
        self.exposure
    }

    /// What the next step is expected to take: the longest lately, without those that something else held up.
    pub fn expected(&self) -> Duration {
        Duration::from_secs_f64(self.paces[self.kind()].expected())
    }

    /// As many steps as are expected to end before `deadline`, `most` at most; how many were taken. Where none is, deadline
    /// after deadline, less is expected, until one is tried.
    ///
    /// # Errors
    /// Those of the engine.
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

    /// The phases as they are now: (frames, height, width), radians in -pi .. pi.
    ///
    /// # Errors
    /// Those of the engine.
    pub fn phases(&mut self) -> Result<Vec<f32>, EngineError> {
        self.engine.read(Buffer::Phases)
    }

    /// The same, into memory that is there already, which becomes as long as they are. Errors are the engine's.
    pub fn phases_into(&mut self, to: &mut Vec<f32>) -> Result<(), EngineError> {
        to.resize(self.planner.frames * self.planner.slm.height * self.planner.slm.width, 0.0);
        self.engine.read_into(Buffer::Phases, to)
    }

    /// The phases where they are, if that is in a device's memory: for an encoder on that device.
    pub fn phases_on_device(&self) -> Option<PhasesOnDevice<'_>> {
        self.engine.phases_on_device()
    }

    /// What each of these pupils sees now, and should see: sums from which exposure and PSNR follow.
    ///
    /// # Errors
    /// Those of the engine.
    pub fn look(&mut self, pupils: &[Pupil]) -> Result<Vec<Sums>, EngineError> {
        self.look_through(&pupils.iter().map(|p| Viewpoint::Pupil(*p)).collect::<Vec<_>>())
    }

    /// What an eye sees through this pupil, at no exposure, and the photograph that it should see: pictures of
    /// [`Optics::image_size`](crate::optics::Optics::image_size), linear light.
    ///
    /// # Errors
    /// Those of the engine.
    pub fn pictures(&mut self, pupil: Pupil) -> Result<[Vec<f32>; 2], EngineError> {
        self.drawing.forget();
        let mut seen = evaluate::views(self.engine.as_mut(), &self.planner, &[pupil])?;
        let mut wanted = evaluate::photographs(self.engine.as_mut(), &self.planner, &[pupil])?;
        Ok([&mut seen, &mut wanted].map(|pictures| pictures.pop().unwrap_or_default()))
    }

    /// [`look`](Self::look) through any viewpoints, such as eyes that move.
    ///
    /// # Errors
    /// Those of the engine.
    pub fn look_through(&mut self, viewpoints: &[Viewpoint]) -> Result<Vec<Sums>, EngineError> {
        // The first slot will hold other pupil passes than a step's.
        self.drawing.forget();
        evaluate::sums(self.engine.as_mut(), &self.planner, viewpoints)
    }
}
