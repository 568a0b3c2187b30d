//! The whole frame, fused: from phases to the spectrum, and from what pupils return to phases.

use super::super::fft::{in_use, shared_constants};
use super::call::Call;
use super::fused::Lines;
use crate::engine::{EngineError, Resource};
use crate::plan::fusion::divides;
use bytemuck::{Pod, Zeroable};
use eyebox_kernels::fft_plan::{Axis, Shared};
use eyebox_kernels::{modulate, project};

/// Push constants of `modulate_rows`.
#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct ModulateArguments {
    place: modulate::Args,
    columns: [u32; 2],
    all: u32,
    scale: f32,
    phases_stride: u32,
    field_stride: u32,
}

/// Those of `project_rows`.
#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct ProjectArguments {
    project: project::Args,
    columns: [u32; 2],
    all: u32,
    change_stride: u32,
    phases_stride: u32,
}

/// Those of `gather_columns`.
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

impl Call<'_, '_> {
    /// Constants of kernels that read or write phases beside their rows.
    fn constants(&self, shared: &Shared) -> [u32; 21] {
        let mut constants = shared_constants(shared, Axis::Rows);
        constants[20] = u32::from(self.shape.binary_angles);
        constants
    }

    pub(super) fn modulate_rows(&mut self) -> Result<(), EngineError> {
        let [height, width] = self.grid_size();
        let planned = self.planned(width, Axis::Rows)?;
        let Some(shared) = planned.shared() else { return Ok(()) };
        let columns = in_use(self.step.columns, width);
        let [phases_stride, field_stride] =
            [self.layout(Resource::Shown)?, self.layout(Resource::Field)?].map(|layout| layout.stride() as u32);
        let (place, scale) = (self.shape.place, self.shape.field_scale());
        let (size, pixels) = (self.shape.storage.bytes() as u64, self.shape.pixels() as u64);
        let phase = self.shape.real_bytes(Resource::Phases);
        for (first, count) in self.frames_at_once(&[Resource::Shown, Resource::Field], 0)? {
            let all = (count * height) as u32;
            let args = ModulateArguments { place, columns, all, scale, phases_stride, field_stride };
            let phases = self.bound(Resource::Shown, first, count)?;
            let field = self.bound(Resource::Field, first, count)?;
            let lines = Lines {
                module: &eyebox_spirv::MODULATE_ROWS,
                constants: &self.constants(shared),
                changes_phases: false,
                groups: self.work.row_groups(shared, all),
            };
            self.dispatch(&lines, &[phases, planned.twiddles.all(), field], &args, || {
                let written = size * u64::from(columns[1]) * u64::from(all);
                vec![phases.reads(phase * pixels * count as u64), field.writes(written)]
            })?;
        }
        Ok(())
    }

    pub(super) fn project_rows(&mut self) -> Result<(), EngineError> {
        let planned = self.planned(self.grid_size()[1], Axis::Rows)?;
        let Some(shared) = planned.shared() else { return Ok(()) };
        let columns = in_use(self.step.columns, self.grid_size()[1]);
        let bound = [Resource::Change, Resource::Shown, Resource::Phases, Resource::Momentum];
        let change_stride = self.layout(Resource::Change)?.stride() as u32;
        let phases_stride = self.layout(Resource::Phases)?.stride() as u32;
        let (size, pixels) = (self.shape.storage.bytes() as u64, self.shape.pixels() as u64);
        let phase = self.shape.real_bytes(Resource::Phases);
        let quantised = self.shape.quantised;
        for (first, count) in self.frames_at_once(&bound, 0)? {
            let all = count as u32 * self.shape.place.height;
            let args = ProjectArguments { project: self.step.project, columns, all, change_stride, phases_stride };
            let [change, shown, phases, velocity] = bound.map(|resource| self.bound(resource, first, count));
            let (change, shown, phases, velocity) = (change?, shown?, phases?, velocity?);
            let lines = Lines {
                module: &eyebox_spirv::PROJECT_ROWS,
                constants: &self.constants(shared),
                changes_phases: true,
                groups: self.work.row_groups(shared, all),
            };
            let buffers = [change, planned.twiddles.all(), shown, phases, velocity];
            self.dispatch(&lines, &buffers, &args, || {
                let real = phase * pixels * count as u64;
                let mut moves = vec![change.reads(size * u64::from(columns[1]) * u64::from(all))];
                moves.extend(quantised.then(|| shown.reads(real)));
                moves.extend([phases.reads(real), phases.writes(real), velocity.reads(real), velocity.writes(real)]);
                moves
            })?;
        }
        Ok(())
    }

    /// What the pupils of the dispatch return, behind those of the groups before.
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
            self.dispatch(&lines, &buffers, &args, || {
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
