//! Chooses the phases that a set starts from, either shifted with the content or new ones for a different picture.

use super::Refining;
use crate::optics::PupilDistribution;
use crate::session::feeds::journal::{Decision, Moves, Shifts};
use crate::session::frame_log::error::SessionError;
use std::sync::atomic::Ordering;
use std::time::Instant;

impl Refining {
    /// Shifts the phases to the position of the content at their light, from `light_ns` on. Returns the number of
    /// losses that were compared.
    pub(super) fn shift_phases(
        &mut self,
        light_ns: i64,
        pupil: &PupilDistribution,
        moves: &Moves,
    ) -> Result<u32, SessionError> {
        let moments = &mut self.options.moments;
        let Some(look) = moments.find_shifts(light_ns, moves.turn) else { return Ok(0) };
        let Some((pixels, lighting)) = moments.shifts() else { return Ok(0) };
        if let Some(journal) = &self.options.journal {
            // The losses are compared through this pupil.
            journal.steps(pupil, moves, 0);
            journal.keep(Decision::Carry { pixels: Shifts::of(pixels), look });
        }
        let (moved, looks) = self.refiner.shift_phases(pixels, lighting, look)?;
        moments.carried(moved);
        self.shared.carried.fetch_add(u64::from(moved), Ordering::Relaxed);
        Ok(looks)
    }

    /// Starts with other phases if the content is a completely different picture.
    pub(super) fn fit(&mut self, pupil: &PupilDistribution, moves: &Moves) -> Result<(), SessionError> {
        if !self.refiner.needs_reinit() {
            return Ok(());
        }
        let begun = Instant::now();
        if let Some(journal) = &self.options.journal {
            journal.steps(pupil, moves, 0);
            journal.keep(Decision::Fit {});
        }
        let looked_up = self.refiner.fit()?;
        self.options.moments.begun_again();
        let mut taken = self.shared.taken.load();
        taken.looked_up_starts += u64::from(looked_up);
        self.shared.taken.store(taken);
        self.options.track.span("look-up", self.scene.as_ref().map_or(0, |scene| scene.number), begun);
        Ok(())
    }
}
