//! Records the kernels between phases and field, for displays whose model goes beyond phases.
//!
//! They run over sub-frames and their sub-pixels.

use super::super::fft::{Along, Frames};
use super::call::{Call, Work, frames_of};
use super::fused::Lines;
use crate::engine::{EngineError, Resource, Shape};
use crate::plan::Access::{self, Read, Update, Write};
use crate::plan::Move;
use bytemuck::{Pod, bytes_of, cast_slice};
use eyebox_kernels::fft::{Columns, Direction};
use eyebox_kernels::multiply;
use eyebox_kernels::{TILE, TILE_THREADS};
use eyebox_spirv::Module;

/// Returns the pixels that crosstalk reaches along y and along x.
fn reach(shape: &Shape) -> [u32; 2] {
    shape.model.crosstalk.unwrap_or_default().map(|pixels| pixels as u32)
}

impl Work<'_> {
    /// Returns true if a tile, with the surroundings that crosstalk reaches, fits shared memory.
    pub(super) fn tiles_fit(&self) -> bool {
        let [tall, wide] = reach(self.shape).map(|pixels| u64::from(TILE) + 2 * u64::from(pixels));
        let states = if self.step.drive.lag > 0.0 { tall * wide } else { 1 };
        let floats = tall * wide + states + tall * u64::from(TILE);
        let limits = self.gpu.limits;
        4 * floats <= u64::from(limits.shared_memory) && TILE_THREADS <= limits.invocations
    }
}

impl Call<'_, '_> {
    pub(super) fn drive(&mut self) -> Result<(), EngineError> {
        let (step, place) = (self.step, self.shape.place);
        self.planes([place.height, place.width], 1, &step.drive, &[self.shape.subpixels() as u32])
    }

    /// Runs over all sub-frames at once, in either direction.
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

    /// Runs along columns or rows, transposed or not.
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

    pub(super) fn modulate_mask(&mut self) -> Result<(), EngineError> {
        let (step, place, scale) = (self.step, self.shape.place, self.shape.field_scale().to_bits());
        self.planes([place.grid_height, place.grid_width], 1, &step.modulate_mask, &[scale])
    }

    pub(super) fn phase_gradient_mask(&mut self) -> Result<(), EngineError> {
        let (step, place) = (self.step, self.shape.place);
        self.planes([place.height, place.width], 1, &step.modulate_mask, &[])
    }

    /// Propagates from the SLM to a mask at a distance and through it, or back.
    pub(super) fn through_mask(&mut self, back: bool) -> Result<(), EngineError> {
        self.module = Some(&eyebox_spirv::MULTIPLY);
        let [through, reach] = self.shape.mask_factors(back);
        if back {
            self.multiply(&through, false)?;
        }
        self.full_transform(Direction::Forward)?;
        self.multiply(&reach, true)?;
        self.full_transform(Direction::Inverse)?;
        if back { Ok(()) } else { self.multiply(&through, false) }
    }

    fn multiply(&mut self, factors: &multiply::Args, propagates: bool) -> Result<(), EngineError> {
        self.work.gpu.recorder.barrier();
        self.planes([factors.grid_height, factors.grid_width], 1, factors, &[u32::from(propagates)])
    }

    /// Transforms all columns of the buffers that the kernel changes, not only the ones that the step's pupils pass.
    fn full_transform(&mut self, direction: Direction) -> Result<(), EngineError> {
        self.work.gpu.recorder.barrier();
        let columns = Columns::all(self.shape.place.grid_width as usize);
        self.grid_transform_of(direction, columns)
    }

    pub(super) fn phase_gradient(&mut self) -> Result<(), EngineError> {
        let place = self.shape.place;
        self.module = Some(&eyebox_spirv::PHASE_GRADIENT);
        self.planes([place.height, place.width], self.shape.subpixels().pow(2), &place, &[])
    }

    /// Records `drive`, `lag` and crosstalk over tiles.
    pub(super) fn drive_tiles(&mut self) -> Result<(), EngineError> {
        let binds = [(Read, Resource::Shown), (Read, Resource::Pixels), (Write, Resource::Wave)];
        self.tiles(&eyebox_spirv::DRIVE_TILES, &[], &binds)
    }

    /// Records the adjoints of crosstalk and lag, `drive_adjoint` and `project` over tiles.
    pub(super) fn project_tiles(&mut self) -> Result<(), EngineError> {
        let project = self.step.project;
        let read = [Resource::Pixels, Resource::Shown, Resource::Wave, Resource::Losses].map(|r| (Read, r));
        let binds = [&read[..3], &[(Update, Resource::Phases), (Update, Resource::Momentum)], &read[3..]].concat();
        let own = [project.gain.to_bits(), project.momentum.to_bits(), project.bound.to_bits(), project.step];
        self.tiles(&eyebox_spirv::PROJECT_TILES, &own, &binds)
    }

    /// Runs over tiles of pixels in all sub-frames, with as many rows of tiles at once as the time limit allows.
    /// Losses only order the work and are not bound.
    fn tiles(&mut self, module: &'static Module, own: &[u32], binds: &[(Access, Resource)]) -> Result<(), EngineError> {
        let blurs = self.shape.model.crosstalk.is_some();
        let mut all = binds.to_vec();
        all.extend(blurs.then_some((Read, Resource::Crosstalk)));
        self.work.before(&all);
        let binds: Vec<_> = binds.iter().copied().filter(|(_, resource)| *resource != Resource::Losses).collect();
        let (shape, drive) = (self.shape, self.step.drive);
        let frames = shape.frames;
        let strides =
            [self.layout(Resource::Shown)?, self.layout(Resource::Wave)?].map(|layout| layout.stride() as u32);
        let weights = self.bound(if blurs { Resource::Crosstalk } else { Resource::Pixels }, 0, 1)?;
        let mut buffers = vec![weights];
        for (_, resource) in &binds {
            buffers.push(self.plane(*resource, 0, frames)?);
        }
        let moves = self.moves_of_pixels(&binds, 0, frames)?;
        let [reach_y, reach_x] = reach(shape);
        let lags = u32::from(drive.lag > 0.0);
        let constants = [u32::from(shape.binary_angles), reach_y, reach_x, u32::from(blurs), lags];
        let [rows, columns] = [shape.place.height, shape.place.width].map(|side| side.div_ceil(TILE));
        let bytes = moves.iter().map(|m| m.bytes).sum::<u64>().div_ceil(u64::from(rows));
        let most = u32::try_from(self.work.in_time(bytes)).unwrap_or(u32::MAX).min(self.work.gpu.limits.groups[1]);
        for first in (0..rows).step_by(most as usize) {
            let count = most.min(rows - first);
            let bends = [drive.bend_sin, drive.bend_cos, drive.lag, drive.settled(frames)].map(f32::to_bits);
            let rest = [frames as u32, strides[0], strides[1], first];
            let args = [bytes_of(&shape.place), bytes_of(&bends), bytes_of(&rest), cast_slice(own)].concat();
            let lines = Lines {
                module,
                constants: &constants,
                groups: [columns, count, 1],
                changes_phases: binds.contains(&(Update, Resource::Phases)),
            };
            let share = |m: &Move| Move { bytes: m.bytes * u64::from(count) / u64::from(rows), ..*m };
            self.dispatch(&lines, &buffers, &args, || moves.iter().map(share).collect())?;
        }
        Ok(())
    }

    pub(super) fn drive_adjoint(&mut self) -> Result<(), EngineError> {
        let (step, place) = (self.step, self.shape.place);
        self.planes([place.height, place.width], 1, &step.drive, &[self.shape.subpixels() as u32])
    }

    /// Transforms between the fields of sub-pixels and the central order of their spectrum. All sub-pixels need their
    /// rows, but each row of sub-pixels is summed before its columns.
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

    /// Runs over rows and columns of as many sub-frames at once as the device allows, each with `planes` workgroups
    /// in z. Push constants are the arguments, `more`, and the strides in the order of the bindings.
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
        let mut most = self.work.gpu.limits.groups[2] as usize / planes;
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
