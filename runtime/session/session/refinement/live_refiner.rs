//! Refines all colors of a hologram without threads, with the aim, the restarts and the order of steps.

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

/// The smallest spread of a pupil for the solver (m). No tracker is more precise.
const SHARPEST: f64 = 0.1e-3;
const MOST_COLORS: usize = 3;

/// Opens an engine each time it is called.
pub type EngineOpener = Box<dyn FnMut() -> Result<Box<dyn Engine>, EngineError> + Send>;

/// The policy of the refinement for the tracked pupil.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Policy {
    /// The size of a jump, in pupil diameters, after which refinement starts again from the hologram for the whole
    /// eyebox. An infinite value means never.
    pub restart: f64,
    /// The settings of the refinement.
    pub steering: RefineSettings,
}

impl Default for Policy {
    fn default() -> Self {
        Self { restart: 0.5, steering: RefineSettings::default() }
    }
}

struct OneColor {
    refiner: Refiner,
    /// The phases as they were read last.
    phases: Vec<f32>,
    /// The loss of the last step.
    loss: Option<f64>,
    /// For a piece of a far field, its middle and its reach from there (m).
    piece: Option<([f64; 2], [f64; 2])>,
    /// The table of first phases for pictures that bring no phases.
    table: Option<Arc<StartTable>>,
    /// True if the scene is a different picture, for which no first phases were chosen yet.
    needs_reinit: bool,
}

/// The phases of each color as they are read for every set (frames, height, width), in radians.
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

/// The start of refinement for another scene.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Followed {
    /// The colors that started with the phases of the scene.
    pub own: u32,
    /// The colors that continued with the previous phases, although the scene brought others.
    pub kept: u32,
    /// The losses that were compared for the decision.
    pub looks: u32,
}

impl OneColor {
    /// Takes the loss of a finished step, if there is one. After a loss that is not finite, refinement starts again.
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

/// All colors, each with its engine.
pub struct LiveRefiner {
    colors: Vec<OneColor>,
    policy: Policy,
    next: usize,
    /// The aim of the last steps.
    aimed: Option<PupilDistribution>,
    restarts: u64,
    steps: u64,
    /// For a far field, all of its phases, and the function that opens an engine for another piece.
    field: Option<(Field, EngineOpener)>,
    /// The pixels by which each sub-frame of a color is shifted.
    shifts: Vec<[f64; 2]>,
    /// The drives, if all colors share them.
    shared: Option<SharedDrives>,
}

impl LiveRefiner {
    /// Starts with the holograms for the whole eyebox. `engine` opens an engine for each color.
    ///
    /// # Errors
    /// Returns [`SessionError::Setting`] for no color or a policy that is not valid, and the errors of [`Refiner::new`]
    /// and `engine`.
    pub fn new(
        colors: Vec<LiveColor>,
        policy: Policy,
        mut engine: impl FnMut() -> Result<Box<dyn Engine>, EngineError>,
    ) -> Result<Self, SessionError> {
        if colors.is_empty() {
            return Err(reason!("no-color", "there is no color to refine").into());
        }
        if colors.len() > MOST_COLORS {
            let count = colors.len();
            return Err(
                reason!("colors-count", "{count} colors to refine, but a display has at most {MOST_COLORS}").into()
            );
        }
        if policy.restart.is_nan() || policy.restart < 0.0 {
            let wrong = policy.restart;
            return Err(reason!("restart", "`restart` {wrong}: it must be 0 or more pupil diameters").into());
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

    /// States that the refined `colors` are a piece of this far field. `engine` opens an engine for every further piece
    /// of each color.
    #[must_use]
    pub fn in_field(mut self, colors: &[LiveColor], field: Field, engine: EngineOpener) -> Self {
        for (color, begun) in self.colors.iter_mut().zip(colors) {
            color.piece = Some(reach_of(&begun.problem));
        }
        Self { field: Some((field, engine)), ..self }
    }

    /// Refines another piece of the far field from now on. The refined phases of the previous piece stay in the far
    /// field.
    ///
    /// The piece starts with its present phases or with its solved phases, whichever have the lower loss through the
    /// pupils of the next step.
    ///
    /// # Errors
    /// Returns [`SessionError::Setting`] for a piece of no far field, and the errors of the engines.
    pub fn move_to(&mut self, piece: TileRect, colors: &[LiveColor]) -> Result<Followed, SessionError> {
        self.settle()?;
        self.phases()?;
        let Some((field, engine)) = self.field.as_mut().filter(|_| colors.len() == self.colors.len()) else {
            return Err(reason!("other-piece", "the piece belongs to a different hologram than the refined one").into());
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

    /// Aims at the predicted pupil. Returns true if refinement starts again from the hologram for the whole eyebox.
    ///
    /// It does so after a jump, because the refined phases gained for another place and lost a little everywhere else.
    ///
    /// # Errors
    /// Returns the errors of the engines.
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

    /// Sets the motion during the light of a set, in pixels of the first color. `times` are the times of the sub-frames
    /// of each color.
    ///
    /// # Errors
    /// Returns [`SessionError::Solve`](SessionError) for a motion that is not valid.
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

    /// Returns the motion of each color.
    pub fn motions(&self) -> Vec<Motion> {
        self.colors.iter().map(|color| color.refiner.motion()).collect()
    }

    /// Shifts the phases by whole pixels (x, y) of the first color, as the picture moves.
    ///
    /// `pixels` holds the shift of the sub-frames that are lit with each turn of `lighting`. If `look` is true, the
    /// shift is kept only if it lowers the loss through the pupils of the next step. Returns true if the phases were
    /// shifted, and the number of losses that were compared.
    ///
    /// # Errors
    /// Returns the errors of the engines.
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

    /// Starts again from the hologram for the whole eyebox.
    ///
    /// # Errors
    /// Returns the errors of the engines.
    pub fn restart(&mut self) -> Result<(), EngineError> {
        self.aimed = None;
        self.restarts += 1;
        if let Some(shared) = &mut self.shared {
            return shared.begin_again(&mut self.colors);
        }
        self.colors.iter_mut().try_for_each(|c| c.refiner.begin_again())
    }

    /// Follows another scene before the same display.
    ///
    /// If the scene brings phases, which are its own hologram for the whole eyebox, [`restart`](Self::restart) returns
    /// to them from now on. Each color then continues with these phases or with the refined ones, whichever have the
    /// lower loss through the pupils of the next step. If the scene brings no phases, [`fit`](Self::fit) decides.
    ///
    /// # Errors
    /// Returns [`SessionError::Setting`] for a scene of other colors, and the errors of the engines.
    pub fn follow(&mut self, scene: &[LiveColor]) -> Result<Followed, SessionError> {
        if scene.len() != self.colors.len() {
            let (found, must) = (scene.len(), self.colors.len());
            return Err(reason!("colors-of-scene", "the scene has {found} colors, but {must} are refined").into());
        }
        self.check_lasers(scene)?;
        // Colors that share their drives start together or not at all.
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

    /// States that the refined phases are of no use for the next scene that brings phases.
    pub(crate) fn forget_aim(&mut self) {
        self.aimed = None;
    }

    /// Returns the estimated PSNR through the pupils of the last steps (dB), from the mean of the losses over the
    /// colors. It is `None` before every color took a step.
    pub fn estimated_db(&self) -> Option<f64> {
        let sum: f64 = self.colors.iter().map(|c| c.loss).sum::<Option<f64>>()?;
        Some(-10.0 * (sum / self.colors.len().max(1) as f64).max(1e-12).log10())
    }

    /// Returns the indices of the switchable sources of the display that are lit for each color.
    pub fn sources(&self) -> impl Iterator<Item = &[usize]> {
        self.colors.iter().map(|color| color.refiner.sources())
    }

    /// Starts again in the light that the holograms for the whole eyebox were solved for.
    pub(crate) fn show_whole(&mut self) -> Result<(), EngineError> {
        self.colors.iter_mut().for_each(|color| color.refiner.forget_sources());
        self.restart()
    }

    pub(crate) fn colors(&self) -> usize {
        self.colors.len()
    }

    /// Returns the expected time of one step of every color.
    pub fn round(&self) -> Duration {
        match &self.shared {
            Some(shared) => shared.expected(&self.colors),
            None => self.colors.iter().map(|c| c.refiner.expected()).sum(),
        }
    }

    /// Takes at most one step of each color in turn, while `may_begin` returns true. Returns the number of steps.
    ///
    /// `may_begin` receives the number of steps and their expected time, with the running steps before them. Colors
    /// that share their sub-frames call it once, for as many steps as there are colors.
    ///
    /// A color whose loss is not finite starts again. On a device the last steps still run when this returns, and
    /// [`settle`](Self::settle) waits for them.
    ///
    /// # Errors
    /// Returns the errors of the engines.
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

    /// Waits for the steps that still run.
    ///
    /// # Errors
    /// Returns the errors of the engines.
    pub fn settle(&mut self) -> Result<(), EngineError> {
        for color in &mut self.colors {
            let loss = color.refiner.settle()?;
            color.heard(loss)?;
        }
        Ok(())
    }

    /// Returns the present phases of each color (frames, height, width), in radians.
    ///
    /// # Errors
    /// Returns the errors of the engines.
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

    /// Returns the phases of each color in the memory of a device, for an encoder on that device. It is `None` unless
    /// all of them are there.
    pub fn phases_on_device(&self) -> Option<Vec<PhasesOnDevice<'_>>> {
        // The rest of a far field is on the host, and so are drives that colors share.
        let alone = self.field.is_none() && self.shared.is_none();
        self.colors.iter().map(|color| color.refiner.phases_on_device().filter(|_| alone)).collect()
    }

    /// Returns the number of restarts and the number of steps.
    pub fn counts(&self) -> [u64; 2] {
        [self.restarts, self.steps]
    }
}

/// Returns the middle of a piece of a far field and its reach from there (m).
fn reach_of(problem: &Problem) -> ([f64; 2], [f64; 2]) {
    let optics = &problem.optics;
    (optics.center(), [optics.width, optics.height].map(|n| n as f64 * optics.pitch / 2.0))
}

/// Moves an aim to the nearest place whose pupils are within a piece. The present piece stays in use until the piece
/// around the eye is read.
fn within(aim: PupilDistribution, ([x, y], [right, below]): ([f64; 2], [f64; 2])) -> PupilDistribution {
    let near = |at: f64, middle: f64, reach: f64| {
        let room = (reach - aim.reach()).max(0.0);
        at.clamp(middle - room, middle + room)
    };
    PupilDistribution { centre: [near(aim.centre[0], x, right), near(aim.centre[1], y, below)], ..aim }
}
