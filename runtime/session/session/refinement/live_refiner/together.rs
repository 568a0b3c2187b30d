//! Refines colors that share the drives of their sub-frames together (simultaneous color, OPTICS 13).

use super::{Followed, LiveColor, LiveRefiner, OneColor, PhasesOfColors};
use crate::encode::Lighting;
use crate::engine::EngineError;
use crate::optics::{Laser, drives_of};
use crate::session::frame_log::error::SessionError;
use crate::solve::{Problem, Refiner, SharedDrives};
use eyebox_base::error::Reason;
use eyebox_base::reason;
use std::time::Duration;

impl AsRef<Refiner> for OneColor {
    fn as_ref(&self) -> &Refiner {
        &self.refiner
    }
}

impl AsMut<Refiner> for OneColor {
    fn as_mut(&mut self) -> &mut Refiner {
        &mut self.refiner
    }
}

/// Returns the sub-frames of these colors in a set, which are their own or the shared ones.
pub(in crate::session) fn sub_frames_of(colors: &[LiveColor]) -> usize {
    let each = colors.iter().map(LiveColor::frames);
    if share(colors) { each.max().unwrap_or(0) } else { each.sum() }
}

/// Returns true if these colors share their sub-frames.
pub(in crate::session) fn share(colors: &[LiveColor]) -> bool {
    colors.iter().any(|color| color.laser.is_some())
}

/// Returns the times at which the sub-frames of these colors are lit, from the lighting of the encoder for the colors
/// that it sends.
pub fn lighting_of(lighting: Lighting, colors: &[LiveColor]) -> Lighting {
    if share(colors) { lighting.shared_by(colors.len()) } else { lighting }
}

impl LiveRefiner {
    /// Returns the lasers of colors that share their sub-frames, or `None` if no color has a laser of its own.
    ///
    /// # Errors
    /// Returns [`SessionError::Setting`] if only some colors have a laser, and [`SessionError::Solve`] for colors that
    /// cannot share drives.
    pub(super) fn lasers_of(colors: &[LiveColor]) -> Result<Option<Vec<Laser>>, SessionError> {
        let lit = || colors.iter().filter_map(|color| color.laser.as_ref());
        match lit().count() {
            0 => Ok(None),
            all if all == colors.len() => {
                SharedDrives::check(colors.iter().map(|color| &color.problem).zip(lit()))?;
                Ok(Some(lit().cloned().collect()))
            }
            some => Err(reason!(
                "together",
                "only {some} of {} colors share their sub-frames, but either all or none must share them",
                colors.len()
            )
            .into()),
        }
    }

    /// Returns the drives from which these colors have their phases, as phases of one turn.
    pub(super) fn drives_of(lasers: &[Laser], colors: &[LiveColor]) -> Vec<f32> {
        let slopes: Vec<f64> = lasers.iter().map(|laser| laser.slope).collect();
        drives_of(&slopes, |color| &colors[color].phases)
    }

    /// Returns the phases that an SLM receives. These are the phases of every color, or the drives that all of them
    /// share.
    ///
    /// # Errors
    /// Returns the errors of the engines.
    pub fn sent(&mut self) -> Result<PhasesOfColors<'_>, EngineError> {
        match self.shared {
            Some(ref shared) => Ok(std::iter::once(shared.sent()).collect()),
            None => self.phases(),
        }
    }

    /// Takes a step of all colors if `may_begin` allows as many steps. Returns the number of steps.
    pub(super) fn step_together(
        &mut self,
        may_begin: &mut dyn FnMut(u32, Duration) -> bool,
    ) -> Result<u32, EngineError> {
        let (count, colors) = (self.colors.len() as u32, &mut self.colors);
        let Some(shared) = self.shared.as_mut().filter(|shared| may_begin(count, shared.expected(colors))) else {
            return Ok(0);
        };
        if shared.step(colors)?.is_finite() {
            colors.iter_mut().zip(shared.losses()).for_each(|(color, loss)| color.loss = Some(*loss));
        } else {
            shared.begin_again(colors)?;
        }
        self.steps += u64::from(count);
        Ok(count)
    }

    /// Returns the mean of the losses of the colors through the pupils of the next step.
    fn loss_together(&mut self) -> Result<f64, EngineError> {
        let mut sum = 0.0;
        for color in &mut self.colors {
            sum += color.refiner.loss()?;
        }
        Ok(sum / self.colors.len().max(1) as f64)
    }

    /// Applies [`shift_phases`](Self::shift_phases) to the drives that all colors share, which have one pixel size.
    pub(super) fn carry_together(
        &mut self,
        pixels: &[[i64; 2]],
        lighting: &Lighting,
        look: bool,
    ) -> Result<(bool, u32), EngineError> {
        let of = |turn: &usize| pixels.get(*turn).map_or([0.0; 2], |pixels| pixels.map(|p| p as f64));
        let shifts: Vec<[f64; 2]> = lighting.turn_of(0).iter().map(of).collect();
        if shifts.iter().all(|shift| *shift == [0.0; 2]) {
            return Ok((true, 0));
        }
        let before = if look { Some(self.loss_together()?) } else { None };
        let Some(shared) = &mut self.shared else { return Ok((false, 0)) };
        if !shared.shift_drives(&shifts, &mut self.colors)? {
            return Ok((false, 0));
        }
        let Some(before) = before else { return Ok((true, 0)) };
        let moved = self.loss_together()? < before;
        if let Some(shared) = self.shared.as_mut().filter(|_| !moved) {
            let back: Vec<[f64; 2]> = shifts.iter().map(|shift| shift.map(|by| -by)).collect();
            shared.shift_drives(&back, &mut self.colors)?;
        }
        Ok((moved, 2 * self.colors.len() as u32))
    }

    /// Applies [`fit`](Self::fit) to the drive that all colors share. Returns the number of colors if the scene is a
    /// different picture in one of them.
    pub(super) fn fit_together(&mut self) -> Result<u32, EngineError> {
        let wanted = self.needs_reinit();
        self.colors.iter_mut().for_each(|color| color.needs_reinit = false);
        let table = self.colors.first().and_then(|color| color.table.clone());
        let Some((table, shared)) = table.zip(self.shared.as_mut()).filter(|_| wanted) else { return Ok(0) };
        let problems: Vec<&Problem> = self.colors.iter().map(|color| color.refiner.problem()).collect();
        let exposures: Vec<f64> = self.colors.iter().map(|color| color.refiner.exposure()).collect();
        let Some(drives) = table.drives(&problems, &exposures)? else { return Ok(0) };
        shared.restart(&drives, &mut self.colors)?;
        Ok(self.colors.len() as u32)
    }

    /// Refuses a scene whose lasers are not the lasers of the drives that all colors share.
    pub(super) fn check_lasers(&self, scene: &[LiveColor]) -> Result<(), SessionError> {
        let lasers = self.shared.as_ref().map_or(&[][..], SharedDrives::lasers);
        if scene.iter().zip(lasers).any(|(new, laser)| new.laser.as_ref() != Some(laser)) {
            let line = "the scene has other lasers, but the powers are fixed while simultaneous colors are refined";
            return Err(SessionError::Setting(Reason::new("other-lasers", line)));
        }
        Ok(())
    }

    /// Applies [`follow`](Self::follow) to colors that share their sub-frames and already have their new scene. They
    /// continue with one drive, or start with another one together.
    pub(super) fn follow_together(&mut self, scene: &[LiveColor]) -> Result<Followed, SessionError> {
        let Some(shared) = &self.shared else { return Ok(Followed::default()) };
        let drives = Self::drives_of(shared.lasers(), scene);
        let count = self.colors.len() as u32;
        let before = match self.aimed {
            Some(_) => Some((self.loss_together()?, self.sent()?[0].to_vec())),
            None => None,
        };
        if let Some(shared) = &mut self.shared {
            shared.begin_with(&drives, &mut self.colors)?;
        }
        let Some((loss, phases)) = before else { return Ok(Followed { own: count, ..Followed::default() }) };
        if loss < self.loss_together()?
            && let Some(shared) = &mut self.shared
        {
            shared.restart(&phases, &mut self.colors)?;
            return Ok(Followed { kept: count, looks: 2 * count, ..Followed::default() });
        }
        Ok(Followed { own: count, looks: 2 * count, ..Followed::default() })
    }
}
