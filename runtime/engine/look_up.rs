//! First phases by a table, on whatever engine holds the phases.

use super::EngineError;
use crate::scene::Pyramid;
use eyebox_kernels::pupil_light::{self, Share, pupil_light};
use eyebox_kernels::table_start::{self, LEVELS, table_start};
use rayon::prelude::*;
use std::sync::Arc;

/// A table, and the picture whose phases are looked up in it.
#[derive(Debug, Clone)]
pub struct LookUp {
    /// Binary angles (sub-frames, side, side, levels).
    pub table: Arc<[u16]>,
    /// The views, which an engine that runs them has already.
    pub views: Arc<Pyramid>,
    /// Which of them are seen, each by its share.
    pub shares: Vec<Share>,
    /// Where the SLM lies in the views, as the host has them.
    pub place: pupil_light::Args,
    /// Sizes and brightness, of phases as the host has them.
    pub args: table_start::Args,
    /// What each pixel [needs](table_start::need) because it has other light; none where all have the same.
    pub needs: Option<Arc<[u32]>>,
}

impl LookUp {
    /// The phases (sub-frames, height, width), radians in -pi .. pi: whole binary angles, computed on the host.
    ///
    /// # Errors
    /// Views on a device that does not answer.
    pub fn phases(&self) -> Result<Vec<f32>, EngineError> {
        let mut phases = vec![0.0; self.count()];
        self.phases_into(&mut phases)?;
        Ok(phases)
    }

    /// How many phases that is.
    pub(super) fn count(&self) -> usize {
        [self.args.frames, self.args.height, self.args.width].map(|n| n as usize).iter().product()
    }

    /// The same into memory of their number that is there already: new memory takes longer than the look-up.
    pub(super) fn phases_into(&self, phases: &mut [f32]) -> Result<(), EngineError> {
        let views = super::on_host(&self.views)?;
        let pixels = (self.args.height * self.args.width) as usize;
        let (mut light, mut places) = (vec![0; pixels], vec![0; pixels]);
        pupil_light(&self.place, &views.levels[0].views, &self.shares, &mut light);
        table_start::places(&self.args, &light, self.needs.as_deref(), &mut places);
        let tile = (self.args.side * self.args.side) as usize * LEVELS;
        let frames = phases.par_chunks_mut(pixels).zip(self.table.par_chunks(tile));
        frames.for_each(|(phases, table)| table_start(&self.args, &places, table, phases));
        Ok(())
    }
}
