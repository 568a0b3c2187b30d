//! What stands between phases and field where the display is more than its phases: over pairs of sub-frames.

use super::call::Call;
use crate::engine::{EngineError, Resource};
use bytemuck::Pod;

impl Call<'_, '_> {
    pub(super) fn drive(&mut self) -> Result<(), EngineError> {
        let (step, place) = (self.step, self.shape.place);
        self.pairs([place.grid_height, place.grid_width], &step.drive, &[])
    }

    /// All sub-frames at once, in either direction.
    pub(super) fn lag(&mut self) -> Result<(), EngineError> {
        let layout = self.layout(Resource::Wave)?;
        if self.work.at_once(&layout) < layout.frames {
            return Err(self.work.too_large("lag over all sub-frames", layout.frames));
        }
        let Some(wave) = self.range(Resource::Wave, 0, 1)? else { return Ok(()) };
        let (frames, drive) = (self.shape.frames, &self.step.drive);
        let bits = [drive.settled(frames), drive.lag].map(f32::to_bits);
        let args = [self.shape.points() as u32, frames as u32, bits[0], bits[1], layout.stride() as u32];
        let wave = layout.range(wave.block, 0, layout.frames);
        let groups = self.work.along(self.shape.points(), 1);
        self.run(&[wave], &args, &[], groups)
    }

    pub(super) fn crosstalk(&mut self) -> Result<(), EngineError> {
        let place = self.shape.place;
        let size = [place.grid_height, place.grid_width];
        self.pairs(size, &size, &[])
    }

    pub(super) fn modulate_wave(&mut self) -> Result<(), EngineError> {
        let (place, scale) = (self.shape.place, self.shape.field_scale().to_bits());
        self.pairs([place.grid_height, place.grid_width], &place, &[scale])
    }

    pub(super) fn turn(&mut self) -> Result<(), EngineError> {
        let place = self.shape.place;
        self.pairs([place.grid_height, place.grid_width], &place, &[])
    }

    pub(super) fn drive_back(&mut self) -> Result<(), EngineError> {
        let (step, place) = (self.step, self.shape.place);
        self.pairs([place.height, place.width], &step.drive, &[])
    }

    /// Over rows and columns of as many pairs at once as the device allows. Push constants are the arguments, `more`, how many
    /// sub-frames there are, and the strides in the order of the bindings.
    fn pairs(&mut self, [rows, columns]: [u32; 2], args: &impl Pod, more: &[u32]) -> Result<(), EngineError> {
        let is_framed = |resource: Resource| resource == Resource::Wave || resource.per_frame().is_some();
        let each = |resource: Resource| if resource == Resource::Wave { 1 } else { 2 };
        let binds = self.kernel.binds();
        let (mut most, mut strides) = (usize::MAX, Vec::with_capacity(3));
        for (_, resource) in binds.iter().filter(|(_, resource)| is_framed(*resource)) {
            let layout = self.layout(*resource)?;
            most = most.min(self.work.at_once(&layout) / each(*resource));
            strides.push(layout.stride() as u32);
        }
        let frames = self.shape.frames;
        for (first, count) in self.work.chunks(frames.div_ceil(2), most) {
            let here = (2 * count).min(frames - 2 * first);
            let mut buffers = Vec::with_capacity(binds.len());
            for (_, resource) in binds {
                let Some(whole) = self.range(*resource, 0, 1)? else { return Ok(()) };
                buffers.push(match (is_framed(*resource), *resource) {
                    (true, Resource::Wave) => self.layout(*resource)?.range(whole.block, first, count),
                    (true, _) => self.layout(*resource)?.range(whole.block, 2 * first, here),
                    _ => whole,
                });
            }
            let groups = self.work.rows(rows, columns, count);
            let more: Vec<u32> = more.iter().chain(&[here as u32]).chain(&strides).copied().collect();
            self.run(&buffers, args, &more, groups)?;
        }
        Ok(())
    }
}
