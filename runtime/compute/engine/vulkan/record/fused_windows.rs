//! Records the fused kernels over pupils' windows, from the spectrum to the loss and back to the windows' spectra.
//!
//! Pupils whose windows have lines of one length share one dispatch.

use super::super::fft::{in_use, shared_constants};
use super::batches::Members;
use super::call::Call;
use super::fused::Lines;
use crate::engine::{EngineError, PupilPass, Resource};
use crate::gpu::Range;
use crate::plan::Access::{Read, Update, Write};
use crate::plan::Move;
use bytemuck::cast_slice;
use eyebox_kernels::fft_plan::{Axis, Shared};

/// Modes of the shader `compare_rows`.
const LOOK: u32 = 0;
const SEE: u32 = 1;
const TURN_BACK: u32 = 2;
const WHOLE: u32 = 3;

/// A batch, and its frames (first, count) that a kernel binds at once.
type BatchFrames = (Members, usize, usize);

impl<'a> Call<'_, 'a> {
    /// Records the pupils of the dispatch together, stage by stage, to their images, or also back to the spectra of
    /// the differences.
    pub(super) fn windows(&mut self, back: bool) -> Result<(), EngineError> {
        self.work.before(&[
            (Read, Resource::Field),
            (Read, Resource::Transfer),
            (Read, Resource::Spans),
            (Write, Resource::Window),
        ]);
        self.pass_columns()?;
        let seen = [(Update, Resource::Window), (Write, Resource::Image)];
        if !back {
            self.work.before(&seen);
            return self.compare_rows(|_| Some(LOOK));
        }
        self.work.before(&[seen[0], seen[1], (Read, Resource::Target), (Write, Resource::Losses)]);
        self.compare_rows(|whole| Some(if whole { WHOLE } else { SEE }))?;
        if !(0..self.slots.len()).all(|at| self.is_whole(self.pass(at))) {
            self.work.before(&[(Read, Resource::Image), (Update, Resource::Window)]);
            self.compare_rows(|whole| (!whole).then_some(TURN_BACK))?;
        }
        self.work.before(&[(Update, Resource::Window)]);
        self.window_columns()
    }

    /// Returns true if a row of all sub-frames fits shared memory.
    fn is_whole(&self, pass: &PupilPass) -> bool {
        let along = self.work.lines_of(pass.window.columns, Axis::Rows);
        along.and_then(|along| self.work.together(&along, pass.window.columns)).is_some_and(|together| together.whole)
    }

    /// Returns the largest number of column pairs in use by a pupil of a batch.
    fn column_pairs(&self, batch: &[usize]) -> u32 {
        let used = |at: &usize| in_use(self.pass(*at).columns, self.pass(*at).window.columns)[1];
        batch.iter().map(used).max().unwrap_or(0) / 2
    }

    /// Reports the moves of the last dispatch. `of` returns them for a pupil pass and its number of values in used
    /// columns.
    fn say_lines_moved(&self, batch: &[usize], of: impl Fn(&PupilPass, u64) -> Vec<Move>) {
        self.work.gpu.recorder.moved(|| {
            let moves = |at: &usize| {
                let pass = self.pass(*at);
                let used = u64::from(in_use(pass.columns, pass.window.columns)[1]) * pass.window.rows as u64;
                of(pass, used)
            };
            batch.iter().flat_map(moves).collect()
        });
    }

    /// Returns batches of pupils whose windows have equally many rows, with frames (first, count) that a kernel can
    /// bind together with their windows. A batch has all frames, or a single pupil has some of them.
    fn frames_of_batches(&self, framed: &[Resource], resources: &[Resource]) -> Result<Vec<BatchFrames>, EngineError> {
        let moved = |at: usize| 2 * self.bytes_of(&[Resource::Window], at);
        let beside = |at: &usize| moved(*at) / self.shape.frames.max(1) as u64;
        let mut all = Vec::new();
        for batch in self.batches(resources, moved, |at| Some(self.pass(at).window.rows))? {
            let chunks = self.frames_at_once(framed, batch.iter().map(beside).sum())?;
            if let [(first, count)] = chunks[..] {
                all.push((batch, first, count));
                continue;
            }
            for at in batch {
                let chunks = self.frames_at_once(framed, beside(&at))?;
                all.extend(chunks.into_iter().map(|(first, count)| (vec![at], first, count)));
            }
        }
        Ok(all)
    }

    /// Returns the windows of a batch, or these frames of a single pupil, with the start of the first pupil's window.
    fn spread_frames(&self, batch: &[usize], first: usize, count: usize) -> Result<(Range<'a>, u32), EngineError> {
        let (range, base) = self.spread(Resource::Window, batch)?;
        let [at] = batch else { return Ok((range, base)) };
        Ok((self.layout_of(Resource::Window, *at)?.range(range.block, first, count), base))
    }

    /// Returns the push constants of these kernels, with numbers in the order of their shader and the indices of a
    /// batch.
    fn push(&self, numbers: &[u32], batch: &[usize]) -> Vec<u32> {
        [numbers, &self.members(batch)].concat()
    }

    fn pass_columns(&mut self) -> Result<(), EngineError> {
        for (batch, first, count) in
            self.frames_of_batches(&[Resource::Field], &[Resource::Window, Resource::Transfer])?
        {
            let rows = self.pass(batch[0]).window.rows;
            let planned = self.planned(rows, Axis::ColumnPairs)?;
            let Some(shared) = planned.shared() else { continue };
            let spectrum_stride = self.layout(Resource::Field)?.stride() as u32;
            let (transfer, transfer_base) = self.spread(Resource::Transfer, &batch)?;
            let [tables, pupils] = [self.work.tables.all()?, self.work.tables.pupils()?];
            let size = self.shape.storage.bytes() as u64;
            let field = self.bound(Resource::Field, first, count)?;
            let (window, window_base) = self.spread_frames(&batch, first, count)?;
            let [height, width] = self.grid_size().map(|n| n as u32);
            let args = [height, width, rows as u32, spectrum_stride, transfer_base, window_base];
            let lines = Lines {
                module: &eyebox_spirv::PASS_COLUMNS,
                constants: &shared_constants(shared, Axis::ColumnPairs)[..20],
                changes_phases: false,
                groups: [self.column_pairs(&batch).div_ceil(shared.lines), count as u32, batch.len() as u32],
            };
            let buffers = [field, planned.twiddles.all(), transfer, tables, window, pupils];
            self.dispatch(&lines, &buffers, cast_slice(&self.push(&args, &batch)), Vec::new)?;
            self.say_lines_moved(&batch, |pass, used| {
                let (passing, frames) = (pass.passing(), count as u64);
                vec![
                    field.reads(size * passing * frames),
                    transfer.reads(8 * passing),
                    window.writes(size * used * frames),
                ]
            });
        }
        Ok(())
    }

    fn window_columns(&mut self) -> Result<(), EngineError> {
        for (batch, first, count) in self.frames_of_batches(&[], &[Resource::Window])? {
            let rows = self.pass(batch[0]).window.rows;
            let planned = self.planned(rows, Axis::ColumnPairs)?;
            let Some(shared) = planned.shared() else { continue };
            let (window, window_base) = self.spread_frames(&batch, first, count)?;
            let args = [rows as u32, window_base];
            let frames = count as u32;
            let lines = Lines {
                module: &eyebox_spirv::WINDOW_COLUMNS,
                constants: &shared_constants(shared, Axis::ColumnPairs)[..20],
                changes_phases: false,
                groups: [self.column_pairs(&batch).div_ceil(shared.lines), frames, batch.len() as u32],
            };
            let buffers = [window, planned.twiddles.all(), self.work.tables.pupils()?];
            self.dispatch(&lines, &buffers, cast_slice(&self.push(&args, &batch)), Vec::new)?;
            let value = self.shape.storage.bytes() as u64 * u64::from(frames);
            self.say_lines_moved(&batch, |_, used| vec![window.reads(value * used), window.writes(value * used)]);
        }
        Ok(())
    }

    /// Records the rows of the pupils for which `mode` returns a mode. Its argument is true if a row of all
    /// sub-frames fits shared memory.
    fn compare_rows(&mut self, mode: impl Fn(bool) -> Option<u32>) -> Result<(), EngineError> {
        let key = |at| mode(self.is_whole(self.pass(at))).map(|mode| (mode, self.pass(at).window.columns));
        let resources = [Resource::Window, Resource::Image, Resource::Target];
        let moved = |at| 2 * self.bytes_of(&[Resource::Window], at) + self.bytes_of(&resources[1..], at);
        for batch in self.batches(&resources, moved, key)? {
            let Some(mode) = mode(self.is_whole(self.pass(batch[0]))) else { continue };
            self.compare_rows_of(&batch, mode)?;
        }
        Ok(())
    }

    fn compare_rows_of(&mut self, batch: &[usize], mode: u32) -> Result<(), EngineError> {
        let width = self.pass(batch[0]).window.columns;
        let planned = self.planned(width, Axis::Rows)?;
        let Some(together) = self.work.together(&planned, width) else { return Ok(()) };
        let Shared { threads, lines, .. } = together.shared;
        let frames = self.shape.frames as u32;
        let (window, window_base) = self.spread(Resource::Window, batch)?;
        let (image, pixels_base) = self.spread(Resource::Image, batch)?;
        // Ranges that a mode does not access may be anything.
        let compares = mode == SEE || mode == WHOLE;
        let target = if compares { self.spread(Resource::Target, batch)?.0 } else { image };
        let (losses, losses_base) = if compares { self.spread_losses(batch) } else { None }.unwrap_or((image, 0));
        let args = self.push(&[width as u32, frames, window_base, pixels_base, losses_base], batch);
        let pupils = self.work.tables.pupils()?;
        let mut constants = shared_constants(&together.shared, Axis::Rows).to_vec();
        let kept = if mode == WHOLE { together.kept } else { lines };
        let pixels = if mode == TURN_BACK { 1 } else { width as u32 };
        constants.extend([mode, kept, pixels, if compares { threads * lines } else { 1 }]);
        let rounds = if mode == TURN_BACK { frames.div_ceil(lines) } else { 1 };
        let rows = batch.iter().map(|at| self.pass(*at).window.rows).max().unwrap_or(0);
        // A single pupil goes by rows, in numbers of rows whose data starts at a multiple of 256 bytes.
        let size = self.shape.storage.bytes() as u64;
        let row = [size, 4, 4].map(|bytes| bytes * width as u64);
        let of_row = 2 * row[0] * u64::from(frames) + row[1] + row[2];
        let in_time = if batch.len() == 1 { self.work.in_time(of_row) } else { usize::MAX };
        let most = (in_time / 64).saturating_mul(64).clamp(64, rows.next_multiple_of(64));
        for first in (0..rows).step_by(most) {
            let count = most.min(rows - first);
            let from = |range: Range<'a>, row: u64| {
                let skipped = row * first as u64;
                range.block.range(range.offset + skipped, range.size - skipped)
            };
            let (window, image, target) = (from(window, row[0]), from(image, row[1]), from(target, row[2]));
            let losses = if compares { from(losses, 4) } else { image };
            let dispatch = Lines {
                module: &eyebox_spirv::COMPARE_ROWS,
                constants: &constants,
                changes_phases: false,
                groups: [count as u32, rounds, batch.len() as u32],
            };
            let buffers = [window, planned.twiddles.all(), image, target, losses, pupils];
            self.dispatch(&dispatch, &buffers, cast_slice(&args), Vec::new)?;
            self.say_lines_moved(batch, |pass, used| {
                let part =
                    |bytes: u64| if batch.len() == 1 { bytes * count as u64 / rows.max(1) as u64 } else { bytes };
                let (fields, pixels) = (part(size * u64::from(frames) * used), part(4 * pass.count() as u64));
                match mode {
                    LOOK => vec![window.reads(fields), image.writes(pixels)],
                    SEE => vec![window.reads(fields), target.reads(pixels), image.writes(pixels)],
                    TURN_BACK => vec![window.reads(fields), image.reads(pixels), window.writes(fields)],
                    _ => vec![window.reads(fields), target.reads(pixels), window.writes(fields)],
                }
            });
        }
        Ok(())
    }

    /// Returns the range of the losses of a batch, with its start in values.
    fn spread_losses(&self, batch: &[usize]) -> Option<(Range<'a>, u32)> {
        let (block, offsets) = self.work.losses?;
        let places = batch.iter().map(|at| {
            let from = offsets[self.dispatch.pupil_passes.start + at];
            (from, from + 4 * self.pass(*at).loss_parts() as u64)
        });
        let (from, to) = places.reduce(|a, b| (a.0.min(b.0), a.1.max(b.1)))?;
        Some((block.range(from, to - from), (from / 4) as u32))
    }
}
