//! One color of a hologram that is refined.

use crate::optics::Laser;
use crate::solve::Problem;

/// One colour: what is solved for, and the hologram for the whole eyebox.
#[derive(Debug, Clone)]
pub struct LiveColor {
    /// The scene before this wavelength.
    pub problem: Problem,
    /// (frames, height, width), radians.
    pub phases: Vec<f32>,
    /// What the phases were solved for.
    pub exposure: f64,
    /// Its laser, where all colours share their sub-frames (OPTICS 13).
    pub laser: Option<Laser>,
}

impl LiveColor {
    /// Its sub-frames.
    pub fn frames(&self) -> usize {
        let optics = &self.problem.optics;
        self.phases.len() / (optics.height * optics.width).max(1)
    }
}
