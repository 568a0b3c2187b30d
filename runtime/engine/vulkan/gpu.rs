//! An open device and the few things that are done with it: make a block, fill it, run recorded kernels, read it.

use super::super::EngineError;
use super::device::{Block, Device};
use super::devices::{DeviceReport, Limits};
use super::engine::Options;
use super::instance::Messages;
use super::pipelines::{Pipeline, Pipelines};
use super::recorder::Recorder;
use eyebox_spirv::Module;
use gpu_allocator::MemoryLocation;
use std::sync::Arc;

/// Bytes that pass between host and device at once.
const STAGE: u64 = 32 << 20;

/// An open device.
pub(super) struct Gpu {
    // In the order in which they are dropped: what is recorded before what it uses, the device last.
    pub(super) recorder: Recorder,
    pipelines: Pipelines,
    up: Option<Block>,
    down: Option<Block>,
    /// The device's limits; a test may make them smaller.
    pub(super) limits: Limits,
    pub(super) device: Arc<Device>,
}

impl Gpu {
    /// Opens the device that the options name, or the best one.
    pub(super) fn open(options: &Options) -> Result<Self, EngineError> {
        let device = Device::open(options.device.as_deref(), options.allow_cpu, options.validation)?;
        let recorder = Recorder::new(&device)?;
        let pipelines = Pipelines::new(&device, options.cache.as_deref())?;
        let limits = device.report.limits;
        Ok(Self { recorder, pipelines, up: None, down: None, limits, device })
    }

    pub(super) fn limits(&self) -> &Limits {
        &self.limits
    }

    pub(super) fn report(&self) -> &DeviceReport {
        &self.device.report
    }

    /// What the validation layer said, if it was asked for. Keep this to hear what it says when the device is closed.
    pub(super) fn messages(&self) -> Messages {
        self.device.messages()
    }

    /// A block in the device's own memory, not yet filled.
    pub(super) fn block(&self, size: u64, what: &str) -> Result<Block, EngineError> {
        Block::new(&self.device, size, MemoryLocation::GpuOnly, what)
    }

    /// A block in the device's own memory that holds `data`.
    pub(super) fn filled(&mut self, data: &[u8], what: &str) -> Result<Block, EngineError> {
        let block = self.block(data.len() as u64, what)?;
        self.upload(&block, data, &[(0, 0, data.len() as u64)])?;
        Ok(block)
    }

    /// The pipeline of a module: see [`Pipelines::get`].
    pub(super) fn pipeline(
        &mut self,
        module: &'static Module,
        bindings: u32,
        constants: &[u32],
    ) -> Result<Pipeline, EngineError> {
        self.pipelines.get(module, bindings, constants)
    }

    /// Copies pieces of `data`, given as (from, to, bytes), multiples of 4, into a block, and waits.
    pub(super) fn upload(&mut self, to: &Block, data: &[u8], pieces: &[(u64, u64, u64)]) -> Result<(), EngineError> {
        let mut stage = match self.up.take() {
            Some(stage) => stage,
            None => Block::new(&self.device, STAGE, MemoryLocation::CpuToGpu, "staging")?,
        };
        let result = batches(pieces, |batch| {
            let mut copies = Vec::with_capacity(batch.len());
            let mut at = 0;
            for &(from, to, size) in batch {
                stage.bytes_mut()[at as usize..][..size as usize]
                    .copy_from_slice(&data[from as usize..][..size as usize]);
                copies.push((at, to, size));
                at += size;
            }
            self.recorder.begin(0)?;
            self.recorder.copy(&stage, to, &copies);
            self.recorder.submit("an upload").map(drop)
        });
        self.up = Some(stage);
        result
    }

    /// Copies pieces of a block, given as (from, to, bytes), multiples of 4, into `data`.
    pub(super) fn download(
        &mut self,
        from: &Block,
        data: &mut [u8],
        pieces: &[(u64, u64, u64)],
    ) -> Result<(), EngineError> {
        let stage = match self.down.take() {
            Some(stage) => stage,
            None => Block::new(&self.device, STAGE, MemoryLocation::GpuToCpu, "staging")?,
        };
        let result = batches(pieces, |batch| {
            let mut copies = Vec::with_capacity(batch.len());
            let mut at = 0;
            for &(from, _, size) in batch {
                copies.push((from, at, size));
                at += size;
            }
            self.recorder.begin(0)?;
            self.recorder.copy(from, &stage, &copies);
            self.recorder.submit("a download")?;
            for (&(_, to, size), &(_, at, _)) in batch.iter().zip(&copies) {
                data[to as usize..][..size as usize].copy_from_slice(&stage.bytes()[at as usize..][..size as usize]);
            }
            Ok(())
        });
        self.down = Some(stage);
        result
    }
}

/// Cuts the pieces so that each batch fits the stage.
fn batches(
    pieces: &[(u64, u64, u64)],
    mut run: impl FnMut(&[(u64, u64, u64)]) -> Result<(), EngineError>,
) -> Result<(), EngineError> {
    let (mut batch, mut held) = (Vec::new(), 0);
    for &(mut from, mut to, mut size) in pieces {
        while size > 0 {
            let part = size.min(STAGE - held);
            batch.push((from, to, part));
            (from, to, size, held) = (from + part, to + part, size - part, held + part);
            if held == STAGE {
                run(&batch)?;
                batch.clear();
                held = 0;
            }
        }
    }
    if batch.is_empty() { Ok(()) } else { run(&batch) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn batches_hold_everything_once_and_fit_the_stage() {
        let pieces = [(0, 7, 5), (5, 100, 2 * STAGE + 3), (3 * STAGE, 0, 0), (4 * STAGE, 9 * STAGE, STAGE)];
        let mut seen = Vec::new();
        batches(&pieces, |batch| {
            assert!(batch.iter().map(|p| p.2).sum::<u64>() <= STAGE);
            seen.extend_from_slice(batch);
            Ok(())
        })
        .unwrap();
        // Joined again, they are what was given.
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
