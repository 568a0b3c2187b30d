//! The pupils' windows, fused: from the spectrum to the loss, and back to the windows' spectra.

use super::super::fft::{Along, in_use, shared_constants};
use super::call::Call;
use super::fused::Lines;
use crate::engine::{EngineError, PupilPass, Resource};
use crate::gpu::Range;
use crate::plan::Access::{Read, Update, Write};
use bytemuck::{Pod, Zeroable};
use eyebox_kernels::fft::Direction;
use eyebox_kernels::fft_plan::{Axis, Shared};
use eyebox_kernels::pass_pupil;

/// Modes of `compare_rows`.
const LOOK: u32 = 0;
const SEE: u32 = 1;
const TURN_BACK: u32 = 2;
const WHOLE: u32 = 3;

/// Push constants of `pass_columns`.
#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct PassArguments {
    pass: pass_pupil::Args,
    columns: [u32; 2],
    spectrum_stride: u32,
    window_stride: u32,
}

/// Those of `compare_rows`.
#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct CompareArguments {
    width: u32,
    frames: u32,
    columns: [u32; 2],
    window_stride: u32,
    gain: f32,
    mode: u32,
    exposure: f32,
    weight: f32,
    floor: f32,
    limit: f32,
}

impl<'a> Call<'_, 'a> {
    /// The pupils of the dispatch side by side, stage by stage: to what they see, or on to the spectra of what they lack.
    pub(super) fn windows(&mut self, back: bool) -> Result<(), EngineError> {
        let step = self.step;
        let passes = &step.pupil_passes[self.dispatch.pupil_passes.clone()];
        self.work.before(&[
            (Read, Resource::Field),
            (Read, Resource::Transfer),
            (Read, Resource::Spans),
            (Write, Resource::Window),
        ]);
        self.each(passes, |call, pass| call.pass_columns(pass))?;
        let seen = [(Update, Resource::Window), (Write, Resource::Image)];
        if !back {
            self.work.before(&seen);
            return self.each(passes, |call, pass| call.compare_rows(pass, LOOK));
        }
        self.work.before(&[seen[0], seen[1], (Read, Resource::Target), (Write, Resource::Losses)]);
        self.each(passes, |call, pass| {
            let mode = if call.is_whole(pass) { WHOLE } else { SEE };
            call.compare_rows(pass, mode)
        })?;
        if !passes.iter().all(|pass| self.is_whole(pass)) {
            self.work.before(&[(Read, Resource::Image), (Update, Resource::Window)]);
            self.each(
                passes,
                |call, pass| {
                    if call.is_whole(pass) { Ok(()) } else { call.compare_rows(pass, TURN_BACK) }
                },
            )?;
        }
        self.work.before(&[(Update, Resource::Window)]);
        self.each(passes, |call, pass| call.window_lines(pass, Direction::Forward, Along::Columns))
    }

    fn each(
        &mut self,
        passes: &[PupilPass],
        one: impl Fn(&mut Self, &PupilPass) -> Result<(), EngineError>,
    ) -> Result<(), EngineError> {
        for (at, pass) in passes.iter().enumerate() {
            self.at = at;
            one(self, pass)?;
        }
        Ok(())
    }

    /// Whether a row of all sub-frames fits shared memory.
    fn is_whole(&self, pass: &PupilPass) -> bool {
        let along = self.work.lines_of(pass.window.columns, Axis::Rows);
        along.and_then(|along| self.work.together(&along, pass.window.columns)).is_some_and(|together| together.whole)
    }

    fn pass_columns(&mut self, pass: &PupilPass) -> Result<(), EngineError> {
        let planned = self.planned(pass.window.rows, Axis::ColumnPairs)?;
        let Some(shared) = planned.shared() else { return Ok(()) };
        let columns = in_use(pass.columns, pass.window.columns);
        let [spectrum, window] = [Resource::Field, Resource::Window].map(|r| self.layout(r));
        let [spectrum_stride, window_stride] = [spectrum?.stride() as u32, window?.stride() as u32];
        let args = PassArguments { pass: pass.pass, columns, spectrum_stride, window_stride };
        let size = self.shape.storage.bytes() as u64;
        let passing = pass.passing();
        for (first, count) in self.frames_at_once(&[Resource::Field, Resource::Window], 0)? {
            let [field, transfer, spans, window] =
                [Resource::Field, Resource::Transfer, Resource::Spans, Resource::Window]
                    .map(|resource| self.bound(resource, first, count));
            let (field, transfer, window) = (field?, transfer?, window?);
            let buffers = [field, planned.twiddles.all(), transfer, spans?, window];
            let lines = Lines {
                module: &eyebox_spirv::PASS_COLUMNS,
                constants: &shared_constants(shared, Axis::ColumnPairs)[..20],
                changes_phases: false,
                groups: [(columns[1] / 2).div_ceil(shared.lines), count as u32, 1],
            };
            let used = u64::from(columns[1]) * pass.window.rows as u64;
            self.dispatch(&lines, &buffers, &args, || {
                let frames = count as u64;
                vec![
                    field.reads(size * passing * frames),
                    transfer.reads(8 * passing),
                    window.writes(size * used * frames),
                ]
            })?;
        }
        Ok(())
    }

    fn compare_rows(&mut self, pass: &PupilPass, mode: u32) -> Result<(), EngineError> {
        let planned = self.planned(pass.window.columns, Axis::Rows)?;
        let Some(together) = self.work.together(&planned, pass.window.columns) else { return Ok(()) };
        let Shared { threads, lines, .. } = together.shared;
        let frames = self.shape.frames as u32;
        let columns = in_use(pass.columns, pass.window.columns);
        let layout = self.layout(Resource::Window)?;
        let compare = &pass.compare;
        let args = CompareArguments {
            width: pass.window.columns as u32,
            frames,
            columns,
            window_stride: layout.stride() as u32,
            gain: pass.intensity.gain,
            mode: compare.mode,
            exposure: compare.exposure,
            weight: compare.weight,
            floor: compare.floor,
            limit: compare.limit,
        };
        let (window, image) = (self.bound(Resource::Window, 0, layout.frames)?, self.bound(Resource::Image, 0, 1)?);
        // What a mode does not look at may be anything.
        let compares = mode == SEE || mode == WHOLE;
        let target = if compares { self.bound(Resource::Target, 0, 1)? } else { image };
        let losses = if compares { self.range(Resource::Losses, 0, 1)?.unwrap_or(image) } else { image };
        let mut constants = shared_constants(&together.shared, Axis::Rows).to_vec();
        let kept = if mode == WHOLE { together.kept } else { lines };
        let pixels = if mode == TURN_BACK { 1 } else { pass.window.columns as u32 };
        constants.extend([mode, kept, pixels, if compares { threads * lines } else { 1 }]);
        let rounds = if mode == TURN_BACK { frames.div_ceil(lines) } else { 1 };
        // By rows, so many at once that what belongs to them begins at a multiple of 256 bytes.
        let size = self.shape.storage.bytes() as u64;
        let row = [size, 4, 4].map(|bytes| bytes * pass.window.columns as u64);
        let of_row = 2 * row[0] * u64::from(frames) + row[1] + row[2];
        let most = (self.work.in_time(of_row) / 64).saturating_mul(64).clamp(64, pass.window.rows.next_multiple_of(64));
        for first in (0..pass.window.rows).step_by(most) {
            let rows = most.min(pass.window.rows - first);
            let from = |range: Range<'a>, row: u64| {
                let skipped = row * first as u64;
                range.block.range(range.offset + skipped, range.size - skipped)
            };
            let (window, image, target) = (from(window, row[0]), from(image, row[1]), from(target, row[2]));
            let losses = if compares { from(losses, 4) } else { image };
            let buffers = [window, planned.twiddles.all(), image, target, losses];
            let dispatch = Lines {
                module: &eyebox_spirv::COMPARE_ROWS,
                constants: &constants,
                changes_phases: false,
                groups: [rows as u32, rounds, 1],
            };
            let fields = size * u64::from(columns[1]) * rows as u64 * u64::from(frames);
            let pixels = row[1] * rows as u64;
            self.dispatch(&dispatch, &buffers, &args, || match mode {
                LOOK => vec![window.reads(fields), image.writes(pixels)],
                SEE => vec![window.reads(fields), target.reads(pixels), image.writes(pixels)],
                TURN_BACK => vec![window.reads(fields), image.reads(pixels), window.writes(fields)],
                _ => vec![window.reads(fields), target.reads(pixels), window.writes(fields)],
            })?;
        }
        Ok(())
    }
}
