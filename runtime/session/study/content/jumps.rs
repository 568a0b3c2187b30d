//! What is begun with after content has jumped, and what the eye sees then.

use super::{ContentRun, ContentSample, Showing, SteeredColor};
use crate::session::error::SessionError;
use crate::session::study::jump_start::JumpStart;
use crate::solve::random_phases;

impl ContentRun {
    /// Mean of the sets outside saccades that are the `nth` after a jump, from 1, dB; none where there is none.
    pub fn after_jumps(&self, nth: u32) -> Option<f64> {
        let first = self.samples.iter().position(|s| s.jumped).unwrap_or(self.samples.len());
        let of = |s: &&ContentSample| !s.saccade && s.since_jump + 1 == nth;
        let all: Vec<f64> = self.samples[first..].iter().filter(of).map(|s| s.db).collect();
        (!all.is_empty()).then(|| all.iter().sum::<f64>() / all.len() as f64)
    }
}

impl Showing<'_> {
    /// Begins with what is studied, where the content has jumped: how many steps that takes.
    pub(super) fn begin(&mut self) -> Result<u32, SessionError> {
        let jumped = std::mem::take(&mut self.begins);
        match self.frames.settings.start {
            JumpStart::Best if self.steerer.wants_fit() => {
                if self.steerer.fit()?.looked_up > 0 {
                    self.moments.begun_again();
                }
                // Two losses that are looked at take a step's time.
                Ok(2)
            }
            JumpStart::Table if jumped => {
                self.steerer.look_up()?;
                Ok(0)
            }
            JumpStart::Random if jumped => {
                let one = |(i, color): (usize, &SteeredColor)| random_phases(color.phases.len(), i as u64);
                let random: Vec<_> = self.frames.colors.iter().enumerate().map(one).collect();
                self.steerer.begin_with(&random)?;
                Ok(0)
            }
            _ => Ok(0),
        }
    }
}
