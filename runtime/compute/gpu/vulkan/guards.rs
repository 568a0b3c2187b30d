//! Guards the bound ranges of dispatches with bands of NaN, for tests.
//!
//! Each range that a dispatch is bound to is copied between two bands of NaN within the dispatch's reach, and copied
//! back after it. A kernel that reads beyond the ends of a range reads NaN, and a kernel that writes there is found.
//! Without guards this stays hidden, because software devices return 0 for reads out of bounds, and hardware returns
//! other data.

use super::block::{Block, Range};
use super::groups::Groups;
use super::modules::instructions;
use super::recorder::Recorder;
use super::{Pipeline, error::EngineError};
use gpu_allocator::MemoryLocation;
use std::collections::BTreeSet;

/// Bytes of a band.
const BAND: u64 = 4096;

/// The storage class of buffers, in SPIR-V.
const STORAGE: u32 = 12;

/// NaN as a float32, and as two halves.
const POISON: u32 = 0x7fe0_7fe0;

/// The guarded ranges, and their counts.
#[derive(Default)]
pub(crate) struct Guards {
    held: Vec<(String, Block, u64)>,
    /// Number of guarded dispatches.
    pub(crate) count: usize,
    /// Modules, with pairs of bindings that overlap in memory, of which one is written.
    pub(crate) aliased: BTreeSet<(&'static str, usize, usize)>,
}

impl Guards {
    /// Returns the writes outside of ranges since the last call. All submitted work is over.
    pub(crate) fn faults(&mut self) -> Vec<String> {
        let mut faults = Vec::new();
        for (what, block, size) in self.held.drain(..) {
            let words: &[u32] = bytemuck::cast_slice(block.bytes());
            let (front, end) = ((BAND / 4) as usize, ((BAND + size) / 4) as usize);
            let band = (0..front).chain(end..end + front);
            if let Some(at) = band.into_iter().find(|at| words[*at] != POISON) {
                faults.push(format!("{what} wrote at byte {} of {size}", 4 * at as i64 - BAND as i64));
            }
        }
        faults
    }
}

impl Recorder {
    /// Records a dispatch between bands. Its module's blocks were [shifted](shifted).
    pub(super) fn dispatch_guarded(
        &mut self,
        pipeline: Pipeline,
        buffers: &[Range<'_>],
        push: &[u8],
        groups: Groups<'_>,
    ) -> Result<(), EngineError> {
        let end = |range: &Range<'_>| range.offset + range.size;
        let meets = |a: &Range<'_>, b: &Range<'_>| a.block.raw == b.block.raw && a.offset < end(b) && b.offset < end(a);
        // Overlapping ranges share one guarded copy.
        let mut whole: Vec<Range<'_>> = Vec::new();
        for range in buffers {
            let mut joined = *range;
            whole.retain(|other| {
                if meets(other, &joined) {
                    let begin = joined.offset.min(other.offset);
                    joined = Range { offset: begin, size: end(other).max(end(&joined)) - begin, ..joined };
                    return false;
                }
                true
            });
            whole.push(joined);
        }
        let mut blocks = Vec::with_capacity(whole.len());
        for range in &whole {
            let size = range.size + 2 * BAND;
            let mut block = Block::new(&self.device, size, MemoryLocation::CpuToGpu, "guards")?;
            bytemuck::cast_slice_mut::<_, u32>(block.bytes_mut()).fill(POISON);
            blocks.push(block);
        }
        self.barrier();
        for (range, block) in whole.iter().zip(&blocks) {
            self.copy(range.block, block, [(range.offset, BAND, range.size)]);
        }
        self.barrier();
        let place = |range: &Range<'_>| whole.iter().position(|w| meets(w, range)).unwrap_or(0);
        let within = |range: &Range<'_>| {
            let at = place(range);
            // The range includes both bands, because the module's blocks begin one band later.
            blocks[at].range(range.offset - whole[at].offset, range.size + 2 * BAND)
        };
        let bound: Vec<Range<'_>> = buffers.iter().map(within).collect();
        self.bind_and_dispatch(pipeline, &bound, push, groups)?;
        self.barrier();
        for (range, block) in whole.iter().zip(&blocks) {
            self.copy(block, range.block, [(BAND, range.offset, range.size)]);
        }
        self.barrier();
        let Some(guards) = &mut self.guards else { return Ok(()) };
        guards.count += 1;
        for (i, a) in buffers.iter().enumerate() {
            let others = buffers.iter().enumerate().skip(i + 1).filter(|(_, b)| meets(a, b));
            guards.aliased.extend(others.map(|(j, _)| (pipeline.module, i, j)));
        }
        for (i, (range, block)) in whole.iter().zip(blocks).enumerate() {
            let bindings: Vec<usize> = (0..buffers.len()).filter(|b| place(&buffers[*b]) == i).collect();
            guards.held.push((format!("{}, bindings {bindings:?},", pipeline.module), block, range.size));
        }
        Ok(())
    }
}

/// Returns the module with all storage blocks shifted by one band, so that a value before a range is still in reach.
pub(super) fn shifted(words: &[u32]) -> Vec<u32> {
    let (variable, pointer, member_decorate, offset) = (59, 32, 72, 35);
    let mut blocks = BTreeSet::new();
    for (_, _, variable) in instructions(words).filter(|(_, code, v)| *code == variable && v[3] == STORAGE) {
        blocks.extend(instructions(words).filter(|(_, c, p)| *c == pointer && p[1] == variable[1]).map(|(.., p)| p[3]));
    }
    let mut moved = words.to_vec();
    for (at, code, instruction) in instructions(words) {
        if code == member_decorate && instruction[3] == offset && blocks.contains(&instruction[1]) {
            moved[at + 4] += BAND as u32;
        }
    }
    moved
}

/// Declarations of a module about a buffer.
#[derive(Debug, Default)]
pub(crate) struct Flags {
    pub(crate) binding: u32,
    pub(crate) is_written: bool,
    pub(crate) is_aliased: bool,
}

/// Returns the declarations of all buffers of a module.
pub(crate) fn flags(module: &str) -> Vec<Flags> {
    let module = eyebox_spirv::module(module).expect("a module");
    let words = module.words();
    let (variable, pointer, decorate, member_decorate) = (59, 32, 71, 72);
    let (aliased, non_writable, binding) = (20, 24, 33);
    let of = |wanted: u32| instructions(words).filter(move |(_, code, _)| *code == wanted).map(|(.., words)| words);
    let buffers = of(variable).filter(|v| v[3] == STORAGE);
    buffers
        .map(|v| {
            let block = of(pointer).find(|p| p[1] == v[1]).map_or(0, |p| p[3]);
            let own = |what: u32| of(decorate).find(move |d| d[1] == v[2] && d[2] == what);
            Flags {
                binding: own(binding).map_or(u32::MAX, |d| d[3]),
                is_written: !of(member_decorate).any(|d| d[1] == block && d[3] == non_writable),
                is_aliased: own(aliased).is_some(),
            }
        })
        .collect()
}
