//! Records kernels over several pupils at once.
//!
//! The pupils of a dispatch are its z coordinate, and a table has the arguments of each.

use super::super::layout::Layout;
use super::call::Call;
use crate::engine::{EngineError, Resource};
use crate::gpu::{DeviceKind, Range};
use crate::plan::moved;
use eyebox_kernels::BATCH;
use eyebox_kernels::photograph::STRIP;

/// Pupils of the dispatch, in order, whose buffers a kernel binds at once.
pub(super) type Members = Vec<usize>;

impl<'a> Call<'_, 'a> {
    /// Groups the pupils of the dispatch that have a key. A batch has neighbors in memory with one key. A kernel can
    /// bind all their `resources`, and they move few enough bytes that it does not take long, `bytes` per pupil. In
    /// software each pupil is separate, because there a workgroup has a cost even if it finds nothing to do.
    pub(super) fn batches<K: PartialEq>(
        &self,
        resources: &[Resource],
        bytes: impl Fn(usize) -> u64,
        key: impl Fn(usize) -> Option<K>,
    ) -> Result<Vec<Members>, EngineError> {
        let gpu = &*self.work.gpu;
        let most = if gpu.device.planned_as == DeviceKind::Cpu { 1 } else { BATCH };
        let limit = gpu.limits.storage_range;
        let (mut batches, mut last, mut sum): (Vec<Members>, Option<K>, u64) = (Vec::new(), None, 0);
        for at in self.order()? {
            let Some(key) = key(at) else { continue };
            sum += bytes(at);
            let has_room = |batch: &Members| batch.len() < most && sum <= gpu.dispatch_bytes();
            match batches.last_mut().filter(|batch| last.as_ref() == Some(&key) && has_room(batch)) {
                Some(batch) => {
                    batch.push(at);
                    let too_large = |r: &Resource| self.spread(*r, batch).is_ok_and(|(range, _)| range.size > limit);
                    if resources.iter().any(too_large) {
                        batch.pop();
                        batches.push(vec![at]);
                        sum = bytes(at);
                    }
                }
                None => {
                    batches.push(vec![at]);
                    sum = bytes(at);
                }
            }
            last = Some(key);
        }
        Ok(batches)
    }

    /// Returns the bytes that a pupil of the dispatch has of these resources.
    pub(super) fn bytes_of(&self, resources: &[Resource], at: usize) -> u64 {
        resources.iter().filter_map(|resource| self.layout_of(*resource, at).ok()).map(|layout| layout.bytes()).sum()
    }

    /// Returns the pupils of the dispatch in the order of memory.
    fn order(&self) -> Result<impl Iterator<Item = usize> + use<>, EngineError> {
        let pupils = self.dispatch.pupil_passes.clone();
        let order = self.work.tables.order(&pupils, self.slots);
        let odd = || {
            EngineError::mismatch(format!(
                "{} runs over pupil passes {pupils:?}, but another kernel runs over some of them",
                self.kernel.name()
            ))
        };
        let order = order.ok_or_else(odd)?.iter().map(|i| i - pupils.start).collect::<Vec<_>>();
        Ok(order.into_iter())
    }

    /// Returns the range of a resource over these pupils of the dispatch, with its start in values.
    pub(super) fn spread(&self, resource: Resource, batch: &[usize]) -> Result<(Range<'a>, u32), EngineError> {
        let block = self.work.arenas.block(resource).ok_or_else(|| self.missing(resource))?;
        let (mut from, mut to, mut size) = (u64::MAX, 0, 1);
        for at in batch {
            let layout = self.layout_of(resource, *at)?;
            (from, to) = (from.min(layout.offset), to.max(layout.offset + layout.bytes()));
            size = layout.value.size() as u64;
        }
        let from = from.min(to);
        Ok((block.range(from, to - from), (from / size) as u32))
    }

    /// Returns the indices of these pupils in the table.
    pub(super) fn members(&self, batch: &[usize]) -> [u32; BATCH] {
        let mut members = [0; BATCH];
        for (member, at) in members.iter_mut().zip(batch) {
            *member = (self.dispatch.pupil_passes.start + at) as u32;
        }
        members
    }

    /// Returns the workgroups over rows and columns of each pupil of a batch, sized by the largest pupil.
    fn batch_groups(&self, batch: usize, sizes: impl Iterator<Item = [u32; 2]>) -> [u32; 3] {
        let [rows, columns] = sizes.fold([0; 2], |[h, w], [rows, columns]| [h.max(rows), w.max(columns)]);
        let [across, along, _] = self.work.rows(rows, columns, 1);
        [across, along, batch as u32]
    }

    /// Records the propagation kernels of all pupils of the dispatch.
    pub(super) fn transfer(&mut self) -> Result<(), EngineError> {
        let bytes = |at| 8 * self.pass(at).count() as u64;
        for batch in self.batches(&[Resource::Transfer], bytes, |at| Some(self.pass(at).mode_count() > 1))? {
            if self.pass(batch[0]).mode_count() > 1 {
                batch.iter().try_for_each(|at| self.transfer_of_modes(*at))?;
                continue;
            }
            let (transfer, base) = self.spread(Resource::Transfer, &batch)?;
            let buffers = [self.work.tables.all()?, transfer, self.work.tables.pupils()?];
            let sizes = batch.iter().map(|at| self.pass(*at)).map(|pass| [pass.transfer.rows, pass.transfer.columns]);
            let groups = self.batch_groups(batch.len(), sizes);
            self.run(&buffers, &base, &self.members(&batch), groups)?;
            self.say_batch_moved(&batch);
        }
        Ok(())
    }

    /// Records the propagation kernels of all modes of a pupil.
    ///
    /// A dispatch binds the part of its modes only. If dispatches without a barrier between them bind the same bytes, a
    /// validation layer reports a hazard, because it counts all bound bytes as written.
    fn transfer_of_modes(&mut self, at: usize) -> Result<(), EngineError> {
        let (tables, arenas, pass) = (self.work.tables, self.work.arenas, self.pass(at));
        let index = self.dispatch.pupil_passes.start + at;
        let block = arenas.block(Resource::Transfer).ok_or_else(|| self.missing(Resource::Transfer))?;
        let layout = self.layout_of(Resource::Transfer, at)?;
        let most = self.work.at_once(&layout).clamp(1, BATCH);
        let modes: Vec<usize> = (0..pass.mode_count()).collect();
        for some in modes.chunks(most) {
            let part = Layout { offset: layout.offset + some[0] as u64 * layout.step(), frames: some.len(), ..layout };
            let base = (part.offset / part.value.size() as u64) as u32;
            let mut members = [0; BATCH];
            members.iter_mut().zip(some).for_each(|(member, mode)| *member = tables.place(index, *mode) as u32);
            let sizes = std::iter::once([pass.transfer.rows, pass.transfer.columns]);
            let groups = self.batch_groups(some.len(), sizes);
            self.run(&[tables.all()?, part.range(block, 0, some.len()), tables.pupils()?], &base, &members, groups)?;
            self.say_batch_moved(&vec![at; some.len()]);
        }
        Ok(())
    }

    /// Records the target images at the size of their windows.
    pub(super) fn resample(&mut self) -> Result<(), EngineError> {
        let resources = [Resource::Accumulator, Resource::Target];
        let has_shot = |at| self.pass(at).shot.is_some().then_some(());
        for batch in self.batches(&resources, |at| self.bytes_of(&resources, at), has_shot)? {
            let (accumulator, from) = self.spread(Resource::Accumulator, &batch)?;
            let (target, to) = self.spread(Resource::Target, &batch)?;
            let buffers = [accumulator, self.work.tables.all()?, target, self.work.tables.pupils()?];
            let sizes = batch.iter().map(|at| self.pass(*at).window).map(|w| [w.rows as u32, w.columns as u32]);
            let groups = self.batch_groups(batch.len(), sizes);
            self.run(&buffers, &[from, to], &self.members(&batch), groups)?;
            self.say_batch_moved(&batch);
        }
        Ok(())
    }

    /// Records the target images, block by block of views. A pupil adds up the light of each block in its
    /// accumulator.
    pub(super) fn photograph(&mut self) -> Result<(), EngineError> {
        let (tables, Some(views)) = (self.work.tables, self.work.views) else { return Ok(()) };
        let pupils = self.dispatch.pupil_passes.clone();
        let [taps, table] = tables.shots()?;
        for (block, views) in views.blocks.iter().enumerate() {
            let shot = |at: usize| tables.shot(block, pupils.start + at);
            if (0..pupils.len()).filter_map(shot).any(|(_, shot)| shot.adds) {
                self.work.gpu.recorder.barrier();
            }
            // A tap reads two samples of halves, in neighboring blocks of nine rows. Then follow the old and the new
            // sum.
            let moved = |at: usize| {
                let pixels = self.layout_of(Resource::Accumulator, at).map_or(0, |layout| layout.values as u64);
                let (count, adds) = shot(at).map_or((0, false), |(_, shot)| (shot.count, shot.adds));
                [2 * pixels * u64::from(count) * 9 / 8, if adds { 4 * pixels } else { 0 }, 4 * pixels]
            };
            let moved: Vec<[u64; 3]> = (0..pupils.len()).map(moved).collect();
            let bytes = |at: usize| moved[at].iter().sum::<u64>();
            for batch in self.batches(&[Resource::Accumulator], bytes, |at| shot(at).map(|_| ()))? {
                let Some((first, _)) = shot(batch[0]) else { continue };
                let (accumulator, base) = self.spread(Resource::Accumulator, &batch)?;
                let sizes = batch.iter().filter_map(|at| self.pass(*at).shot.as_ref());
                let [height, width] =
                    sizes.fold([0; 2], |[h, w], shot| [h.max(shot.args.height), w.max(shot.args.width)]);
                // A pupil that moves too much for one dispatch goes in parts.
                let parts =
                    batch.iter().map(|at| bytes(*at)).sum::<u64>().div_ceil(self.work.gpu.dispatch_bytes()).max(1);
                let rows = height.div_ceil(STRIP).div_ceil(parts as u32).max(1) * STRIP;
                for top in (0..height).step_by(rows as usize) {
                    let end = height.min(top + rows);
                    let [across, along, _] = self.work.rows((end - top).div_ceil(STRIP), width, 1);
                    let buffers = [views.all(), taps, accumulator, table];
                    let args = [first as u32, base, top, end];
                    self.run(&buffers, &args, &[], [across, along, batch.len() as u32])?;
                    self.work.gpu.recorder.moved(|| {
                        let mut moves = Vec::new();
                        for at in &batch {
                            let Ok((accumulator, _)) = self.spread(Resource::Accumulator, &[*at]) else { continue };
                            let part = |bytes: u64| bytes * u64::from(end - top) / u64::from(height);
                            let [read, before, written] = moved[*at].map(part);
                            moves.push(views.all().reads(read));
                            moves.extend((before > 0).then(|| accumulator.reads(before)));
                            moves.push(accumulator.writes(written));
                        }
                        moves
                    });
                }
            }
        }
        Ok(())
    }

    /// Reports the moves of the last dispatch, pupil by pupil.
    fn say_batch_moved(&self, batch: &[usize]) {
        self.work.gpu.recorder.moved(|| {
            let mut moves = Vec::new();
            for (at, bound) in batch.iter().flat_map(|at| self.kernel.binds().iter().map(move |bound| (*at, bound))) {
                let Ok((range, _)) = self.spread(bound.1, &[at]) else { continue };
                let pass = Some(self.pass(at));
                let [read, written] = moved(self.kernel, *bound, self.step, self.shape, pass, 1).unwrap_or_default();
                moves.extend(range.moves(read, written));
            }
            moves
        });
    }
}
