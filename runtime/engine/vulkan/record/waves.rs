//! What stands between phases and field where the display is more than its phases: over sub-frames and their sub-pixels.

use super::super::fft::{Along, Frames};
use super::call::{Call, frames_of};
use super::fused::Lines;
use crate::engine::{EngineError, Resource};
use crate::plan::Access::{self, Read, Update, Write};
use crate::plan::Move;
use bytemuck::{Pod, bytes_of};
use eyebox_kernels::fft::Direction;
use eyebox_spirv::Module;

impl Call<'_, '_> {
    pub(super) fn drive(&mut self) -> Result<(), EngineError> {
        let (step, place) = (self.step, self.shape.place);
        self.planes([place.height, place.width], 1, &step.drive, &[self.shape.subpixels() as u32])
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
        let stride = self.shape.subpixels().pow(2) * layout.stride();
        let args = [self.shape.pixels() as u32, frames as u32, bits[0], bits[1], stride as u32];
        let wave = layout.range(wave.block, 0, layout.frames);
        let groups = self.work.along(self.shape.pixels(), 1);
        self.run(&[wave], &args, &[], groups)
    }

    /// Along columns or rows, transposed or not.
    pub(super) fn crosstalk(&mut self, way: [bool; 2]) -> Result<(), EngineError> {
        let (args, place) = (self.shape.crosstalk(), self.shape.place);
        self.module = Some(&eyebox_spirv::CROSSTALK);
        self.planes([place.height, place.width], 1, &args, &way.map(u32::from))
    }

    pub(super) fn modulate_wave(&mut self) -> Result<(), EngineError> {
        let (place, scale) = (self.shape.place, self.shape.field_scale().to_bits());
        self.module = Some(&eyebox_spirv::MODULATE_WAVE);
        self.planes([place.grid_height, place.grid_width], self.shape.subpixels().pow(2), &place, &[scale])
    }

    pub(super) fn turn(&mut self) -> Result<(), EngineError> {
        let place = self.shape.place;
        self.module = Some(&eyebox_spirv::TURN);
        self.planes([place.height, place.width], self.shape.subpixels().pow(2), &place, &[])
    }

    /// `drive` and `lag`.
    pub(super) fn drive_lag(&mut self) -> Result<(), EngineError> {
        let place = self.shape.place;
        let binds = [(Read, Resource::Shown), (Read, Resource::Pixels), (Write, Resource::Wave)];
        self.sets(&eyebox_spirv::DRIVE_LAG, bytes_of(&place), &binds)
    }

    /// `lag_back`, `drive_back` and `project`.
    pub(super) fn project_wave(&mut self) -> Result<(), EngineError> {
        let project = self.step.project;
        let read = [Resource::Pixels, Resource::Shown, Resource::Wave, Resource::Losses].map(|r| (Read, r));
        let binds = [&read[..3], &[(Update, Resource::Phases), (Update, Resource::Momentum)], &read[3..]].concat();
        self.sets(&eyebox_spirv::PROJECT_WAVE, bytes_of(&project), &binds)
    }

    /// Over the pixels of all sub-frames at once, as many of them as take their time; losses are judged, and bound to nothing.
    fn sets(&mut self, module: &'static Module, own: &[u8], binds: &[(Access, Resource)]) -> Result<(), EngineError> {
        self.work.before(binds);
        let binds: Vec<_> = binds.iter().copied().filter(|(_, resource)| *resource != Resource::Losses).collect();
        let (pixels, frames, drive) = (self.shape.pixels(), self.shape.frames, self.step.drive);
        let [stride, wave_stride] =
            [self.layout(Resource::Shown)?, self.layout(Resource::Wave)?].map(|layout| layout.stride() as u32);
        let buffers = binds.iter().map(|(_, r)| self.plane(*r, 0, frames)).collect::<Result<Vec<_>, _>>()?;
        let moves = self.moves_of_pixels(&binds, 0, frames)?;
        let most = self.work.in_time(moves.iter().map(|m| m.bytes).sum::<u64>().div_ceil(pixels as u64));
        for first in (0..pixels).step_by(most) {
            let count = most.min(pixels - first);
            let (frames, first) = (frames as u32, first as u32);
            let bends = [drive.bend_sin, drive.bend_cos, drive.lag, drive.settled(frames as usize)].map(f32::to_bits);
            let rest = [frames, stride, wave_stride, first, count as u32];
            let args = [own, bytes_of(&bends), bytes_of(&rest)].concat();
            let lines = Lines {
                module,
                constants: &[],
                groups: self.work.along(count, 1),
                changes_phases: binds.contains(&(Update, Resource::Phases)),
            };
            let share = |m: &Move| Move { bytes: m.bytes * count as u64 / pixels as u64, ..*m };
            self.dispatch(&lines, &buffers, &args, || moves.iter().map(share).collect())?;
        }
        Ok(())
    }

    pub(super) fn drive_back(&mut self) -> Result<(), EngineError> {
        let (step, place) = (self.step, self.shape.place);
        self.planes([place.height, place.width], 1, &step.drive, &[self.shape.subpixels() as u32])
    }

    /// Between the fields of sub-pixels and the central order of their spectrum: the rows of all, and the columns of what those
    /// of a row of sub-pixels add up to.
    pub(super) fn subpixels(&mut self, direction: Direction) -> Result<(), EngineError> {
        self.module = Some(&eyebox_spirv::SUBPIXELS);
        let (p, place) = (self.shape.subpixels(), self.shape.place);
        let stack = self.work.stacks.find(Resource::Subpixels).ok_or_else(|| self.missing(Resource::Subpixels))?;
        let all = frames_of(&stack.block, &stack.layout, [place.grid_height as usize, place.grid_width as usize]);
        let firsts = Frames { count: all.count / p, stride: all.stride * p, ..all };
        let mut stages =
            [(Some(all), Along::Rows), (None, Along::Rows), (Some(firsts), Along::Columns), (None, Along::Columns)];
        let back = direction == Direction::Inverse;
        if back {
            stages.reverse();
        }
        for (i, (frames, along)) in stages.into_iter().enumerate() {
            if i > 0 {
                self.work.gpu.recorder.barrier();
            }
            match frames {
                Some(frames) => {
                    self.work.transforms.record(self.work.gpu, frames, direction, self.step.columns, along)?;
                }
                None => {
                    let size = [place.grid_height, place.grid_width];
                    let columns = u32::from(along == Along::Columns);
                    self.planes(size, 1, &size, &[p as u32, columns, u32::from(back)])?;
                }
            }
        }
        Ok(())
    }

    /// Over rows and columns of as many sub-frames at once as the device allows, each in `planes` dispatches of its own. Push
    /// constants are the arguments, `more`, and the strides in the order of the bindings.
    fn planes(
        &mut self,
        [rows, columns]: [u32; 2],
        planes: usize,
        args: &impl Pod,
        more: &[u32],
    ) -> Result<(), EngineError> {
        let (p, binds) = (self.shape.subpixels(), self.kernel.binds());
        let each = |resource: Resource| p.pow(resource.axes_of_subpixels());
        let is_framed = |resource: Resource| resource.axes_of_subpixels() > 0 || resource.per_frame().is_some();
        let mut most = self.work.gpu.limits().groups[2] as usize / planes;
        let mut more = more.to_vec();
        for (_, resource) in binds.iter().filter(|(_, resource)| is_framed(*resource)) {
            let layout = self.layout(*resource)?;
            most = most.min(self.work.at_once(&layout) / each(*resource));
            more.push(layout.stride() as u32);
        }
        for (first, count) in self.work.chunks(self.shape.frames, most) {
            let mut buffers = Vec::with_capacity(binds.len());
            for (_, resource) in binds {
                let Some(whole) = self.range(*resource, 0, 1)? else { return Ok(()) };
                let each = each(*resource);
                buffers.push(match is_framed(*resource) {
                    true => self.layout(*resource)?.range(whole.block, each * first, each * count),
                    false => whole,
                });
            }
            let groups = self.work.rows(rows, columns, planes * count);
            self.run(&buffers, args, &more, groups)?;
        }
        Ok(())
    }
}
