//! Holds the drive values that the refiners of all colors share (OPTICS 6d, 13).
//!
//! Each refiner requests its own change through the same pupils, and the changes are added up before the drive values
//! move.

use super::check;
use super::drives::Drives;
use crate::engine::EngineError;
use crate::optics::{Geometry, Laser};
use crate::solve::carry::move_frame;
use crate::solve::error::SolveError;
use crate::solve::pace::Pace;
use crate::solve::problem::Problem;
use crate::solve::steer::Refiner;
use crate::solve::step::Turns;
use std::time::{Duration, Instant};

/// The drive values of a hologram of all colors at once under refinement.
///
/// The owner holds the refiners of the colors in their order and passes them to each step. The powers of the lasers
/// stay the same, so the driver of the lasers can receive them in advance.
pub struct SharedDrives {
    pub(super) drives: Drives,
    lasers: Vec<Laser>,
    /// The color whose phases are the drive values. `None` on an SLM on which every color makes more than a turn.
    sent_as: Option<usize>,
    /// The current phases of each color, as its refiner has them.
    phases: Vec<Vec<f32>>,
    /// The drive values as phases of one turn, if no color has these phases.
    sent: Vec<f32>,
    /// The drive values for a restart, as phases of one turn.
    kept: Vec<f32>,
    /// Memory for the change that a color requests, and the losses of the last step.
    change: Vec<f32>,
    losses: Vec<f64>,
    /// Per sub-frame, the sum of the colors' powers times slopes squared, and the share of a color's undiffracted light
    /// that is removed.
    norms: Vec<f64>,
    undiffracted: Vec<f64>,
    /// Durations of the steps of all colors that draw pupils, and of the steps that reuse the pupils of the step
    /// before.
    paces: [Pace; 2],
}

impl SharedDrives {
    /// Returns an error for colors that cannot share drive values in the light of these lasers.
    ///
    /// # Errors
    /// [`SolveError::Setting`] for the first reason.
    pub fn check<'a>(colors: impl Iterator<Item = (&'a Problem, &'a Laser)>) -> Result<(), SolveError> {
        let (problems, slopes): (Vec<&Problem>, Vec<f64>) =
            colors.map(|(problem, laser)| (problem, laser.slope)).unzip();
        check::colors(&problems, &slopes)
    }

    /// Starts with these lasers and colors, which can share drive values. The colors were started with their phases of
    /// these drive values, which `drives` holds as phases of one turn.
    ///
    /// # Errors
    /// [`EngineError`] if an engine fails.
    pub fn new<R: AsMut<Refiner>>(drives: &[f32], lasers: Vec<Laser>, colors: &mut [R]) -> Result<Self, EngineError> {
        let mut size = [1; 2];
        let mut changes = 0;
        for color in &mut *colors {
            let refiner = color.as_mut();
            (size, changes) = ([refiner.problem().optics.height, refiner.problem().optics.width], refiner.changes());
        }
        let frames = drives.len() / (size[0] * size[1]).max(1);
        let norm = |f: usize| lasers.iter().map(|l| l.powers.get(f).unwrap_or(&0.0) * l.slope * l.slope).sum();
        let sent_as = lasers.iter().position(|laser| laser.slope == 1.0);
        let mut shared = Self {
            drives: Drives::new(drives, size),
            sent: if sent_as.is_some() { Vec::new() } else { vec![0.0; drives.len()] },
            sent_as,
            phases: vec![vec![0.0; drives.len()]; lasers.len()],
            kept: drives.to_vec(),
            change: vec![0.0; changes],
            losses: vec![f64::NAN; lasers.len()],
            norms: (0..frames).map(norm).collect(),
            undiffracted: vec![0.0; frames],
            paces: Default::default(),
            lasers,
        };
        shared.show(colors)?;
        Ok(shared)
    }

    /// Takes one step of all colors and returns the mean loss over them. If the loss is not a finite number, the drive
    /// values stay as they were.
    ///
    /// # Errors
    /// [`EngineError`] if an engine fails.
    pub fn step<R: AsMut<Refiner>>(&mut self, colors: &mut [R]) -> Result<f64, EngineError> {
        let start = Instant::now();
        let kind = colors.first_mut().map_or(0, |color| color.as_mut().kind());
        if let Some(turns) = self.ask(colors)? {
            self.drives.turn(&turns, &self.norms, self.lasers.len());
            self.show(colors)?;
            self.paces[kind].took(start.elapsed().as_secs_f64());
        }
        Ok(self.losses.iter().sum::<f64>() / self.losses.len().max(1) as f64)
    }

    /// Adds up the changes that the colors request, and returns the data for the move. The result is `None` if a loss
    /// is not a finite number.
    pub(super) fn ask<R: AsMut<Refiner>>(&mut self, colors: &mut [R]) -> Result<Option<Turns>, EngineError> {
        let mut how = None;
        for (i, color) in colors.iter_mut().enumerate() {
            let (loss, turns) = color.as_mut().ask(&mut self.change)?;
            self.losses[i] = loss;
            if !loss.is_finite() {
                self.drives.forget_asked();
                return Ok(None);
            }
            let Laser { slope, powers } = &self.lasers[i];
            // Even drive values leave a mean unless they make whole turns. A gradient is the derivative of the loss
            // alone.
            let pulls = turns.projects && slope.fract() != 0.0;
            self.undiffracted
                .iter_mut()
                .zip(powers)
                .for_each(|(share, power)| *share = if pulls { *power } else { 0.0 });
            self.drives.ask(*slope, &self.phases[i], &self.change, &self.undiffracted, &turns);
            how = Some(turns);
        }
        Ok(how)
    }

    /// Returns the lasers of the colors.
    pub fn lasers(&self) -> &[Laser] {
        &self.lasers
    }

    /// Returns the losses of the colors in the last step.
    pub fn losses(&self) -> &[f64] {
        &self.losses
    }

    /// Returns the expected duration of the next step of all colors.
    pub fn expected<R: AsRef<Refiner>>(&self, colors: &[R]) -> Duration {
        let kind = colors.first().map_or(0, |color| color.as_ref().kind());
        Duration::from_secs_f64(self.paces[kind].expected())
    }

    /// Follows a new aim of the colors. If the colors cleared their velocities, the velocities of the drive values are
    /// cleared too.
    pub fn aimed<R: AsRef<Refiner>>(&mut self, colors: &[R]) {
        if colors.iter().all(|color| color.as_ref().is_new()) {
            self.drives.clear_moments();
        }
    }

    /// Restarts with the original drive values, or with the values of the last [`begin_with`](Self::begin_with).
    ///
    /// # Errors
    /// [`EngineError`] if an engine fails.
    pub fn begin_again<R: AsMut<Refiner>>(&mut self, colors: &mut [R]) -> Result<(), EngineError> {
        let kept = std::mem::take(&mut self.kept);
        let begun = self.restart(&kept, colors);
        self.kept = kept;
        begun
    }

    /// Restarts with other drive values of the same hologram, to which [`begin_again`](Self::begin_again) returns from
    /// now on.
    ///
    /// # Errors
    /// [`EngineError`] if an engine fails.
    pub fn begin_with<R: AsMut<Refiner>>(&mut self, drives: &[f32], colors: &mut [R]) -> Result<(), EngineError> {
        self.kept.copy_from_slice(drives);
        self.restart(drives, colors)
    }

    /// Restarts with other drive values of the same hologram, as phases of one turn.
    ///
    /// # Errors
    /// [`EngineError`] if an engine fails.
    pub fn restart<R: AsMut<Refiner>>(&mut self, drives: &[f32], colors: &mut [R]) -> Result<(), EngineError> {
        self.drives.restart(drives);
        colors.iter_mut().for_each(|color| color.as_mut().count_anew());
        self.show(colors)
    }

    /// Moves each sub-frame's drive values by whole pixels (x, y), and returns true if this is possible.
    ///
    /// In the far field a picture moves by a phase that is added to its own and differs per color. No drive value has
    /// all of them.
    ///
    /// # Errors
    /// [`EngineError`] if an engine fails.
    pub fn shift_drives<R: AsMut<Refiner>>(
        &mut self,
        shifts: &[[f64; 2]],
        colors: &mut [R],
    ) -> Result<bool, EngineError> {
        let Some(color) = colors.first_mut() else { return Ok(false) };
        let optics = color.as_mut().problem().optics;
        if optics.geometry == Geometry::FarField {
            return Ok(false);
        }
        let shift = |frame: usize| shifts.get(frame).copied().unwrap_or_default();
        self.drives.shift_frames(|from, to, frame| move_frame(from, to, [&optics; 2], shift(frame)));
        if shifts.iter().all(|shift| *shift != [0.0; 2]) {
            // If all sub-frames move, the moments belong to another picture, as for a single color.
            self.drives.clear_moments();
        }
        self.show(colors)?;
        Ok(true)
    }

    /// Returns the phases of each color (frames, height, width), radians in -pi .. pi.
    pub fn phases(&self) -> &[Vec<f32>] {
        &self.phases
    }

    /// Returns the drive values as phases of one turn, which an SLM receives.
    pub fn sent(&self) -> &[f32] {
        self.sent_as.map_or(&self.sent, |color| &self.phases[color])
    }

    /// Gives each color its phases of the drive values.
    fn show<R: AsMut<Refiner>>(&mut self, colors: &mut [R]) -> Result<(), EngineError> {
        for ((color, laser), phases) in colors.iter_mut().zip(&self.lasers).zip(&mut self.phases) {
            self.drives.phases_into(laser.slope, phases);
            color.as_mut().show(phases)?;
        }
        if self.sent_as.is_none() {
            self.drives.phases_into(1.0, &mut self.sent);
        }
        Ok(())
    }
}
