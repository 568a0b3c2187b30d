//! Starts the refinement after content has jumped, and averages the scores after jumps.

use super::{ContentDisplay, ContentRun, ContentSample, LiveColor};
use crate::study::jump_start::JumpStart;
use eyebox::low_level::session::SessionError;
use eyebox::low_level::solve::random_phases;

impl ContentRun {
    /// Returns the mean score, in dB, of the sets outside saccades that are the `nth` after a jump, counted from 1.
    /// Returns `None` if there is no such set.
    pub fn after_jumps(&self, nth: u32) -> Option<f64> {
        let first = self.samples.iter().position(|s| s.jumped).unwrap_or(self.samples.len());
        let of = |s: &&ContentSample| !s.saccade && s.since_jump + 1 == nth;
        let all: Vec<f64> = self.samples[first..].iter().filter(of).map(|s| s.db).collect();
        (!all.is_empty()).then(|| all.iter().sum::<f64>() / all.len() as f64)
    }
}

impl ContentDisplay<'_> {
    /// Starts the refinement from the studied phases if the content has jumped.
    pub(super) fn begin(&mut self) -> Result<(), SessionError> {
        let jumped = std::mem::take(&mut self.begins);
        match self.frames.settings.start {
            JumpStart::Table if self.refiner.needs_reinit() => {
                self.refiner.fit()?;
                self.moments.begun_again();
            }
            JumpStart::Random if jumped => {
                let one = |(i, color): (usize, &LiveColor)| random_phases(color.phases.len(), i as u64);
                let random: Vec<_> = self.frames.colors.iter().enumerate().map(one).collect();
                self.refiner.begin_with(&random)?;
            }
            _ => {}
        }
        Ok(())
    }
}
