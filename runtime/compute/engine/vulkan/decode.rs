//! Views that an application gives, from samples as it stores them to the pyramids that photographs are computed from, on the
//! device: by the kernels `decode_views` and `halve_views`, beside the lists of kernels.
//!
//! The host sees sums of the light alone, and a small copy of the middle view, by which it is told how content moves.

use super::super::EngineError;
use super::views::{DeviceViews, Level, Views};
#[cfg(target_os = "linux")]
use crate::gpu::SharedMemory;
use crate::gpu::{Block, Commands, Gpu};
use crate::scene::Pyramid;
use eyebox_kernels::decode_views::{self, ALL_LIGHT, SUMS};
use eyebox_kernels::{WIDTH, decode_views::CURVE};
use eyebox_kernels::{half, halve_views};
use eyebox_spirv as spirv;
use std::ops::Range;
use std::sync::Arc;

/// Most workgroups of a view, and words that one of their invocations takes before there are more of them.
const PARTS: u32 = 64;
const WORDS: u32 = 32;

/// Views as an application stores them: (view, row, column, colour), without gaps.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct StoredViews {
    /// Rows and columns of views.
    pub grid: [usize; 2],
    /// [`decode_views::U8`] to [`decode_views::F32`].
    pub sample: u32,
    /// Whether whole numbers are coded in sRGB; else they are linear.
    pub coded: bool,
}

impl StoredViews {
    fn count(&self) -> usize {
        self.grid[0] * self.grid[1]
    }

    fn sample_bytes(&self) -> u64 {
        match self.sample {
            decode_views::U8 => 1,
            decode_views::F32 => 4,
            _ => 2,
        }
    }
}

/// Light of the views of one colour.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ViewsLight {
    /// The brightest.
    pub brightest: f32,
    /// Mean over all views.
    pub mean: f64,
    /// Means of the light, its square and its cube over the view in the middle of all.
    pub middle: [f64; 3],
}

/// A sample that is no light: not finite, below 0 or above 65504.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NoLight {
    /// Which colour of those that are stored.
    pub channel: usize,
    /// Which of its samples: (view, row, column).
    pub index: usize,
    /// What it is.
    pub found: f32,
}

/// Makes pyramids of views on a Vulkan device.
pub struct ViewDecoder {
    // Dropped in this order: the device last.
    /// What was made so far: used again when nobody looks at it any more.
    made: Vec<Arc<Views>>,
    samples: Block,
    curve: Block,
    tables: Block,
    sums: Option<Block>,
    /// Each level but the first, from the one before.
    halvings: Vec<halve_views::Args>,
    sizes: Vec<(usize, usize)>,
    /// Colours of a sample, and those that are looked at.
    stored: usize,
    channels: Vec<usize>,
    gpu: Commands,
}

impl ViewDecoder {
    /// For views of `size` rows and columns with so many colours `stored`, of which `channels` are wanted; all views of a frame
    /// take `bytes` at most.
    ///
    /// # Errors
    /// [`EngineError::Unsuitable`] for views that a kernel of this device cannot see at once; out of memory.
    pub fn new(
        gpu: &Gpu,
        size: [usize; 2],
        stored: usize,
        channels: &[usize],
        bytes: u64,
    ) -> Result<Self, EngineError> {
        let mut gpu = Commands::new(gpu)?;
        let limit = gpu.limits.storage_range.min(gpu.limits.allocation);
        // Samples are counted by 32 bits.
        if bytes > limit || bytes > u64::from(u32::MAX) {
            return Err(gpu.unsuitable(format!("all views of a frame take {bytes} bytes, a kernel may see {limit}")));
        }
        let sizes = Pyramid::sizes(size[0], size[1]);
        let (mut halvings, mut words) = (Vec::new(), Vec::new());
        for pair in sizes.windows(2) {
            let (args, [rows, columns]) = halve_views::Args::between(pair[0], pair[1], words.len() as u32);
            halvings.push(args);
            words.extend(halve_views::packed(&rows, &columns));
        }
        let curve = gpu.filled(bytemuck::cast_slice(&decode_views::curve()), "the sRGB curve")?;
        debug_assert_eq!(curve.size, 4 * CURVE as u64);
        Ok(Self {
            made: Vec::new(),
            samples: gpu.block(bytes.next_multiple_of(4), "views as they are given")?,
            curve,
            tables: gpu.filled(bytemuck::cast_slice(&words), "weights of levels")?,
            sums: None,
            halvings,
            sizes,
            stored,
            channels: channels.to_vec(),
            gpu,
        })
    }

    /// The device.
    pub fn gpu(&self) -> &Gpu {
        &self.gpu.shared
    }

    /// Uploads samples, filled to whole words of 4 bytes.
    ///
    /// # Errors
    /// More than it was made for; a lost device.
    pub fn upload(&mut self, samples: &[u8]) -> Result<(), EngineError> {
        let bytes = samples.len() as u64;
        if bytes > self.samples.size || !bytes.is_multiple_of(4) {
            return Err(EngineError::mismatch(format!(
                "{bytes} bytes of views, where {} in words of 4 fit",
                self.samples.size
            )));
        }
        self.gpu.put(&mut self.samples, samples, [(0, 0, bytes)])
    }

    /// Takes so many bytes of samples that another process left in memory of this device, from `at` on: both multiples of 4.
    ///
    /// # Errors
    /// More than there are, or than it was made for; a lost device.
    #[cfg(target_os = "linux")]
    pub fn copy(&mut self, from: &SharedMemory, at: u64, bytes: u64) -> Result<(), EngineError> {
        let ends = at.checked_add(bytes).is_some_and(|end| end <= from.block.size);
        if !ends || bytes > self.samples.size || !(at | bytes).is_multiple_of(4) || !from.block.is_on(&self.gpu.device)
        {
            return Err(EngineError::mismatch(format!(
                "{bytes} bytes of views at {at}, where {} are shared",
                from.block.size
            )));
        }
        self.gpu.recorder.begin(0)?;
        self.gpu.recorder.take_over(&from.block);
        self.gpu.recorder.copy(&from.block, &self.samples, [(at, 0, bytes)]);
        self.gpu.recorder.hand_back(&from.block);
        self.gpu.recorder.submit("views of an application")
    }

    fn pixels(&self) -> usize {
        self.sizes.first().map_or(0, |(height, width)| height * width)
    }

    fn parts(&self) -> u32 {
        (self.pixels() as u32).div_ceil(2 * WIDTH * WORDS).clamp(1, PARTS)
    }

    fn args(&self, views: &StoredViews, channel: usize) -> decode_views::Args {
        decode_views::Args {
            pixels: self.pixels() as u32,
            channels: self.stored as u32,
            channel: channel as u32,
            sample: views.sample,
            coded: u32::from(views.coded),
            first: 0,
            stride: 0,
            scale: 0.0,
        }
    }

    /// What light there is in the views whose samples are on the device, colour by colour; or what is none.
    ///
    /// # Errors
    /// More views than it was made for; a lost device.
    pub fn measure(&mut self, views: &StoredViews) -> Result<Result<Vec<ViewsLight>, NoLight>, EngineError> {
        let (count, pixels, parts) = (views.count(), self.pixels(), self.parts());
        let bytes = views.sample_bytes() * (count * pixels * self.stored) as u64;
        if count == 0 || bytes > self.samples.size {
            return Err(EngineError::mismatch(format!(
                "{count} views take {bytes} bytes, where {} fit",
                self.samples.size
            )));
        }
        let step = (4 * SUMS as u64 * u64::from(parts) * count as u64).next_multiple_of(256);
        let size = step * self.channels.len() as u64;
        if self.sums.as_ref().is_none_or(|sums| sums.size < size) {
            self.sums = Some(self.gpu.block(size, "sums of light")?);
        }
        let pipeline = self.gpu.pipeline(&spirv::DECODE_VIEWS, 4, &[])?;
        let Some(sums) = &self.sums else { return Ok(Ok(Vec::new())) };
        self.gpu.recorder.begin(0)?;
        self.gpu.recorder.barrier();
        for (i, channel) in self.channels.iter().enumerate() {
            let to = sums.range(i as u64 * step, step);
            // Nothing is stored: what would be is bound to anything.
            let buffers = [self.samples.all(), self.curve.all(), to, to];
            let args = self.args(views, *channel);
            self.gpu.recorder.dispatch(pipeline, &buffers, bytemuck::bytes_of(&args), [parts, count as u32, 1])?;
        }
        self.gpu.recorder.submit("decode_views")?;
        let mut words = vec![0u32; size as usize / 4];
        self.gpu.fetch(sums, bytemuck::cast_slice_mut(&mut words), [(0, 0, size)])?;
        let mut lights = Vec::with_capacity(self.channels.len());
        for (channel, words) in self.channels.clone().iter().zip(words.chunks_exact(step as usize / 4)) {
            let parts = words.chunks_exact(SUMS).take(parts as usize * count).collect::<Vec<_>>();
            if let Some((at, bad)) = parts.iter().enumerate().find(|(_, part)| part[SUMS - 1] != ALL_LIGHT) {
                let view = at / (parts.len() / count);
                return self.no_light(views, *channel, view, bad[SUMS - 1] as usize).map(Err);
            }
            lights.push(light_of(&parts, count, pixels));
        }
        Ok(Ok(lights))
    }

    /// Reads what is no light.
    fn no_light(
        &mut self,
        views: &StoredViews,
        channel: usize,
        view: usize,
        pixel: usize,
    ) -> Result<NoLight, EngineError> {
        let index = view * self.pixels() + pixel;
        let at = views.sample_bytes() * (index * self.stored + channel) as u64;
        let mut word = [0; 4];
        self.gpu.fetch(&self.samples, &mut word, [(at / 4 * 4, 0, 4)])?;
        let half = [word[at as usize % 4], word[(at as usize + 1) % 4]];
        let found = match views.sample {
            decode_views::F32 => f32::from_le_bytes(word),
            _ => half::value(u16::from_le_bytes(half)),
        };
        Ok(NoLight { channel, index, found })
    }

    /// The pyramids of the views that were [measured](Self::measure) last, colour by colour. Their light stays on the device, but
    /// for the middle view of the first colour at the [level that is compared](Pyramid::compared).
    ///
    /// # Errors
    /// Out of memory; a lost device.
    pub fn decode(&mut self, views: &StoredViews, lights: &[ViewsLight]) -> Result<Vec<Arc<Pyramid>>, EngineError> {
        let count = views.count();
        self.made.retain(|made| made.count == count);
        let mut rooms = Vec::with_capacity(lights.len());
        for _ in lights {
            let free = self.made.iter().position(|made| Arc::strong_count(made) == 1);
            let room = match free {
                Some(at) => self.made.swap_remove(at),
                None => Arc::new(Views::laid_out(&self.gpu, count, &self.sizes)?),
            };
            rooms.push(room);
        }
        // Kept whatever comes of this.
        self.made.extend(rooms.iter().cloned());
        let scales: Vec<f32> = lights.iter().map(|l| if l.brightest > 0.0 { l.brightest } else { 1.0 }).collect();
        self.gpu.recorder.begin(0)?;
        self.gpu.recorder.barrier();
        for ((room, channel), scale) in rooms.iter().zip(&self.channels.clone()).zip(&scales) {
            self.record_decoding(views, room, *channel, *scale)?;
        }
        for at in 0..self.halvings.len() {
            self.gpu.recorder.barrier();
            for room in &rooms {
                self.record_halving(room, at)?;
            }
        }
        self.gpu.recorder.submit("halve_views")?;
        let mut pyramids = Vec::with_capacity(rooms.len());
        for (i, (room, scale)) in rooms.into_iter().zip(scales).enumerate() {
            let (height, width) = self.sizes.first().copied().unwrap_or_default();
            let mut pyramid = Pyramid::outline(count, height, width);
            if let Some(at) = pyramid.compared().filter(|_| i == 0) {
                pyramid.levels[at].views = self.middle_of(&room, at, views.grid)?;
            }
            let views = DeviceViews { views: room, gpu: self.gpu.shared.clone() };
            pyramids.push(Arc::new(pyramid.with_light(scale, Arc::new(views))));
        }
        Ok(pyramids)
    }

    fn record_decoding(
        &mut self,
        views: &StoredViews,
        room: &Views,
        channel: usize,
        scale: f32,
    ) -> Result<(), EngineError> {
        let (Some(level), Some(sums)) = (room.levels.first(), &self.sums) else { return Ok(()) };
        let pipeline = self.gpu.pipeline(&spirv::DECODE_VIEWS, 4, &[])?;
        for piece in &level.pieces {
            let (first, stride) = (piece.views.start as u32, level.stride as u32);
            let args = decode_views::Args { first, stride, scale, ..self.args(views, channel) };
            // Sums that nobody looks at any more.
            let to = level.range(&room.blocks, piece, &piece.views);
            let buffers = [self.samples.all(), self.curve.all(), to, sums.all()];
            let groups = [self.parts(), piece.views.len() as u32, 1];
            self.gpu.recorder.dispatch(pipeline, &buffers, bytemuck::bytes_of(&args), groups)?;
        }
        Ok(())
    }

    fn record_halving(&mut self, room: &Views, at: usize) -> Result<(), EngineError> {
        let [finer, level] = [&room.levels[at], &room.levels[at + 1]];
        let (in_stride, stride) = (finer.stride as u32, level.stride as u32);
        let args = halve_views::Args { in_stride, stride, ..self.halvings[at] };
        let pipeline = self.gpu.pipeline(&spirv::HALVE_VIEWS, 3, &[])?;
        for (from, to) in finer.pieces.iter().flat_map(|from| level.pieces.iter().map(move |to| (from, to))) {
            let both: Range<usize> = from.views.start.max(to.views.start)..from.views.end.min(to.views.end);
            if both.is_empty() {
                continue;
            }
            let range = |level: &Level, piece| level.range(&room.blocks, piece, &both);
            let buffers = [range(finer, from), self.tables.all(), range(level, to)];
            let groups = [(args.sizes.height * args.sizes.width).div_ceil(2 * WIDTH).min(65_535), both.len() as u32, 1];
            self.gpu.recorder.dispatch(pipeline, &buffers, bytemuck::bytes_of(&args), groups)?;
        }
        Ok(())
    }

    /// A level whose middle view was read, and whose others are zero.
    fn middle_of(&mut self, room: &Views, at: usize, grid: [usize; 2]) -> Result<Vec<u16>, EngineError> {
        let (level, middle) = (&room.levels[at], grid[0] / 2 * grid[1] + grid[1] / 2);
        let values = level.height * level.width;
        let mut views = vec![0; room.count * values];
        let Some(piece) = level.pieces.iter().find(|piece| piece.views.contains(&middle)) else { return Ok(views) };
        let from = piece.offset + (middle - piece.views.start) * level.stride;
        let mut view = vec![0u16; values.next_multiple_of(2)];
        let bytes = 2 * view.len() as u64;
        let block = &room.blocks[piece.block];
        self.gpu.fetch(block, bytemuck::cast_slice_mut(&mut view), [(2 * from as u64, 0, bytes)])?;
        views[middle * values..][..values].copy_from_slice(&view[..values]);
        Ok(views)
    }
}

/// All light of `count` views by the sums of their parts, in order.
fn light_of(parts: &[&[u32]], count: usize, pixels: usize) -> ViewsLight {
    let each = parts.len() / count;
    let sums_of = |parts: &[&[u32]]| {
        let sum = |i: usize| parts.iter().map(|part| f64::from(f32::from_bits(part[i]))).sum::<f64>();
        [0, 1, 2].map(sum)
    };
    let middle = sums_of(&parts[count / 2 * each..][..each]).map(|sum| sum / pixels as f64);
    let mean = sums_of(parts)[0] / (count * pixels) as f64;
    let brightest = parts.iter().map(|part| f32::from_bits(part[3])).fold(0.0, f32::max);
    ViewsLight { brightest, mean, middle }
}
