//! Records kernels with individual forms.

use super::call::{Call, Grid};
use crate::engine::{EngineError, PupilPass, Resource};
use eyebox_kernels::{SUM_WIDTH, intensity, motion};

/// Values, over all sub-frames, that a workgroup of `energy` adds up at once. They are 4096 per invocation.
const ENERGY_SHARE: u32 = 4096 * SUM_WIDTH;

impl Call<'_, '_> {
    /// Zeroes the buffers that the kernel writes.
    pub(super) fn clear(&mut self) -> Result<(), EngineError> {
        let stacks = self.work.stacks;
        for stack in self.kernel.writes().filter_map(|resource| stacks.find(resource)) {
            self.work.gpu.recorder.clear(stack.block.all());
        }
        Ok(())
    }

    pub(super) fn modulate(&mut self) -> Result<(), EngineError> {
        let place = self.shape.place;
        let grid = Grid::Rows(place.grid_height, place.grid_width);
        self.over(grid, |_, _| place, &[self.shape.field_scale().to_bits()])
    }

    /// Adds up patches in shares, because float32 loses the small end of a longer sum.
    pub(super) fn energy(&mut self) -> Result<(), EngineError> {
        let place = self.step.equalise_eyebox.place;
        let layout = self.layout(Resource::Field)?;
        let values = place.rows.div_ceil(place.patches) * place.columns.div_ceil(place.patches);
        for (first, count) in self.work.chunks(layout.frames, self.work.at_once(&layout)) {
            let share = (ENERGY_SHARE / count as u32).max(1);
            for begin in (0..values).step_by(share as usize) {
                let mut args = place;
                let later = first > 0 || begin > 0;
                args.accumulate |= u32::from(later);
                if later {
                    self.work.gpu.recorder.barrier();
                }
                let ranges = [self.range(Resource::Field, first, count)?, self.range(Resource::Energy, 0, 1)?];
                let [Some(field), Some(energy)] = ranges else { return Ok(()) };
                let more = [count as u32, layout.stride() as u32, begin, begin.saturating_add(share)];
                self.run(&[field, energy], &args, &more, [args.patches * args.patches, 1, 1])?;
            }
        }
        Ok(())
    }

    pub(super) fn check_finite(&mut self) -> Result<(), EngineError> {
        let Some(found) = self.range(Resource::NotFinite, 0, 1)? else { return Ok(()) };
        self.work.gpu.recorder.clear(found);
        self.work.gpu.recorder.barrier();
        self.values(self.shape.points(), &(self.shape.points() as u32))
    }

    pub(super) fn intensity(&mut self, pass: &PupilPass) -> Result<(), EngineError> {
        let later = self.mode > 0;
        let args = |first: usize, count: usize| {
            let accumulate = pass.intensity.accumulate | u32::from(first > 0 || later);
            intensity::Args { frames: count as u32, accumulate, ..pass.intensity }
        };
        self.over(Grid::Summed(pass.count()), args, &[])
    }

    /// Both directions are one module, with the index of the first sub-frame in the table as an argument.
    pub(super) fn motion(&mut self, pass: &PupilPass, back: bool) -> Result<(), EngineError> {
        let Some(args) = pass.motion_args(0, back) else { return Ok(()) };
        self.module = Some(&eyebox_spirv::MOTION);
        let from = |first: usize, _| motion::Args { first: first as u32, ..args };
        self.over(Grid::Rows(args.rows, args.columns), from, &[])
    }
}
