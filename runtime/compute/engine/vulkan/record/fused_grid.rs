//! Records the fused kernels over whole frames, from phases to the spectrum and from pupils back to phases.

use super::super::fft::{in_use, row_groups, shared_constants};
use super::call::Call;
use super::fused::Lines;
use crate::engine::{EngineError, Kernel, Resource};
use crate::gpu::Range;
use crate::plan::fusion::divides;
use crate::plan::{Access, Access::Read, Move};
use bytemuck::{Pod, Zeroable, bytes_of};
use eyebox_kernels::fft_plan::{Axis, Shared};
use eyebox_kernels::modulate;
use eyebox_spirv::Module;

/// Push constants of `modulate_rows` and `modulate_wave_rows`.
#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct FieldArguments {
    place: modulate::Args,
    columns: [u32; 2],
    all: u32,
    scale: f32,
    lit_stride: u32,
    field_stride: u32,
}

/// Push constants of `gather_columns`.
#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct GatherArguments {
    grid: [u32; 2],
    columns: [u32; 2],
    pupils: u32,
    begin: u32,
    end: u32,
    adds: u32,
    power: f32,
    change_stride: u32,
    frame: u32,
}

impl<'a> Call<'_, 'a> {
    /// Returns the constants of kernels that read or write phases along with their rows.
    fn constants(&self, shared: &Shared) -> [u32; 21] {
        let mut constants = shared_constants(shared, Axis::Rows);
        constants[20] = u32::from(self.shape.binary_angles);
        constants
    }

    pub(super) fn modulate_rows(&mut self) -> Result<(), EngineError> {
        self.field_rows(&eyebox_spirv::MODULATE_ROWS, &[(Read, Resource::Shown)])
    }

    pub(super) fn modulate_wave_rows(&mut self) -> Result<(), EngineError> {
        self.field_rows(&eyebox_spirv::MODULATE_WAVE_ROWS, &[(Read, Resource::Wave), (Read, Resource::Pixels)])
    }

    /// Records the rows of the field from these resources, the first of which has a value per pixel and sub-frame.
    fn field_rows(&mut self, module: &'static Module, lit: &[(Access, Resource)]) -> Result<(), EngineError> {
        let [height, width] = self.grid_size();
        let planned = self.planned(width, Axis::Rows)?;
        let Some(shared) = planned.shared() else { return Ok(()) };
        let columns = in_use(self.step.columns, width);
        let [lit_stride, field_stride] =
            [self.layout(lit[0].1)?, self.layout(Resource::Field)?].map(|layout| layout.stride() as u32);
        let (place, scale) = (self.shape.place, self.shape.field_scale());
        let size = self.shape.storage.bytes() as u64;
        for (first, count) in self.frames_at_once(&[lit[0].1, Resource::Field], 0)? {
            let all = (count * height) as u32;
            let args = FieldArguments { place, columns, all, scale, lit_stride, field_stride };
            let field = self.bound(Resource::Field, first, count)?;
            let lines = Lines {
                module,
                constants: &self.constants(shared),
                changes_phases: false,
                groups: row_groups(self.work.gpu, shared, all),
            };
            let mut buffers = vec![self.plane(lit[0].1, first, count)?, planned.twiddles.all(), field];
            for (_, resource) in &lit[1..] {
                buffers.push(self.plane(*resource, first, count)?);
            }
            let mut moves = self.moves_of_pixels(lit, first, count)?;
            moves.push(field.writes(size * u64::from(columns[1]) * u64::from(all)));
            self.dispatch(&lines, &buffers, bytes_of(&args), || moves)?;
        }
        Ok(())
    }

    /// Records the rows of the change with a kernel that also binds other resources per pixel.
    pub(super) fn rows_behind(&mut self, module: &'static Module, own: &impl Pod) -> Result<(), EngineError> {
        let [_, width] = self.grid_size();
        let planned = self.planned(width, Axis::Rows)?;
        let Some(shared) = planned.shared() else { return Ok(()) };
        let columns = in_use(self.step.columns, width);
        let others: Vec<_> = self.kernel.binds().iter().copied().filter(|(_, r)| *r != Resource::Change).collect();
        let moved: Vec<Resource> = others.iter().map(|(_, r)| *r).filter(|r| *r != Resource::Pixels).collect();
        let [change_stride, moved_stride] =
            [self.layout(Resource::Change)?, self.layout(moved[0])?].map(|layout| layout.stride() as u32);
        let size = self.shape.storage.bytes() as u64;
        for (first, count) in self.frames_at_once(&[&[Resource::Change][..], &moved].concat(), 0)? {
            let all = count as u32 * self.shape.place.height;
            let change = self.bound(Resource::Change, first, count)?;
            let lines = Lines {
                module,
                constants: &self.constants(shared),
                changes_phases: moved.contains(&Resource::Phases),
                groups: row_groups(self.work.gpu, shared, all),
            };
            let mut buffers = vec![change, planned.twiddles.all()];
            for (_, resource) in &others {
                buffers.push(self.plane(*resource, first, count)?);
            }
            let behind = [columns[0], columns[1], all, change_stride, moved_stride];
            let args = [bytes_of(own), bytes_of(&behind)].concat();
            let mut moves = self.moves_of_pixels(&others, first, count)?;
            moves.push(change.reads(size * u64::from(columns[1]) * u64::from(all)));
            self.dispatch(&lines, &buffers, &args, || moves)?;
        }
        Ok(())
    }

    /// Returns the bound range. For the phases of a display's model it has only these sub-frames.
    pub(super) fn plane(&self, resource: Resource, first: usize, count: usize) -> Result<Range<'a>, EngineError> {
        let range = self.bound(resource, first, count)?;
        Ok(if resource == Resource::Wave { self.layout(resource)?.range(range.block, first, count) } else { range })
    }

    /// Returns the moves of a kernel that visits each pixel once. Phases that are shown without levels count once.
    pub(super) fn moves_of_pixels(
        &self,
        binds: &[(Access, Resource)],
        first: usize,
        count: usize,
    ) -> Result<Vec<Move>, EngineError> {
        let pixels = self.shape.pixels() as u64;
        let moves_phases = binds.iter().any(|(_, resource)| *resource == Resource::Phases);
        let mut moves = Vec::new();
        for (access, resource) in binds {
            let range = self.plane(*resource, first, count)?;
            let bytes = match resource {
                Resource::Shown if moves_phases && !self.shape.quantised => continue,
                Resource::Pixels => 4 * pixels * if self.kernel == Kernel::ModulateWave { 3 } else { 1 },
                resource => self.shape.real_bytes(*resource) * pixels * count as u64,
            };
            moves.extend((*access != Access::Write).then(|| range.reads(bytes)));
            moves.extend((*access != Read).then(|| range.writes(bytes)));
        }
        Ok(moves)
    }

    /// Records the gathering of the pupils of the dispatch, after the groups before.
    pub(super) fn gather_columns(&mut self, adds: bool, last: bool) -> Result<(), EngineError> {
        let [height, width] = self.grid_size();
        let planned = self.planned(height, Axis::ColumnPairs)?;
        let Some(shared) = planned.shared() else { return Ok(()) };
        let columns = in_use(self.step.columns, width);
        let change_stride = self.layout(Resource::Change)?.stride() as u32;
        let group = self.dispatch.pupil_passes.clone();
        let whole = |call: &Self, resource| {
            call.work.arenas.block(resource).map(|block| block.all()).ok_or_else(|| call.missing(resource))
        };
        let (windows, transfers) = (whole(self, Resource::Window)?, whole(self, Resource::Transfer)?);
        let (tables, pupils_table) = (self.work.tables.all()?, self.work.tables.pupils()?);
        let size = self.shape.storage.bytes() as u64;
        let passing: u64 = self.step.pupil_passes[group.clone()].iter().map(|pass| pass.passing()).sum();
        let mut constants = shared_constants(shared, Axis::ColumnPairs).to_vec();
        constants.push(u32::from(last));
        for (first, count) in self.frames_at_once(&[Resource::Change], size * passing)? {
            let args = GatherArguments {
                grid: [height as u32, width as u32],
                columns,
                pupils: self.step.pupil_passes.len() as u32,
                begin: group.start as u32,
                end: group.end as u32,
                adds: u32::from(adds),
                power: if divides(self.step) { self.step.divide_by_overlap.power } else { 0.0 },
                change_stride,
                frame: first as u32,
            };
            let change = self.bound(Resource::Change, first, count)?;
            let lines = Lines {
                module: &eyebox_spirv::GATHER_COLUMNS,
                constants: &constants,
                changes_phases: false,
                groups: [(columns[1] / 2).div_ceil(shared.lines), count as u32, 1],
            };
            let mut buffers = vec![change, planned.twiddles.all(), windows, transfers, tables, pupils_table];
            if self.shape.halves() {
                buffers.push(self.bound(Resource::NotFinite, 0, 1)?);
            }
            self.dispatch(&lines, &buffers, bytes_of(&args), || {
                let whole = size * u64::from(columns[1]) * (height * count) as u64;
                let mut moves = vec![windows.reads(size * passing * count as u64), transfers.reads(8 * passing)];
                moves.extend(adds.then(|| change.reads(whole)));
                moves.push(change.writes(whole));
                moves
            })?;
        }
        Ok(())
    }
}
