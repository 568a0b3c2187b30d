//! Kernels over several pupils at once: the pupils of a dispatch are its z, and a table has the arguments of each.

use super::super::tables::ShotOf;
use super::call::Call;
use crate::engine::{EngineError, Resource};
use crate::gpu::{DeviceKind, Range};
use crate::plan::moved;
use eyebox_kernels::BATCH;
use eyebox_kernels::photograph::STRIP;
use std::collections::HashMap;

/// Pupils of the dispatch, in their order, whose buffers a kernel sees at once.
pub(super) type Members = Vec<usize>;

impl<'a> Call<'_, 'a> {
    /// These pupils of the dispatch in batches, of whose `resources` a kernel sees all, and which move so many bytes that it does not
    /// take long: a pupil moves `bytes`. In software, which starts a workgroup at
    /// a price even where it finds nothing to do, each by itself.
    pub(super) fn batches(
        &self,
        pupils: impl IntoIterator<Item = usize>,
        resources: &[Resource],
        bytes: impl Fn(usize) -> u64,
    ) -> Result<Vec<Members>, EngineError> {
        let gpu = &*self.work.gpu;
        let most = if gpu.device.planned_as == DeviceKind::Cpu { 1 } else { BATCH };
        let mut batches: Vec<Members> = Vec::new();
        let mut sum = 0;
        for pupil in pupils {
            sum += bytes(pupil);
            let fits = match batches.last() {
                Some(batch) if batch.len() < most && sum <= gpu.dispatch_bytes() => {
                    let sizes = resources.iter().map(|resource| Ok(self.spread(*resource, batch[0], pupil)?.0.size));
                    sizes
                        .collect::<Result<Vec<u64>, EngineError>>()?
                        .into_iter()
                        .all(|size| size <= gpu.limits().storage_range)
                }
                _ => false,
            };
            match batches.last_mut().filter(|_| fits) {
                Some(batch) => batch.push(pupil),
                None => {
                    sum = bytes(pupil);
                    batches.push(vec![pupil]);
                }
            }
        }
        Ok(batches)
    }

    /// What pupils `first` to `last` of the dispatch have of a resource, and where that starts, in values.
    pub(super) fn spread(
        &self,
        resource: Resource,
        first: usize,
        last: usize,
    ) -> Result<(Range<'a>, u32), EngineError> {
        let [from, to] = [first, last].map(|at| self.layout_of(resource, at));
        let (from, to) = (from?, to?);
        let block = self.work.arenas.block(resource).ok_or_else(|| self.missing(resource))?;
        let range = block.range(from.offset, to.offset + to.bytes() - from.offset);
        Ok((range, (from.offset / from.value.size() as u64) as u32))
    }

    /// The places of these pupils in the table.
    pub(super) fn members(&self, batch: &[usize]) -> [u32; BATCH] {
        let mut members = [0; BATCH];
        for (member, at) in members.iter_mut().zip(batch) {
            *member = (self.dispatch.pupil_passes.start + at) as u32;
        }
        members
    }

    /// Workgroups over rows and columns of each of a batch: of the largest.
    fn batch_groups(&self, batch: usize, sizes: impl Iterator<Item = [u32; 2]>) -> [u32; 3] {
        let [rows, columns] = sizes.fold([0; 2], |[h, w], [rows, columns]| [h.max(rows), w.max(columns)]);
        let [across, along, _] = self.work.rows(rows, columns, 1);
        [across, along, batch as u32]
    }

    /// The propagation kernels of all pupils of the dispatch.
    pub(super) fn transfer(&mut self) -> Result<(), EngineError> {
        let bytes = |at| 8 * self.pass(at).count() as u64;
        for batch in self.batches(0..self.slots.len(), &[Resource::Transfer], bytes)? {
            let (transfer, base) = self.spread(Resource::Transfer, batch[0], batch[batch.len() - 1])?;
            let buffers = [self.work.tables.all()?, transfer, self.work.tables.pupils()?];
            let sizes = batch.iter().map(|at| self.pass(*at)).map(|pass| [pass.transfer.rows, pass.transfer.columns]);
            let groups = self.batch_groups(batch.len(), sizes);
            self.run(&buffers, &base, &self.members(&batch), groups)?;
            self.say_batch_moved(&batch);
        }
        Ok(())
    }

    /// Their photographs at their windows' sizes.
    pub(super) fn resample(&mut self) -> Result<(), EngineError> {
        let shots = (0..self.slots.len()).filter(|at| self.pass(*at).shot.is_some());
        let bytes = |at| {
            [Resource::Accumulator, Resource::Target]
                .iter()
                .filter_map(|r| self.layout_of(*r, at).ok())
                .map(|l| l.bytes())
                .sum()
        };
        for batch in self.batches(shots, &[Resource::Accumulator, Resource::Target], bytes)? {
            let (first, last) = (batch[0], batch[batch.len() - 1]);
            let (accumulator, from) = self.spread(Resource::Accumulator, first, last)?;
            let (target, to) = self.spread(Resource::Target, first, last)?;
            let buffers = [accumulator, self.work.tables.all()?, target, self.work.tables.pupils()?];
            let sizes = batch.iter().map(|at| self.pass(*at).window).map(|w| [w.rows as u32, w.columns as u32]);
            let groups = self.batch_groups(batch.len(), sizes);
            self.run(&buffers, &[from, to], &self.members(&batch), groups)?;
            self.say_batch_moved(&batch);
        }
        Ok(())
    }

    /// Their photographs, block by block of views: a pupil adds up in its accumulator what each block holds.
    pub(super) fn photograph(&mut self) -> Result<(), EngineError> {
        let (tables, Some(views)) = (self.work.tables, self.work.views) else { return Ok(()) };
        let pupils = self.dispatch.pupil_passes.clone();
        let [taps, table] = tables.shots()?;
        for (block, views) in views.blocks.iter().enumerate() {
            let mut shots = tables.shots_of().iter().enumerate();
            let mine = |of: &ShotOf| of.block == block && pupils.contains(&of.pupil_pass);
            let Some(begin) = shots.position(|(_, of)| mine(of)) else { continue };
            let shots = tables.shots_of()[begin..].iter().take_while(|of| mine(of)).collect::<Vec<_>>();
            if shots.iter().any(|of| of.adds) {
                self.work.gpu.recorder.barrier();
            }
            // Two samples of halves a tap, in neighbouring blocks of nine rows; what was added up before, and what is now.
            let moved = |of: &&ShotOf| {
                let at = of.pupil_pass - pupils.start;
                let pixels = self.layout_of(Resource::Accumulator, at).map_or(0, |layout| layout.values as u64);
                let before = if of.adds { 4 * pixels } else { 0 };
                (at, [2 * pixels * u64::from(of.count) * 9 / 8, before, 4 * pixels])
            };
            let moved: HashMap<usize, [u64; 3]> = shots.iter().map(moved).collect();
            let bytes = |at: usize| moved[&at].iter().sum::<u64>();
            let mut first = begin as u32;
            let each = shots.iter().map(|of| of.pupil_pass - pupils.start);
            for batch in self.batches(each, &[Resource::Accumulator], bytes)? {
                let (accumulator, base) = self.spread(Resource::Accumulator, batch[0], batch[batch.len() - 1])?;
                let sizes = || batch.iter().filter_map(|at| self.pass(*at).shot.as_ref());
                let [height, width] =
                    sizes().fold([0; 2], |[h, w], shot| [h.max(shot.args.height), w.max(shot.args.width)]);
                // A pupil that moves too much by itself goes in parts.
                let parts =
                    batch.iter().map(|at| bytes(*at)).sum::<u64>().div_ceil(self.work.gpu.dispatch_bytes()).max(1);
                let rows = height.div_ceil(STRIP).div_ceil(parts as u32).max(1) * STRIP;
                for top in (0..height).step_by(rows as usize) {
                    let end = height.min(top + rows);
                    let [across, along, _] = self.work.rows((end - top).div_ceil(STRIP), width, 1);
                    let buffers = [views.all(), taps, accumulator, table];
                    self.run(&buffers, &[first, base, top, end], &[], [across, along, batch.len() as u32])?;
                    self.work.gpu.recorder.moved(|| {
                        let mut moves = Vec::new();
                        for at in &batch {
                            let Ok((accumulator, _)) = self.spread(Resource::Accumulator, *at, *at) else { continue };
                            let part = |bytes: u64| bytes * u64::from(end - top) / u64::from(height);
                            let [read, before, written] = moved[at].map(part);
                            moves.push(views.all().reads(read));
                            moves.extend((before > 0).then(|| accumulator.reads(before)));
                            moves.push(accumulator.writes(written));
                        }
                        moves
                    });
                }
                first += batch.len() as u32;
            }
        }
        Ok(())
    }

    /// Says what the last dispatch moves, pupil by pupil.
    fn say_batch_moved(&self, batch: &[usize]) {
        self.work.gpu.recorder.moved(|| {
            let mut moves = Vec::new();
            for (at, bound) in batch.iter().flat_map(|at| self.kernel.binds().iter().map(move |bound| (*at, bound))) {
                let Ok((range, _)) = self.spread(bound.1, at, at) else { continue };
                let pass = Some(self.dispatch.pupil_passes.start + at);
                let [read, written] = moved(self.kernel, *bound, self.step, self.shape, pass, 1).unwrap_or_default();
                moves.extend((read > 0).then(|| range.reads(read)));
                moves.extend((written > 0).then(|| range.writes(written)));
            }
            moves
        });
    }
}
