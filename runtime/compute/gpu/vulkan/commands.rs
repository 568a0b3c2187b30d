//! Serves one user of a device, who allocates, fills and reads blocks and runs recorded kernels.

use super::background::{Background, make};
use super::block::Block;
use super::device::Device;
use super::error::EngineError;
use super::open::Gpu;
use super::pipelines::{Pipeline, Wanted};
use super::recorder::{Piece, Recorder};
use super::report::{DeviceKind, Limits};
use crate::plan::DISPATCH_BYTES;
use eyebox_spirv::Module;
use gpu_allocator::MemoryLocation;
use rayon::prelude::*;
use std::sync::Arc;

/// Bytes that pass between host and device at once.
const STAGE: u64 = 32 << 20;

/// The resources of one user of a device.
pub(crate) struct Commands {
    // Fields are in the order in which they are dropped, with recordings before their resources and the device last.
    background: Vec<Background>,
    pub(crate) recorder: Recorder,
    up: Option<Block>,
    down: Option<Block>,
    /// Kept between transfers, so that none allocates.
    batch: Vec<Piece>,
    /// Pipelines to make later, while they are only collected.
    wanted: Option<Vec<Wanted>>,
    /// True if uploads are gathered in one recording. `gathered` is the number of bytes of the stage that they take.
    /// A recording is open if it is above 0.
    gathers: bool,
    gathered: u64,
    /// The device's limits, which a test may lower.
    pub(crate) limits: Limits,
    /// True if memory shared with the host is written and read in place. A test may force staging.
    pub(crate) in_place: bool,
    pub(crate) device: Arc<Device>,
    pub(crate) shared: Gpu,
}

impl Commands {
    /// Makes the resources of another user of a device.
    pub(crate) fn new(gpu: &Gpu) -> Result<Self, EngineError> {
        let (shared, device) = (gpu.clone(), Arc::clone(&gpu.device));
        let (recorder, batch, limits) = (Recorder::new(&device)?, Vec::with_capacity(64), device.report.limits);
        Ok(Self {
            background: Vec::new(),
            recorder,
            up: None,
            down: None,
            batch,
            wanted: None,
            gathers: false,
            gathered: 0,
            limits,
            in_place: true,
            device,
            shared,
        })
    }

    /// Makes the error of a device that cannot run something.
    pub(crate) fn unsuitable(&self, reason: String) -> EngineError {
        EngineError::Unsuitable { device: self.device.report.name.clone(), reason }
    }

    /// Returns the most bytes that a dispatch moves, so that none takes long. Software has no limit, because nothing
    /// resets it.
    pub(crate) fn dispatch_bytes(&self) -> u64 {
        if self.device.planned_as == DeviceKind::Cpu { u64::MAX } else { DISPATCH_BYTES }
    }

    /// Allocates a block in the device's own memory, without content.
    pub(crate) fn block(&self, size: u64, what: &str) -> Result<Block, EngineError> {
        Block::new(&self.device, size, MemoryLocation::GpuOnly, what)
    }

    /// Allocates a block in the device's own memory with `data` in it.
    pub(crate) fn filled(&mut self, data: &[u8], what: &str) -> Result<Block, EngineError> {
        let block = self.block(data.len() as u64, what)?;
        self.upload(&block, data, [(0, 0, data.len() as u64)])?;
        Ok(block)
    }

    /// Returns the pipeline of a module.
    pub(crate) fn pipeline(
        &mut self,
        module: &'static Module,
        bindings: u32,
        constants: &[u32],
    ) -> Result<Pipeline, EngineError> {
        if let Some(wanted) = &mut self.wanted {
            return Ok(self.device.pipelines().known(module, constants).unwrap_or_else(|| {
                wanted.push(Wanted { module, bindings, constants: constants.to_vec() });
                Pipeline { bindings, ..Pipeline::default() }
            }));
        }
        self.device.pipeline(module, bindings, constants)
    }

    /// Starts to collect pipelines that do not exist yet. Recordings leave out their dispatches.
    pub(crate) fn want(&mut self) {
        self.wanted = Some(Vec::new());
    }

    /// Makes all pipelines that were [collected](Self::want), on all cores.
    pub(crate) fn compile(&mut self) -> Result<(), EngineError> {
        self.device.compile(self.wanted.take().unwrap_or_default())
    }

    /// Makes all pipelines that were [collected](Self::want) in the background, or at once if nothing runs.
    pub(crate) fn compile_later(&mut self) -> Result<(), EngineError> {
        let missing = self.device.pipelines().missing(self.wanted.take().unwrap_or_default())?;
        if self.device.record_only {
            return missing.into_iter().try_for_each(|(wanted, pipeline)| make(&self.device, wanted, pipeline));
        }
        self.background.retain(|background| !background.is_over());
        self.background.push(Background::start(&self.device, missing));
        Ok(())
    }

    /// Starts to gather uploads, until [`send_uploads`](Self::send_uploads). Nothing else is recorded meanwhile.
    pub(crate) fn gather_uploads(&mut self) {
        self.gathers = true;
    }

    /// Submits the gathered uploads, if there are any, and waits.
    pub(crate) fn send_uploads(&mut self) -> Result<(), EngineError> {
        self.gathers = false;
        if std::mem::take(&mut self.gathered) > 0 { self.recorder.submit("an upload") } else { Ok(()) }
    }

    /// Copies pieces of `data`, multiples of 4 bytes, into a block. If the host shares the memory, the host copies on
    /// all cores.
    pub(crate) fn put(
        &mut self,
        to: &mut Block,
        data: &[u8],
        pieces: impl IntoIterator<Item = Piece>,
    ) -> Result<(), EngineError> {
        if !(self.in_place && to.is_the_hosts_too()) {
            return self.upload(to, data, pieces);
        }
        let bytes = to.bytes_mut();
        for (from, to, size) in pieces {
            self.device.count(|counts| counts.uploaded += size);
            copy(&mut bytes[to as usize..][..size as usize], &data[from as usize..][..size as usize]);
        }
        Ok(())
    }

    /// Copies pieces of a block, multiples of 4 bytes, into `data`, like [`put`](Self::put).
    pub(crate) fn fetch(
        &mut self,
        from: &Block,
        data: &mut [u8],
        pieces: impl IntoIterator<Item = Piece>,
    ) -> Result<(), EngineError> {
        if !(self.in_place && from.is_the_hosts_too()) {
            return self.download(from, data, pieces);
        }
        let bytes = from.bytes();
        for (from, to, size) in pieces {
            self.device.count(|counts| counts.read_back += size);
            copy(&mut data[to as usize..][..size as usize], &bytes[from as usize..][..size as usize]);
        }
        Ok(())
    }

    /// Copies pieces of `data`, multiples of 4 bytes, into a block, and waits.
    pub(crate) fn upload(
        &mut self,
        to: &Block,
        data: &[u8],
        pieces: impl IntoIterator<Item = Piece>,
    ) -> Result<(), EngineError> {
        let mut stage = match self.up.take() {
            Some(stage) => stage,
            None => Block::new(&self.device, STAGE, MemoryLocation::CpuToGpu, "staging")?,
        };
        let result = batches(pieces, &mut self.batch, |batch| {
            let size: u64 = batch.iter().map(|piece| piece.2).sum();
            let mut begin = 0;
            if self.gathers {
                if self.gathered + size > STAGE {
                    self.gathered = 0;
                    self.recorder.submit("an upload")?;
                }
                if self.gathered == 0 {
                    self.recorder.begin(0)?;
                }
                begin = self.gathered;
                self.gathered += size;
            }
            for ((from, _, size), at) in staged(batch) {
                self.device.count(|counts| counts.uploaded += size);
                stage.bytes_mut()[(begin + at) as usize..][..size as usize]
                    .copy_from_slice(&data[from as usize..][..size as usize]);
            }
            let pieces = staged(batch).map(|((_, to, size), at)| (begin + at, to, size));
            if self.gathers {
                self.recorder.copy(&stage, to, pieces);
                return Ok(());
            }
            self.recorder.begin(0)?;
            self.recorder.copy(&stage, to, pieces);
            self.recorder.submit("an upload")
        });
        self.up = Some(stage);
        result
    }

    /// Copies pieces of a block, multiples of 4 bytes, into `data`.
    pub(crate) fn download(
        &mut self,
        from: &Block,
        data: &mut [u8],
        pieces: impl IntoIterator<Item = Piece>,
    ) -> Result<(), EngineError> {
        let stage = match self.down.take() {
            Some(stage) => stage,
            None => Block::new(&self.device, STAGE, MemoryLocation::GpuToCpu, "staging")?,
        };
        let result = batches(pieces, &mut self.batch, |batch| {
            self.recorder.begin(0)?;
            self.recorder.copy(from, &stage, staged(batch).map(|((from, _, size), at)| (from, at, size)));
            self.recorder.submit("a download")?;
            for ((_, to, size), at) in staged(batch) {
                self.device.count(|counts| counts.read_back += size);
                data[to as usize..][..size as usize].copy_from_slice(&stage.bytes()[at as usize..][..size as usize]);
            }
            Ok(())
        });
        self.down = Some(stage);
        result
    }
}

/// Bytes that a thread copies at once.
const PART: usize = 256 << 10;

/// Copies on all cores.
fn copy(to: &mut [u8], from: &[u8]) {
    to.par_chunks_mut(PART).zip(from.par_chunks(PART)).for_each(|(to, from)| to.copy_from_slice(from));
}

/// Returns the pieces of a batch, each with its place on the stage, one after the other.
fn staged(batch: &[Piece]) -> impl Iterator<Item = (Piece, u64)> {
    batch.iter().scan(0, |end, piece| {
        let at = *end;
        *end += piece.2;
        Some((*piece, at))
    })
}

/// Splits the pieces so that each batch fits the stage. `batch` is scratch for one batch.
fn batches(
    pieces: impl IntoIterator<Item = Piece>,
    batch: &mut Vec<Piece>,
    mut run: impl FnMut(&[Piece]) -> Result<(), EngineError>,
) -> Result<(), EngineError> {
    batch.clear();
    let mut held = 0;
    for (mut from, mut to, mut size) in pieces {
        while size > 0 {
            let part = size.min(STAGE - held);
            batch.push((from, to, part));
            (from, to, size, held) = (from + part, to + part, size - part, held + part);
            if held == STAGE {
                run(batch)?;
                batch.clear();
                held = 0;
            }
        }
    }
    if batch.is_empty() { Ok(()) } else { run(batch) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn batches_hold_everything_once_and_fit_the_stage() {
        let pieces = [(0, 7, 5), (5, 100, 2 * STAGE + 3), (3 * STAGE, 0, 0), (4 * STAGE, 9 * STAGE, STAGE)];
        let mut seen = Vec::new();
        batches(pieces, &mut Vec::new(), |batch| {
            assert!(batch.iter().map(|p| p.2).sum::<u64>() <= STAGE);
            seen.extend_from_slice(batch);
            Ok(())
        })
        .unwrap();
        // Joined again, the pieces equal the input.
        let mut joined: Vec<(u64, u64, u64)> = Vec::new();
        for p in seen {
            match joined.last_mut() {
                Some(l) if l.0 + l.2 == p.0 && l.1 + l.2 == p.1 => l.2 += p.2,
                _ => joined.push(p),
            }
        }
        assert_eq!(joined, pieces.into_iter().filter(|p| p.2 > 0).collect::<Vec<_>>());
    }
}
