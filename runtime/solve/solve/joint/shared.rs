//! Drives that the refiners of all colours share (OPTICS 6d, 13): each asks for its own change through the same pupils, and what they
//! ask for is added up before the drives move.

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

/// The drives of a hologram of all colours at once under refinement. Whoever holds it holds the refiners of the colours, in their
/// order, and lets it step them. Their lasers' powers stay as they are: whoever drives the lasers has them before.
pub struct SharedDrives {
    pub(super) drives: Drives,
    lasers: Vec<Laser>,
    /// The colour whose phases are the drive; none on an SLM on which every colour makes more than a turn.
    sent_as: Option<usize>,
    /// What each colour has of the drives now, as its refiner has it.
    phases: Vec<Vec<f32>>,
    /// The drives as phases of one turn, where they are no colour's.
    sent: Vec<f32>,
    /// The drives to begin again with, as phases of one turn.
    kept: Vec<f32>,
    /// Room for the change that a colour asks for, and the losses of the last step.
    change: Vec<f32>,
    losses: Vec<f64>,
    /// Per sub-frame, what the colours' powers and slopes sum to, and the share of a colour's undiffracted light that is to go.
    norms: Vec<f64>,
    undiffracted: Vec<f64>,
    /// What steps of all colours take that draw pupils, and those that use the pupils of the step before.
    paces: [Pace; 2],
}

impl SharedDrives {
    /// Refuses colours that cannot share drives in the light of these lasers.
    ///
    /// # Errors
    /// [`SolveError::Setting`].
    pub fn check<'a>(colors: impl Iterator<Item = (&'a Problem, &'a Laser)>) -> Result<(), SolveError> {
        let (problems, slopes): (Vec<&Problem>, Vec<f64>) =
            colors.map(|(problem, laser)| (problem, laser.slope)).unzip();
        check::colors(&problems, &slopes)
    }

    /// Of these lasers before these colours, which can share drives, and were begun with the phases that they have of them; `drives` are
    /// given as phases of one turn.
    ///
    /// # Errors
    /// Those of the engines.
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

    /// One step of all colours; its loss, the mean over them. With one that is no finite number the drives stay as they were.
    ///
    /// # Errors
    /// Those of the engines.
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

    /// Adds up what the colours ask of the drives, and how these move; none where a loss is no finite number.
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
            // Even drives leave a mean where they make no whole turns alone; a gradient is that of the loss alone.
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

    /// The lasers of the colours.
    pub fn lasers(&self) -> &[Laser] {
        &self.lasers
    }

    /// The losses of the colours in the last step.
    pub fn losses(&self) -> &[f64] {
        &self.losses
    }

    /// What the next step of all colours is expected to take.
    pub fn expected<R: AsRef<Refiner>>(&self, colors: &[R]) -> Duration {
        let kind = colors.first().map_or(0, |color| color.as_ref().kind());
        Duration::from_secs_f64(self.paces[kind].expected())
    }

    /// The colours were aimed anew: where they forgot what they were refined for, velocities of the drives go, too.
    pub fn aimed<R: AsRef<Refiner>>(&mut self, colors: &[R]) {
        if colors.iter().all(|color| color.as_ref().is_new()) {
            self.drives.clear_moments();
        }
    }

    /// Begins again with the drives that it was made with, or was given [since](Self::begin_with).
    ///
    /// # Errors
    /// Those of the engines.
    pub fn begin_again<R: AsMut<Refiner>>(&mut self, colors: &mut [R]) -> Result<(), EngineError> {
        let kept = std::mem::take(&mut self.kept);
        let begun = self.restart(&kept, colors);
        self.kept = kept;
        begun
    }

    /// Other drives of the same hologram, which [`begin_again`](Self::begin_again) comes back to from now on.
    ///
    /// # Errors
    /// Those of the engines.
    pub fn begin_with<R: AsMut<Refiner>>(&mut self, drives: &[f32], colors: &mut [R]) -> Result<(), EngineError> {
        self.kept.copy_from_slice(drives);
        self.restart(drives, colors)
    }

    /// Begins again with other drives of the same hologram, as phases of one turn.
    ///
    /// # Errors
    /// Those of the engines.
    pub fn restart<R: AsMut<Refiner>>(&mut self, drives: &[f32], colors: &mut [R]) -> Result<(), EngineError> {
        self.drives.restart(drives);
        colors.iter_mut().for_each(|color| color.as_mut().count_anew());
        self.show(colors)
    }

    /// Goes on with each sub-frame's drives moved by whole pixels (x, y); whether they can be. In the far field a picture is moved by a
    /// phase that is laid over its own, another for each colour: no drive has all of them.
    ///
    /// # Errors
    /// Those of the engines.
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
            // As one colour's own: where all of them move, what moves them was another picture's.
            self.drives.clear_moments();
        }
        self.show(colors)?;
        Ok(true)
    }

    /// What each colour has of the drives: (frames, height, width), radians in -pi .. pi.
    pub fn phases(&self) -> &[Vec<f32>] {
        &self.phases
    }

    /// The drives themselves, as phases of one turn, which an SLM receives.
    pub fn sent(&self) -> &[f32] {
        self.sent_as.map_or(&self.sent, |color| &self.phases[color])
    }

    /// Gives each colour what it has of the drives.
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
