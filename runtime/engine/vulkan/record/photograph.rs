//! What should be seen: photographs of the views.

use super::call::Call;
use crate::engine::{EngineError, Resource};
use eyebox_kernels::photograph::STRIP;

impl Call<'_, '_> {
    /// All pupil passes block by block of views: a pupil pass adds up in its accumulator what each block holds.
    pub(super) fn photograph(&mut self) -> Result<(), EngineError> {
        let (step, tables, views) = (self.step, self.work.tables, self.work.views);
        let (indices, count) = (self.dispatch.pupil_passes.clone(), self.slots.len());
        let shots = || {
            let shot = |(at, index): (usize, usize)| Some((at, index, step.pupil_passes[index].shot.as_ref()?));
            indices.clone().take(count).enumerate().filter_map(shot)
        };
        let rounds = shots().map(|(_, index, _)| tables.pupil_pass(index).taps.len()).max().unwrap_or(0);
        for round in 0..rounds.max(1) {
            if round > 0 {
                self.work.gpu.recorder.barrier();
            }
            for (at, index, shot) in shots() {
                self.at = at;
                let Some(level) = views.and_then(|v| v.levels.get(shot.level)) else { continue };
                let Some(accumulator) = self.range(Resource::Accumulator, 0, 1)? else { continue };
                let Some(part) = tables.pupil_pass(index).taps.get(round) else {
                    // A pupil that no view covers sees nothing.
                    if round == 0 && shot.args.accumulate == 0 {
                        self.work.gpu.recorder.clear(accumulator);
                    }
                    continue;
                };
                let mut args = shot.args;
                args.taps = part.count as u32;
                args.accumulate |= u32::from(round > 0);
                let buffers = [level.blocks[part.chunk].all(), tables.range(part.place)?, accumulator];
                let groups = self.work.rows(args.height.div_ceil(STRIP), args.width, 1);
                self.run(&buffers, &args, &[level.stride as u32], groups)?;
                // Two samples of halves a tap, in neighbouring blocks of nine rows.
                let pixels = u64::from(args.height) * u64::from(args.width);
                let [views, _, accumulator] = buffers;
                self.work.gpu.recorder.moved(|| {
                    let before = if args.accumulate == 0 { 0 } else { 4 * pixels };
                    let read = 2 * pixels * u64::from(args.taps) * 9 / 8;
                    vec![views.reads(read), accumulator.reads(before), accumulator.writes(4 * pixels)]
                });
            }
        }
        Ok(())
    }
}
