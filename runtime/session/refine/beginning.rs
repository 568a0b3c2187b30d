//! What the steps of a set begin with: the phases moved with the content, or others where it is another picture altogether.

use super::Refining;
use crate::optics::PupilDistribution;
use crate::session::error::SessionError;
use crate::session::journal::Decision;
use crate::solve::Motion;
use std::sync::atomic::Ordering;
use std::time::Instant;

impl Refining {
    /// Moves the phases with the content, to where it is at `light_ns`: how many losses were looked at.
    pub(super) fn carry(
        &mut self,
        light_ns: i64,
        pupil: &PupilDistribution,
        motion: &Motion,
    ) -> Result<u32, SessionError> {
        let Some((pixels, look)) = self.options.moments.carry(light_ns) else { return Ok(0) };
        if let Some(journal) = &self.options.journal {
            // What losses are looked at through.
            journal.steps(pupil, motion, 0);
            journal.keep(Decision::Carry { pixels, look });
        }
        let (moved, looks) = self.steerer.carry(pixels, look)?;
        self.options.moments.carried(pixels, moved);
        self.shared.carried.fetch_add(u64::from(moved), Ordering::Relaxed);
        Ok(looks)
    }

    /// Begins anew where the content is another picture altogether and that loses less: how many losses were looked at.
    pub(super) fn fit(&mut self, pupil: &PupilDistribution, motion: &Motion) -> Result<u32, SessionError> {
        if !self.steerer.wants_fit() {
            return Ok(0);
        }
        let begun = Instant::now();
        if let Some(journal) = &self.options.journal {
            journal.steps(pupil, motion, 0);
            journal.keep(Decision::Fit {});
        }
        let fitted = self.steerer.fit()?;
        if fitted.retrieved > 0 {
            self.options.moments.begun_again();
        }
        let mut taken = self.shared.taken.load();
        taken.kept_starts += u64::from(fitted.kept);
        taken.retrieved_starts += u64::from(fitted.retrieved);
        self.shared.taken.store(taken);
        let what = if fitted.retrieved > 0 { "retrieval" } else { "no retrieval" };
        self.options.track.span(what, self.scene.as_ref().map_or(0, |scene| scene.number), begun);
        Ok(fitted.looks)
    }
}
