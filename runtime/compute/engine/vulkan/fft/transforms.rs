//! Runs single transforms of the host's frames, for comparison with float64 and for measurement.

use super::state::{Along, Fft, Frames};
use crate::engine::{EngineError, Storage};
use crate::gpu::{Block, Commands, Gpu};
use eyebox_kernels::fft::{Columns, Direction};
use eyebox_kernels::{Complex32, half};
use std::time::Instant;

/// Transforms frames on a device.
pub struct Transforms {
    // Fields are dropped before the device.
    block: Option<Block>,
    fft: Fft,
    storage: Storage,
    gpu: Commands,
}

/// Duration of a transform in seconds, without upload and download.
#[derive(Debug, Clone, PartialEq)]
pub struct Timed {
    /// Time from submission until completion.
    pub whole: f64,
    /// Each pass by name with its time by the device's clock. The list is empty if passes were not timed.
    pub passes: Vec<(String, f64)>,
}

impl Transforms {
    /// Makes transforms on a device.
    ///
    /// # Errors
    /// The errors of the device.
    pub fn new(gpu: &Gpu) -> Result<Self, EngineError> {
        Ok(Self { block: None, fft: Fft::default(), storage: Storage::F32, gpu: Commands::new(gpu)? })
    }

    /// Sets the storage of frames on the device.
    pub fn store(&mut self, storage: Storage) {
        self.storage = storage;
    }

    /// Returns the device of the transforms.
    pub fn gpu(&self) -> &Gpu {
        &self.gpu.shared
    }

    /// Returns the plans of rows and columns as text.
    ///
    /// # Errors
    /// The errors of the device.
    pub fn plans(&mut self, height: usize, width: usize) -> Result<[String; 2], EngineError> {
        self.fft.prepare(&mut self.gpu, [height, width], self.storage)?;
        Ok(self.fft.plans(&self.gpu, height, width))
    }

    /// Returns the seconds of each pass of forward transforms of `count` frames of zeros, by the device's clock. All
    /// `times` repetitions are in one submission, because a device that sleeps between transforms wakes slowly.
    ///
    /// # Errors
    /// The errors of the device.
    pub fn in_a_row(
        &mut self,
        (height, width, count): (usize, usize, usize),
        times: usize,
    ) -> Result<Vec<(String, Vec<f64>)>, EngineError> {
        let mut zeros = vec![Complex32::default(); height * width * count];
        self.run(&mut zeros, (height, width), Direction::Forward, Columns::all(width), 0)?;
        let Some(block) = self.block.take() else { return Ok(Vec::new()) };
        let stride = self.stride(height * width) as usize;
        self.gpu.recorder.begin(64 * count * times)?;
        self.fft.marks = Some(Vec::new());
        for _ in 0..times {
            let work = Frames { block: &block, offset: 0, count, height, width, stride, storage: self.storage };
            self.fft.record(&mut self.gpu, work, Direction::Forward, Columns::all(width), Along::Both)?;
            self.gpu.recorder.barrier();
        }
        let mut names = self.fft.marks.take().unwrap_or_default();
        self.gpu.recorder.submit("transforms")?;
        self.block = Some(block);
        names.truncate(names.len() / times.max(1));
        let mut passes: Vec<(String, Vec<f64>)> = names.into_iter().map(|name| (name, Vec::new())).collect();
        let count = passes.len();
        self.gpu.recorder.times.drain(..).for_each(|t| passes[t.label % count].1.push(t.seconds));
        Ok(passes)
    }

    /// Returns the values from one frame to the next, an even number because of pairs.
    fn stride(&self, one: usize) -> u64 {
        let value = self.storage.bytes() as u64;
        (value * one as u64).next_multiple_of(self.gpu.limits.offset_alignment.max(2 * value)) / value
    }

    /// Transforms frames (count, height, width) like [`kernels::fft`](eyebox_kernels::fft), one after the other at
    /// the device's alignment. They start `before` bytes into a buffer, rounded up to that alignment.
    ///
    /// # Errors
    /// The errors of the device.
    pub fn run(
        &mut self,
        frames: &mut [Complex32],
        (height, width): (usize, usize),
        direction: Direction,
        columns: Columns,
        before: u64,
    ) -> Result<Timed, EngineError> {
        let one = height * width;
        let count = frames.len() / one.max(1);
        if count == 0 {
            return Ok(Timed { whole: 0.0, passes: Vec::new() });
        }
        let alignment = self.gpu.limits.offset_alignment;
        let offset = before.next_multiple_of(alignment);
        let value = self.storage.bytes() as u64;
        let stride = self.stride(one);
        let size = offset + value * stride * count as u64;
        let bytes = value * one as u64;
        let pieces = move || (0..count as u64).map(move |i| (bytes * i, offset + value * stride * i, bytes));
        let block = match self.block.take() {
            Some(block) if block.size >= size => block,
            _ => self.gpu.block(size, "frames to be transformed")?,
        };
        let numbers: &mut [f32] = bytemuck::cast_slice_mut(frames);
        match self.storage {
            Storage::F32 => self.gpu.upload(&block, bytemuck::cast_slice(numbers), pieces())?,
            Storage::F16 => self.gpu.upload(&block, bytemuck::cast_slice(&half::pack(numbers)), pieces())?,
        }
        self.fft.prepare(&mut self.gpu, [height, width], self.storage)?;
        self.gpu.recorder.begin(64 * count)?;
        let work =
            Frames { block: &block, offset, count, height, width, stride: stride as usize, storage: self.storage };
        self.fft.marks = Some(Vec::new());
        self.fft.record(&mut self.gpu, work, direction, columns, Along::Both)?;
        let names = self.fft.marks.take().unwrap_or_default();
        let start = Instant::now();
        self.gpu.recorder.submit("transforms")?;
        let whole = start.elapsed().as_secs_f64();
        let times: Vec<_> = self.gpu.recorder.times.drain(..).collect();
        let back = pieces().map(|(host, device, bytes)| (device, host, bytes));
        match self.storage {
            Storage::F32 => self.gpu.download(&block, bytemuck::cast_slice_mut(numbers), back)?,
            Storage::F16 => {
                let mut bits = vec![0u16; numbers.len()];
                self.gpu.download(&block, bytemuck::cast_slice_mut(&mut bits), back)?;
                numbers.copy_from_slice(&half::unpack(&bits));
            }
        }
        self.block = Some(block);
        let passes = times.into_iter().map(|t| (names[t.label].clone(), t.seconds)).collect();
        Ok(Timed { whole, passes })
    }
}
