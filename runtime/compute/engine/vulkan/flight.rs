//! What a list in flight has for itself while the next is recorded: its tables, and where the host sees its losses.

use super::super::{EngineError, PupilPass, Shape, Step};
use super::layout::all_slots;
use super::tables::Tables;
use super::views::Views;
use crate::gpu::{Block, Commands, Groups, Piece, Range};
use gpu_allocator::MemoryLocation;
use std::time::Instant;

/// Bytes from one place in the losses to the next: any device's alignment.
pub(super) const PLACE: u64 = 256;

/// Bytes of the verdict, and of what is copied to the host beside the losses.
const VERDICT: u64 = 4;

/// Whether losses were finite, on the device, and how many workgroups then change phases.
pub(super) struct Verdict {
    /// The verdict; behind a place, workgroups: three numbers for each dispatch.
    pub(super) block: Block,
    /// A loss was not finite: to be cleared before the next step.
    pub(super) is_bad: bool,
}

impl Verdict {
    /// For steps in which phases are changed by `dispatches` at most.
    pub(super) fn new(gpu: &Commands, dispatches: usize) -> Result<Self, EngineError> {
        let block = gpu.block(PLACE + 12 * dispatches as u64, "the verdict over losses")?;
        Ok(Self { block, is_bad: true })
    }

    pub(super) fn flag(&self) -> Range<'_> {
        self.block.range(0, VERDICT)
    }

    pub(super) fn groups(&self) -> Range<'_> {
        self.block.range(PLACE, self.block.size - PLACE)
    }
}

/// Dispatches that depend on the verdict, while they are recorded.
pub(super) struct Guarded<'a> {
    pub(super) verdict: &'a Verdict,
    /// Where the host writes their workgroups.
    pub(super) groups: &'a mut Block,
    pub(super) count: usize,
    /// Whether the judgement was recorded, and in which part of the list the workgroups were copied last.
    pub(super) is_judged: bool,
    pub(super) part: usize,
}

impl<'a> Guarded<'a> {
    /// These workgroups, or none; `None` where nothing was judged yet, or there is no place for more dispatches.
    pub(super) fn groups(&mut self, groups: [u32; 3]) -> Option<Groups<'a>> {
        if !self.is_judged {
            return None;
        }
        let at = 12 * self.count;
        self.groups.bytes_mut().get_mut(at..at + 12)?.copy_from_slice(bytemuck::cast_slice(&groups));
        self.count += 1;
        let all = self.verdict.groups();
        (at as u64 + 12 <= all.size).then(|| Groups::At(all.block.range(all.offset + at as u64, 12)))
    }
}

/// Losses of a pupil pass: which, where its sums start, and how many there are.
pub(super) type Answer = (usize, u64, usize);

/// One list in flight.
#[derive(Default)]
pub(super) struct Flight {
    pub(super) tables: Tables,
    /// Where the host reads: the verdict at the end, losses before it.
    losses: Option<Block>,
    /// And where it writes workgroups.
    pub(super) groups: Option<Block>,
    /// Where the losses of each pupil pass of the step start, bytes.
    pub(super) offsets: Vec<u64>,
    /// Where the last of them end.
    pub(super) end: u64,
    pub(super) answers: Vec<Answer>,
    pub(super) is_checked: bool,
    pub(super) is_judged: bool,
    /// The number of the step, until it is ended, and its pupil passes.
    pub(super) number: u64,
    pub(super) pupil_passes: usize,
    /// Its losses, where they are known already.
    pub(super) known: Option<Vec<f64>>,
    /// The submission, and what an error names; none where nothing had to be run.
    pub(super) submission: Option<u64>,
    pub(super) during: String,
    /// Seconds by the device's clock.
    pub(super) seconds: f64,
    pub(super) begun: Option<Instant>,
}

impl Flight {
    /// Finds places for the sums of each pupil pass's loss, behind one for what `check_finite` finds, as far apart as the
    /// device wants.
    fn place(&mut self, pupil_passes: &[PupilPass], order: &[usize]) {
        self.end = PLACE;
        self.offsets.clear();
        self.offsets.resize(pupil_passes.len(), PLACE);
        // What belongs to no group has a place as well.
        let rest = order.len()..pupil_passes.len();
        for at in order.iter().copied().chain(rest) {
            self.offsets[at] = self.end;
            self.end += (4 * pupil_passes[at].loss_parts() as u64).next_multiple_of(PLACE);
        }
    }

    /// Finds these places, and packs the tables.
    pub(super) fn lay_out(&mut self, step: &Step, shape: &Shape, views: Option<&Views>) {
        let (slots, order) = all_slots(step, shape);
        self.place(&step.pupil_passes, &order);
        self.tables.pack(&step.pupil_passes, (slots, order), &self.offsets, views);
    }

    /// Whether what the host sees is large enough.
    pub(super) fn fits(&self, losses: u64, groups: u64, tables: u64) -> bool {
        let size = |block: &Option<Block>| block.as_ref().map_or(0, |b| b.size);
        size(&self.losses) >= losses + PLACE && size(&self.groups) >= groups && self.tables.room() >= tables
    }

    /// Makes what the host sees large enough; what it was for is over.
    pub(super) fn fit(&mut self, gpu: &Commands, losses: u64, groups: u64, tables: u64) -> Result<(), EngineError> {
        self.tables.fit(gpu, tables)?;
        if self.number > 0 && self.known.is_none() {
            self.known = Some(self.losses(self.pupil_passes));
        }
        let wanted = losses + PLACE;
        if wanted > self.losses.as_ref().map_or(0, |b| b.size) {
            self.losses = None;
            self.losses = Some(Block::new(&gpu.device, wanted, MemoryLocation::GpuToCpu, "losses")?);
        }
        if groups > self.groups.as_ref().map_or(0, |b| b.size) {
            self.groups = None;
            self.groups = Some(Block::new(&gpu.device, groups, MemoryLocation::CpuToGpu, "workgroups")?);
        }
        Ok(())
    }

    /// Records what the host reads at the end.
    pub(super) fn copy_back(&self, gpu: &mut Commands, losses: &Block, verdict: Option<&Verdict>) {
        let Some(host) = &self.losses else { return };
        let checked: Option<Piece> = self.is_checked.then_some((0, 0, 4));
        let sums = self.answers.iter().map(|(_, at, parts)| (*at, *at, 4 * *parts as u64));
        let pieces: Vec<Piece> = checked.into_iter().chain(sums).collect();
        gpu.device.count(|counts| counts.losses_read_back += pieces.iter().map(|piece| piece.2).sum::<u64>());
        gpu.recorder.copy(losses, host, pieces);
        if let Some(verdict) = verdict.filter(|_| self.is_judged) {
            gpu.device.count(|counts| counts.losses_read_back += VERDICT);
            gpu.recorder.copy(&verdict.block, host, [(0, host.size - PLACE, VERDICT)]);
        }
    }

    /// The losses of `count` pupil passes, when it is over; all NaN where the device found what is not finite, or left the
    /// phases alone.
    pub(super) fn losses(&self, count: usize) -> Vec<f64> {
        let mut result = vec![0.0; count];
        let Some(host) = &self.losses else { return result };
        let bytes = host.bytes();
        for &(pass, at, parts) in &self.answers {
            let sums = bytes.get(at as usize..at as usize + 4 * parts).unwrap_or_default();
            result[pass] = bytemuck::pod_collect_to_vec::<u8, f32>(sums).into_iter().map(f64::from).sum();
        }
        let is_set = |at: u64| bytes.get(at as usize..at as usize + 4).is_some_and(|word| word != [0; 4]);
        if self.is_checked && is_set(0) || self.is_judged && is_set(host.size - PLACE) {
            result.fill(f64::NAN);
        }
        result
    }
}
