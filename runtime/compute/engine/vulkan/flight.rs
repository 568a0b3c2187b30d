//! Holds the resources of a list in flight while the next one is recorded, such as its tables and losses.

use super::super::{EngineError, PupilPass, Shape, Step};
use super::layout::all_slots;
use super::tables::Tables;
use super::views::Views;
use crate::gpu::{Block, Commands, Groups, Piece, Range};
use gpu_allocator::MemoryLocation;
use std::time::Instant;

/// Bytes from one place in the losses to the next, which suit any device's alignment.
pub(super) const PLACE: u64 = 256;

/// Bytes of the verdict, which are copied to the host with the losses.
const VERDICT: u64 = 4;

/// The verdict on the device, which states if losses were finite and how many workgroups then change phases.
pub(super) struct Verdict {
    /// The verdict in the first place, followed by the workgroups, three numbers for each dispatch.
    pub(super) block: Block,
    /// True if a loss was not finite. The verdict must be cleared before the next step.
    pub(super) is_bad: bool,
}

impl Verdict {
    /// Makes the verdict of steps in which at most `dispatches` dispatches change phases.
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
    /// Memory in which the host writes their workgroups.
    pub(super) groups: &'a mut Block,
    pub(super) count: usize,
    /// True if the judgment was recorded. `part` is the part of the list in which the workgroups were copied last.
    pub(super) is_judged: bool,
    pub(super) part: usize,
}

impl<'a> Guarded<'a> {
    /// Returns these workgroups, or none after a bad verdict. Returns `None` before the judgment, or without room for
    /// more dispatches.
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

/// Index of a pupil pass, start of the sums of its loss, and their number.
pub(super) type Answer = (usize, u64, usize);

/// One list in flight.
#[derive(Default)]
pub(super) struct Flight {
    pub(super) tables: Tables,
    /// Memory that the host reads, with the losses and then the verdict.
    losses: Option<Block>,
    /// Memory in which the host writes workgroups.
    pub(super) groups: Option<Block>,
    /// Start of the losses of each pupil pass of the step, bytes.
    pub(super) offsets: Vec<u64>,
    /// End of the last losses.
    pub(super) end: u64,
    pub(super) answers: Vec<Answer>,
    pub(super) is_checked: bool,
    pub(super) is_judged: bool,
    /// Number of the step until it is ended, or 0, and its number of pupil passes.
    pub(super) number: u64,
    pub(super) pupil_passes: usize,
    /// Losses of the step, if they were already read.
    pub(super) known: Option<Vec<f64>>,
    /// The submission, with its name for errors. There is none if nothing had to run.
    pub(super) submission: Option<u64>,
    pub(super) during: String,
    /// Seconds by the device's clock.
    pub(super) seconds: f64,
    pub(super) begun: Option<Instant>,
}

impl Flight {
    /// Assigns a place to the sums of each pupil pass's loss, after one place for the result of `check_finite`.
    /// Places are as far apart as the device requires.
    fn place(&mut self, pupil_passes: &[PupilPass], order: &[usize]) {
        self.end = PLACE;
        self.offsets.clear();
        self.offsets.resize(pupil_passes.len(), PLACE);
        // Pupil passes without a group have a place as well.
        let rest = order.len()..pupil_passes.len();
        for at in order.iter().copied().chain(rest) {
            self.offsets[at] = self.end;
            self.end += (4 * pupil_passes[at].loss_parts() as u64).next_multiple_of(PLACE);
        }
    }

    /// Assigns these places, and packs the tables.
    pub(super) fn lay_out(&mut self, step: &Step, shape: &Shape, views: Option<&Views>) {
        let (slots, order) = all_slots(step, shape);
        self.place(&step.pupil_passes, &order);
        self.tables.pack(&step.pupil_passes, (slots, order), &self.offsets, views);
    }

    /// Returns true if the memory for the host is large enough.
    pub(super) fn fits(&self, losses: u64, groups: u64, tables: u64) -> bool {
        let size = |block: &Option<Block>| block.as_ref().map_or(0, |b| b.size);
        size(&self.losses) >= losses + PLACE && size(&self.groups) >= groups && self.tables.room() >= tables
    }

    /// Makes the memory for the host large enough. Its former use is over.
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

    /// Records the copies that the host reads at the end.
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

    /// Returns the losses of `count` pupil passes of a finished list. All are NaN if the device found a value that is
    /// not finite, or left the phases unchanged.
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
