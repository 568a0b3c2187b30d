//! Records fused kernels, which run neighbors of a transform where its lines are read and written.

use super::super::fft::{Along, Frames, Planned, plan_limits};
use super::call::{Call, Work, frames_of};
use crate::engine::{Dispatch, EngineError, Kernel, PupilPass, Resource};
use crate::gpu::Range;
use crate::plan::fusion::{Epilogue, Fusable, Fusion, ways};
use crate::plan::{Access, Move};
use eyebox_kernels::fft::Direction;
use eyebox_kernels::fft_plan::{Axis, Together};
use eyebox_spirv::Module;
use std::sync::Arc;

/// A fused kernel over lines.
pub(super) struct Lines<'l> {
    pub(super) module: &'static Module,
    pub(super) constants: &'l [u32],
    pub(super) groups: [u32; 3],
    pub(super) changes_phases: bool,
}

impl Work<'_> {
    /// Returns the fusion of each entry of a part of the step's list, once their transforms are prepared.
    pub(in super::super) fn ways(&self, list: &[&Dispatch]) -> Vec<Fusion> {
        ways(self.step, list, self.fusable(list))
    }

    fn fusable(&self, list: &[&Dispatch]) -> Fusable {
        let place = &self.shape.place;
        let limit = self.gpu.limits.storage_range;
        let shared = |[rows, columns]: [usize; 2]| {
            // If the width is odd, no columns go in pairs, though the columns of another window with as many rows
            // may.
            if !columns.is_multiple_of(2) {
                return None;
            }
            let [down, along] =
                [(rows, Axis::ColumnPairs), (columns, Axis::Rows)].map(|(n, axis)| self.lines_of(n, axis));
            down.zip(along)
        };
        let mut passes = list
            .iter()
            .filter(|d| d.kernel == Kernel::WindowInverse)
            .flat_map(|d| &self.step.pupil_passes[d.pupil_passes.clone()]);
        let frames = self.shape.frames as u64;
        let fits = |pass: &PupilPass| {
            let size = self.shape.storage.bytes() as u64 * frames * (pass.count() as u64 + 64);
            size <= limit
                && pass.intensity.accumulate == 0
                && pass.window.rows <= self.gpu.limits.groups[0] as usize
                && shared([pass.window.rows, pass.window.columns])
                    .is_some_and(|(_, along)| self.together(&along, pass.window.columns).is_some())
        };
        let arenas = [Resource::Window, Resource::Transfer].map(|r| self.arenas.block(r).map_or(0, |block| block.size));
        let grid = shared([place.grid_height as usize, place.grid_width as usize]).is_some();
        let wave = self.stacks.find(Resource::Wave).filter(|_| grid && self.shape.subpixels() == 1);
        Fusable {
            grid,
            windows: passes.all(fits),
            gather: arenas.into_iter().all(|size| size <= limit),
            tiles: wave.is_some_and(|wave| self.at_once(&wave.layout) >= wave.layout.frames) && self.tiles_fit(),
        }
    }

    pub(super) fn lines_of(&self, n: usize, axis: Axis) -> Option<Arc<Planned>> {
        self.transforms.planned(n, axis).filter(|planned| planned.shared().is_some())
    }

    pub(super) fn together(&self, along: &Planned, n: usize) -> Option<Together> {
        along.shared()?.together(n as u32, self.shape.frames as u32, &plan_limits(self.gpu))
    }
}

impl<'a> Call<'_, 'a> {
    /// Records the entry, and the entries fused with it.
    pub(super) fn fused(&mut self, way: Fusion) -> Result<(), EngineError> {
        use Access::{Read, Update, Write};
        match way {
            Fusion::Alone | Fusion::Elsewhere => Ok(()),
            Fusion::FieldFromPhases => {
                self.work.before(&[(Read, Resource::Shown), (Write, Resource::Field)]);
                self.modulate_rows()?;
                self.work.before(&[(Update, Resource::Field)]);
                self.grid_lines(Resource::Field, Direction::Forward, Along::Columns)
            }
            Fusion::DriveTiles => self.drive_tiles(),
            Fusion::ProjectTiles => self.project_tiles(),
            Fusion::FieldFromWave => {
                self.work.before(&[(Read, Resource::Wave), (Read, Resource::Pixels), (Write, Resource::Field)]);
                self.modulate_wave_rows()?;
                self.work.before(&[(Update, Resource::Field)]);
                self.grid_lines(Resource::Field, Direction::Forward, Along::Columns)
            }
            Fusion::See => self.windows(false),
            Fusion::ThroughWindows => self.windows(true),
            Fusion::Gather { adds, last } => {
                let mut binds = vec![
                    (Read, Resource::Window),
                    (Read, Resource::Transfer),
                    (Read, Resource::Spans),
                    (Update, Resource::Change),
                ];
                binds.extend(self.shape.halves().then_some((Update, Resource::NotFinite)));
                self.work.before(&binds);
                self.gather_columns(adds, last)
            }
            Fusion::ChangeRows => {
                self.work.before(&[(Update, Resource::Change)]);
                self.grid_lines(Resource::Change, Direction::Inverse, Along::Rows)
            }
            Fusion::ChangeRowsAnd(behind) => self.change_rows_and(behind),
            Fusion::ChangeAnd(behind) => {
                self.work.before(&[(Update, Resource::Change)]);
                self.grid_lines(Resource::Change, Direction::Inverse, Along::Columns)?;
                self.change_rows_and(behind)
            }
        }
    }

    fn change_rows_and(&mut self, behind: Epilogue) -> Result<(), EngineError> {
        let mut binds = self.kernel.binds().to_vec();
        binds.extend((behind != Epilogue::PhaseGradient).then_some((Access::Read, Resource::Losses)));
        self.work.before(&binds);
        let (step, place) = (self.step, self.shape.place);
        match behind {
            Epilogue::Project => self.rows_behind(&eyebox_spirv::PROJECT_ROWS, &step.project),
            Epilogue::Adam => self.rows_behind(&eyebox_spirv::ADAM_ROWS, &step.adam),
            Epilogue::PhaseGradient => self.rows_behind(&eyebox_spirv::PHASE_GRADIENT_ROWS, &place),
        }
    }

    pub(super) fn grid_size(&self) -> [usize; 2] {
        let place = &self.shape.place;
        [place.grid_height as usize, place.grid_width as usize]
    }

    pub(super) fn planned(&self, n: usize, axis: Axis) -> Result<Arc<Planned>, EngineError> {
        let missing = || EngineError::mismatch(format!("no transform of {n} was prepared"));
        self.work.lines_of(n, axis).ok_or_else(missing)
    }

    /// Records the rows, or columns, of the grid's transform.
    pub(super) fn grid_lines(
        &mut self,
        resource: Resource,
        direction: Direction,
        along: Along,
    ) -> Result<(), EngineError> {
        let stack = self.work.stacks.find(resource).ok_or_else(|| self.missing(resource))?;
        let frames: Frames<'_> = frames_of(&stack.block, &stack.layout, self.grid_size());
        self.work.transforms.record(self.work.gpu, frames, direction, self.step.columns, along)
    }

    pub(super) fn dispatch(
        &mut self,
        lines: &Lines<'_>,
        buffers: &[Range<'_>],
        args: &[u8],
        moves: impl FnOnce() -> Vec<Move>,
    ) -> Result<(), EngineError> {
        let module = lines.module.stored(self.shape.halves());
        let groups = self.work.guarded(lines.groups, lines.changes_phases)?;
        let gpu = &mut *self.work.gpu;
        let pipeline = gpu.pipeline(module, buffers.len() as u32, lines.constants)?;
        gpu.recorder.dispatch(pipeline, buffers, args, groups)?;
        gpu.recorder.moved(moves);
        Ok(())
    }

    /// Returns chunks (first, count) of frames for which these resources may be bound at once. Each frame also moves
    /// `beside` bytes of other data.
    pub(super) fn frames_at_once(
        &self,
        resources: &[Resource],
        beside: u64,
    ) -> Result<Vec<(usize, usize)>, EngineError> {
        let (mut most, mut bytes) = (usize::MAX, beside);
        for resource in resources {
            let layout = self.layout(*resource)?;
            most = most.min(self.work.at_once(&layout));
            bytes += 2 * layout.step();
        }
        Ok(self.work.chunks(self.shape.frames, most.min(self.work.in_time(bytes))).collect())
    }

    pub(super) fn bound(&self, resource: Resource, first: usize, count: usize) -> Result<Range<'a>, EngineError> {
        self.range(resource, first, count)?.ok_or_else(|| self.missing(resource))
    }
}
