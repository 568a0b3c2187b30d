//! All colours of a hologram under refinement, without threads: where to aim, when to begin again, what to do next.

pub(crate) mod look_up;
pub(crate) mod together;

use crate::encode::{Lighting, LitTimes};
use crate::engine::{Engine, EngineError, PhasesOnDevice};
use crate::optics::{Laser, PupilDistribution};
use crate::session::frame_log::error::SessionError;
use crate::session::refinement::field::{Field, LiveColor};
use crate::session::refinement::likeness;
use crate::solve::{Motion, Problem, RefineSettings, Refiner, SharedDrives, StartTable, for_joint_colors};
use crate::tiled::TileRect;
use eyebox_base::reason;
use serde::{Deserialize, Serialize};
use std::ops::Deref;
use std::sync::Arc;
use std::time::Duration;

/// No eye is known better than this, metres: its spread as a solver takes it.
const SHARPEST: f64 = 0.1e-3;
const MOST_COLORS: usize = 3;

/// Opens an engine, as often as it is called.
pub type EngineOpener = Box<dyn FnMut() -> Result<Box<dyn Engine>, EngineError> + Send>;

/// How a hologram follows the eye.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Policy {
    /// A jump of so many pupil diameters begins again with the hologram for the whole eyebox; infinite: never.
    pub restart: f64,
    /// The refinement.
    pub steering: RefineSettings,
}

impl Default for Policy {
    fn default() -> Self {
        Self { restart: 0.5, steering: RefineSettings::default() }
    }
}

struct OneColor {
    refiner: Refiner,
    /// As they were read last.
    phases: Vec<f32>,
    /// The last step's.
    loss: Option<f64>,
    /// Of a piece of a far field: its middle, and how far it goes from there, metres.
    piece: Option<([f64; 2], [f64; 2])>,
    /// What pictures begin with that bring no phases.
    table: Option<Arc<StartTable>>,
    /// The scene is another picture altogether, and nothing was begun with for it yet.
    needs_reinit: bool,
}

/// Phases of each colour, as they are read for every set: (frames, height, width), radians.
#[derive(Debug, Clone, Copy, Default)]
pub struct PhasesOfColors<'a> {
    colors: [&'a [f32]; MOST_COLORS],
    count: usize,
}

impl<'a> FromIterator<&'a [f32]> for PhasesOfColors<'a> {
    fn from_iter<I: IntoIterator<Item = &'a [f32]>>(colors: I) -> Self {
        let mut phases = Self::default();
        for (place, color) in phases.colors.iter_mut().zip(colors) {
            *place = color;
            phases.count += 1;
        }
        phases
    }
}

impl<'a> Deref for PhasesOfColors<'a> {
    type Target = [&'a [f32]];

    fn deref(&self) -> &Self::Target {
        &self.colors[..self.count]
    }
}

/// What another scene was begun with.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Followed {
    /// Colours that began with the scene's own phases.
    pub own: u32,
    /// Colours that went on with the phases before, though there were others to begin with.
    pub kept: u32,
    /// Losses that were looked at to decide.
    pub looks: u32,
}

impl OneColor {
    /// A step's loss, if one has ended: with one that is no finite number it begins again.
    fn heard(&mut self, loss: Option<f64>) -> Result<(), EngineError> {
        match loss {
            Some(loss) if !loss.is_finite() => self.refiner.begin_again(),
            Some(loss) => {
                self.loss = Some(loss);
                Ok(())
            }
            None => Ok(()),
        }
    }
}

/// All colours, each with its engine.
pub struct LiveRefiner {
    colors: Vec<OneColor>,
    policy: Policy,
    next: usize,
    /// Where the last steps went to.
    aimed: Option<PupilDistribution>,
    restarts: u64,
    steps: u64,
    /// Of a far field, all of it, and what makes an engine for another piece.
    field: Option<(Field, EngineOpener)>,
    /// By how many pixels each sub-frame of a colour is moved.
    shifts: Vec<[f64; 2]>,
    /// The drives that all colours share, where they do.
    shared: Option<SharedDrives>,
}

impl LiveRefiner {
    /// Begins with the holograms for the whole eyebox; `engine` makes an engine for each colour.
    ///
    /// # Errors
    /// [`SessionError::Setting`] for no colour or a policy that cannot be; those of [`Refiner::new`] and of `engine`.
    pub fn new(
        colors: Vec<LiveColor>,
        policy: Policy,
        mut engine: impl FnMut() -> Result<Box<dyn Engine>, EngineError>,
    ) -> Result<Self, SessionError> {
        if colors.is_empty() {
            return Err(reason!("no-color", "there is no colour to refine").into());
        }
        if colors.len() > MOST_COLORS {
            let count = colors.len();
            return Err(
                reason!("colors-count", "{count} colours to refine: a display has {MOST_COLORS} at most").into()
            );
        }
        if policy.restart.is_nan() || policy.restart < 0.0 {
            let wrong = policy.restart;
            return Err(reason!("restart", "restart after {wrong} pupil diameters: it must be 0 or more").into());
        }
        let lasers = Self::lasers_of(&colors)?;
        let steering = if lasers.is_some() { for_joint_colors(policy.steering)? } else { policy.steering };
        let policy = Policy { steering, ..policy };
        let drives = lasers.as_ref().map(|lasers| Self::drives_of(lasers, &colors)).unwrap_or_default();
        let one = |color: LiveColor| -> Result<OneColor, SessionError> {
            let LiveColor { problem, phases, exposure, laser } = color;
            let refiner = match laser {
                Some(Laser { powers, .. }) => {
                    Refiner::lit_by(problem, &phases, exposure, &powers, steering, engine()?)?
                }
                None => Refiner::new(problem, &phases, exposure, steering, engine()?)?,
            };
            Ok(OneColor { refiner, phases: Vec::new(), loss: None, piece: None, table: None, needs_reinit: false })
        };
        let mut colors = colors.into_iter().map(one).collect::<Result<Vec<_>, _>>()?;
        let shared = lasers.map(|lasers| SharedDrives::new(&drives, lasers, &mut colors)).transpose()?;
        let (aimed, field, shifts) = (None, None, Vec::new());
        Ok(Self { colors, policy, next: 0, aimed, restarts: 0, steps: 0, field, shifts, shared })
    }

    /// What it refines, `colors`, is a piece of this far field; `engine` makes an engine for every further piece of each colour.
    #[must_use]
    pub fn in_field(mut self, colors: &[LiveColor], field: Field, engine: EngineOpener) -> Self {
        for (color, begun) in self.colors.iter_mut().zip(colors) {
            color.piece = Some(reach_of(&begun.problem));
        }
        Self { field: Some((field, engine)), ..self }
    }

    /// Another piece of the far field is refined from now on. What was refined before stays where it is; the piece begins with
    /// its phases as they are there, or as they were solved, whichever loses less through the pupils of the next step.
    ///
    /// # Errors
    /// [`SessionError::Setting`] for pieces of no far field; those of the engines.
    pub fn move_to(&mut self, piece: TileRect, colors: &[LiveColor]) -> Result<Followed, SessionError> {
        self.settle()?;
        self.phases()?;
        let Some((field, engine)) = self.field.as_mut().filter(|_| colors.len() == self.colors.len()) else {
            return Err(reason!("other-piece", "a piece of another hologram than the one that is refined").into());
        };
        field.piece = piece;
        let mut followed = Followed::default();
        for (i, (color, new)) in self.colors.iter_mut().zip(colors).enumerate() {
            let LiveColor { problem, phases, exposure, .. } = new;
            let mut refiner = Refiner::new(problem.clone(), phases, *exposure, self.policy.steering, engine()?)?;
            let refined = field.cut(i, piece);
            if refined == *phases {
                followed.own += 1;
            } else {
                if let Some(aim) = self.aimed {
                    refiner.aim(within(aim, reach_of(problem)))?;
                }
                let solved = refiner.loss()?;
                refiner.restart(&refined)?;
                followed.looks += 2;
                if refiner.loss()? < solved {
                    followed.kept += 1;
                } else {
                    refiner.begin_again()?;
                    followed.own += 1;
                }
            }
            (color.refiner, color.phases, color.loss) = (refiner, Vec::new(), None);
            color.piece = Some(reach_of(problem));
        }
        Ok(followed)
    }

    /// The eye will be there. After a jump the hologram begins again as it was for the whole eyebox: what it gained was
    /// for another place, and it lost a little everywhere else. Returns whether it does.
    ///
    /// # Errors
    /// Those of the engines.
    pub fn aim(&mut self, aim: PupilDistribution) -> Result<bool, EngineError> {
        let aim = PupilDistribution { spread: aim.spread.max(SHARPEST), ..aim };
        let diameter = |a: &PupilDistribution| 0.5 * (a.diameter[0] + a.diameter[1]);
        let limit = self.policy.restart;
        let jumped = self.aimed.is_some_and(|from| aim.distance(&from) > limit * diameter(&aim).max(diameter(&from)));
        if jumped {
            self.restart()?;
        }
        self.aimed = Some(aim);
        for color in &mut self.colors {
            color.refiner.aim(color.piece.map_or(aim, |piece| within(aim, piece)))?;
        }
        if let Some(shared) = &mut self.shared {
            shared.aimed(&self.colors);
        }
        Ok(jumped)
    }

    /// What moves while the sub-frames of a set are lit, in pixels of the first colour; `times`: when those of each colour are.
    ///
    /// # Errors
    /// [`SessionError::Solve`](SessionError) for what cannot be.
    pub fn moves(&mut self, motion: &Motion, times: &[LitTimes]) -> Result<(), SessionError> {
        let pixel = self.colors.first().map_or(1.0, |c| c.refiner.problem().pixel());
        for (i, color) in self.colors.iter_mut().enumerate() {
            let ratio = pixel / color.refiner.problem().pixel();
            let scaled = |v: [f64; 2]| v.map(|v| v * ratio);
            let Motion { content, eye, spread, .. } = *motion;
            let (content, eye, spread) = (scaled(content), eye.map(scaled), spread * ratio);
            let LitTimes { first, lit } =
                times.get(i).copied().unwrap_or(LitTimes { first: motion.first, lit: motion.lit });
            color.refiner.moves(Motion { content, eye, spread, lit, first, ..*motion })?;
        }
        Ok(())
    }

    /// What moves, for each colour.
    pub fn motions(&self) -> Vec<Motion> {
        self.colors.iter().map(|color| color.refiner.motion()).collect()
    }

    /// Goes on with the phases moved by whole pixels (x, y) of the first colour, as the picture is, those that are lit with each
    /// turn of `lighting` by as many as `pixels` says of it; where it has to `look`, only where that loses less through the pupils
    /// of the next step. Returns whether they are moved, and how many losses were looked at.
    ///
    /// # Errors
    /// Those of the engines.
    pub fn shift_phases(
        &mut self,
        pixels: &[[i64; 2]],
        lighting: &Lighting,
        look: bool,
    ) -> Result<(bool, u32), EngineError> {
        if self.shared.is_some() {
            return self.carry_together(pixels, lighting, look);
        }
        self.settle()?;
        let pixel = self.colors.first().map_or(1.0, |c| c.refiner.problem().pixel());
        let mut moved = true;
        for (i, color) in self.colors.iter_mut().enumerate() {
            let ratio = pixel / color.refiner.problem().pixel();
            let of =
                |turn: &usize| pixels.get(*turn).map_or([0.0; 2], |pixels| pixels.map(|p| (p as f64 * ratio).round()));
            self.shifts.clear();
            self.shifts.extend(lighting.turn_of(i).iter().map(of));
            if self.shifts.iter().all(|shift| *shift == [0.0; 2]) {
                continue;
            }
            if look {
                moved &= color.refiner.move_phases(&self.shifts)?;
            } else {
                color.refiner.carry_phases(&self.shifts)?;
            }
        }
        Ok((moved, if look { 2 * self.colors.len() as u32 } else { 0 }))
    }

    /// Begins again with the hologram for the whole eyebox.
    ///
    /// # Errors
    /// Those of the engines.
    pub fn restart(&mut self) -> Result<(), EngineError> {
        self.aimed = None;
        self.restarts += 1;
        if let Some(shared) = &mut self.shared {
            return shared.begin_again(&mut self.colors);
        }
        self.colors.iter_mut().try_for_each(|c| c.refiner.begin_again())
    }

    /// Another scene, before the same display. Where it brings phases, its own hologram for the whole eyebox, that is what
    /// [`restart`](Self::restart) comes back to from now on; and each colour goes on with these, or with those that were
    /// refined before, whichever loses less through the pupils of the next step. Where it brings none, [`fit`](Self::fit) decides.
    ///
    /// # Errors
    /// [`SessionError::Setting`] for a scene of other colours; those of the engines.
    pub fn follow(&mut self, scene: &[LiveColor]) -> Result<Followed, SessionError> {
        if scene.len() != self.colors.len() {
            let (found, must) = (scene.len(), self.colors.len());
            return Err(reason!("colors-of-scene", "a scene of {found} colours, where {must} are refined").into());
        }
        self.check_lasers(scene)?;
        // Colours that share their drives begin together, or not at all.
        let none = self.shared.is_some() && scene.iter().any(|new| new.phases.is_empty());
        for (color, new) in self.colors.iter_mut().zip(scene) {
            let other = color.table.is_some() && likeness::differ(color.refiner.problem(), &new.problem);
            color.refiner.follow(new.problem.clone(), new.exposure)?;
            color.loss = None;
            color.needs_reinit = (none || new.phases.is_empty()) && (color.needs_reinit || other);
        }
        if none {
            return Ok(Followed::default());
        }
        if self.shared.is_some() {
            return self.follow_together(scene);
        }
        let mut followed = Followed::default();
        for (color, new) in self.colors.iter_mut().zip(scene).filter(|(_, new)| !new.phases.is_empty()) {
            let refiner = &mut color.refiner;
            let before = match self.aimed {
                Some(_) => Some((refiner.loss()?, refiner.phases()?)),
                None => None,
            };
            refiner.begin_with(&new.phases)?;
            followed.looks += if before.is_some() { 2 } else { 0 };
            match before {
                Some((loss, phases)) if loss < refiner.loss()? => {
                    refiner.restart(&phases)?;
                    followed.kept += 1;
                }
                _ => followed.own += 1,
            }
        }
        Ok(followed)
    }

    /// What was refined is of no use for the next scene that brings phases.
    pub(crate) fn forget_aim(&mut self) {
        self.aimed = None;
    }

    /// What the pupils of the last steps saw, by their losses, mean over the colours, dB; none before every colour took one.
    pub fn estimated_db(&self) -> Option<f64> {
        let sum: f64 = self.colors.iter().map(|c| c.loss).sum::<Option<f64>>()?;
        Some(-10.0 * (sum / self.colors.len().max(1) as f64).max(1e-12).log10())
    }

    /// The display's switchable sources that are lit for each colour, by their places.
    pub fn sources(&self) -> impl Iterator<Item = &[usize]> {
        self.colors.iter().map(|color| color.refiner.sources())
    }

    /// Begins again, in the light that the holograms for the whole eyebox were solved for.
    pub(crate) fn show_whole(&mut self) -> Result<(), EngineError> {
        self.colors.iter_mut().for_each(|color| color.refiner.forget_sources());
        self.restart()
    }

    pub(crate) fn colors(&self) -> usize {
        self.colors.len()
    }

    /// What one step of every colour is expected to take.
    pub fn round(&self) -> Duration {
        match &self.shared {
            Some(shared) => shared.expected(&self.colors),
            None => self.colors.iter().map(|c| c.refiner.expected()).sum(),
        }
    }

    /// Steps, colour by colour in turn, one of each at most, while `may_begin` says of each, told how many it is and what it is expected
    /// to take with what is under way before it, that it may; how many were taken. Of colours that share their sub-frames it is asked
    /// once, for as many steps as there are colours. A colour whose loss is no finite number begins
    /// again. On a device the last ones are under way when this returns: [`settle`](Self::settle) waits for them.
    ///
    /// # Errors
    /// Those of the engines.
    pub fn round_while(&mut self, mut may_begin: impl FnMut(u32, Duration) -> bool) -> Result<u32, EngineError> {
        if self.shared.is_some() {
            return self.step_together(&mut may_begin);
        }
        for taken in 0..self.colors.len() as u32 {
            let backlog: Duration = self.colors.iter().map(|c| c.refiner.backlog()).sum();
            let color = &mut self.colors[self.next];
            if !may_begin(1, backlog + color.refiner.expected()) {
                return Ok(taken);
            }
            let loss = color.refiner.advance()?;
            color.heard(loss)?;
            self.next = (self.next + 1) % self.colors.len();
            self.steps += 1;
        }
        Ok(self.colors.len() as u32)
    }

    /// Waits for the steps that are under way.
    ///
    /// # Errors
    /// Those of the engines.
    pub fn settle(&mut self) -> Result<(), EngineError> {
        for color in &mut self.colors {
            let loss = color.refiner.settle()?;
            color.heard(loss)?;
        }
        Ok(())
    }

    /// The phases as they are now, colour by colour: (frames, height, width), radians.
    ///
    /// # Errors
    /// Those of the engines.
    pub fn phases(&mut self) -> Result<PhasesOfColors<'_>, EngineError> {
        if let Some(shared) = &self.shared {
            return Ok(shared.phases().iter().map(Vec::as_slice).collect());
        }
        for color in &mut self.colors {
            color.refiner.phases_into(&mut color.phases)?;
        }
        let Some((field, _)) = &mut self.field else {
            return Ok(self.colors.iter().map(|c| c.phases.as_slice()).collect());
        };
        self.colors.iter().enumerate().for_each(|(i, color)| field.put(i, &color.phases));
        Ok(field.phases.iter().map(Vec::as_slice).collect())
    }

    /// The phases where they are, colour by colour, if all of them are in a device's memory: for an encoder on that device.
    pub fn phases_on_device(&self) -> Option<Vec<PhasesOnDevice<'_>>> {
        // The rest of a far field is on the host, and so are drives that colours share.
        let alone = self.field.is_none() && self.shared.is_none();
        self.colors.iter().map(|color| color.refiner.phases_on_device().filter(|_| alone)).collect()
    }

    /// How often it began again, and how many steps it took.
    pub fn counts(&self) -> [u64; 2] {
        [self.restarts, self.steps]
    }
}

/// The middle of a piece of a far field, and how far it goes from there, metres.
fn reach_of(problem: &Problem) -> ([f64; 2], [f64; 2]) {
    let optics = &problem.optics;
    (optics.center(), [optics.width, optics.height].map(|n| n as f64 * optics.pitch / 2.0))
}

/// An aim as near as its pupils are within a piece: until the piece around the eye is there, the one before goes on.
fn within(aim: PupilDistribution, ([x, y], [right, below]): ([f64; 2], [f64; 2])) -> PupilDistribution {
    let near = |at: f64, middle: f64, reach: f64| {
        let room = (reach - aim.reach()).max(0.0);
        at.clamp(middle - room, middle + room)
    };
    PupilDistribution { centre: [near(aim.centre[0], x, right), near(aim.centre[1], y, below)], ..aim }
}
