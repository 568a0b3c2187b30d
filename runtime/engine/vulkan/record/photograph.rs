//! What should be seen: photographs of the views, and how they come to a pupil's window.

use super::super::layout::{Kind, Slot};
use super::Work;
use crate::engine::{Dispatch, EngineError, PupilPass};
use eyebox_spirv as spirv;

/// Rows that an invocation of `photograph` takes at once.
const STRIP: u32 = 8;

impl Work<'_> {
    /// All pupil passes block by block of views: a pupil pass adds up in its accumulator what each block holds.
    pub(super) fn photograph(&mut self, dispatch: &Dispatch, slots: &[Slot]) -> Result<(), EngineError> {
        let (step, tables, arenas, views) = (self.step, self.tables, self.arenas, self.views);
        let shots = || {
            dispatch
                .pupil_passes
                .clone()
                .zip(slots)
                .filter_map(|(i, slot)| Some((i, slot, step.pupil_passes[i].shot.as_ref()?)))
        };
        let rounds = shots().map(|(i, ..)| tables.pupil_pass(i).taps.len()).max().unwrap_or(0);
        for round in 0..rounds.max(1) {
            self.gpu.recorder.barrier();
            for (index, slot, shot) in shots() {
                let Some(level) = views.and_then(|v| v.levels.get(shot.level)) else { continue };
                let accumulator = arenas.range(Kind::Accumulator, slot)?;
                let Some(part) = tables.pupil_pass(index).taps.get(round) else {
                    // A pupil that no view covers sees nothing.
                    if round == 0 && shot.args.accumulate == 0 {
                        self.gpu.recorder.clear(accumulator);
                    }
                    continue;
                };
                let mut args = shot.args;
                args.taps = part.count as u32;
                args.accumulate |= u32::from(round > 0);
                let buffers = [level.blocks[part.chunk].all(), tables.range(part.place)?, accumulator];
                let groups = self.rows(args.height.div_ceil(STRIP), args.width, 1);
                self.run(&spirv::PHOTOGRAPH, &buffers, &args, &[level.stride as u32], groups)?;
            }
        }
        Ok(())
    }

    pub(super) fn resample(&mut self, index: usize, pupil_pass: &PupilPass, slot: &Slot) -> Result<(), EngineError> {
        let Some(shot) = &pupil_pass.shot else { return Ok(()) };
        let (tables, arenas) = (self.tables, self.arenas);
        let pupil_pass_tables = tables.pupil_pass(index);
        let buffers = [
            arenas.range(Kind::Accumulator, slot)?,
            tables.range(pupil_pass_tables.rows)?,
            tables.range(pupil_pass_tables.columns)?,
            arenas.range(Kind::Target, slot)?,
        ];
        let groups = self.rows(shot.resample.height, shot.resample.width, 1);
        self.run(&spirv::RESAMPLE, &buffers, &shot.resample, &[], groups)
    }
}
