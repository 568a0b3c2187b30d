//! Decodes an application's views to pyramids on the device, from its stored samples.
//!
//! The kernels are `decode_views` and `halve_views`, which are not part of lists. Target images are computed from the
//! pyramids. The host reads only sums of the light, and a small copy of the middle view, from which it determines how
//! content moves.

use super::super::EngineError;
use super::splats::{DeviceSplats, Pictures};
use super::views::{DeviceViews, Level, Views};
#[cfg(target_os = "linux")]
use crate::gpu::SharedMemory;
use crate::gpu::{Block, Commands, Gpu};
use crate::scene::{Pyramid, StoredSplats};
use eyebox_kernels::decode_views::{self, ALL_LIGHT, SUMS};
use eyebox_kernels::project_splats::Args as Camera;
use eyebox_kernels::{WIDTH, decode_views::CURVE};
use eyebox_kernels::{half, halve_views};
use eyebox_spirv as spirv;
use std::ops::Range;
use std::sync::Arc;

/// Most workgroups of a view, and words per invocation before another workgroup is added.
const PARTS: u32 = 64;
const WORDS: u32 = 32;

/// Views in an application's format, (view, row, column, color), without gaps.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct StoredViews {
    /// Rows and columns of views.
    pub grid: [usize; 2],
    /// Type of the samples, [`decode_views::U8`] to [`decode_views::F32`].
    pub sample: u32,
    /// True if integers are coded in sRGB, false if they are linear.
    pub coded: bool,
    /// True if the samples are in the order (color, view, row, column) instead.
    pub planar: bool,
}

impl StoredViews {
    fn count(&self) -> usize {
        self.grid[0] * self.grid[1]
    }

    fn sample_bytes(&self) -> u64 {
        sample_bytes(self.sample)
    }
}

/// Light of the views of one color.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ViewsLight {
    /// Largest light of a pixel.
    pub brightest: f32,
    /// Mean over all views.
    pub mean: f64,
    /// Means of the light, its square and its cube, over the middle view.
    pub middle: [f64; 3],
}

/// A sample that is not valid light, because it is not finite, below 0 or above 65504.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NoLight {
    /// Index of its color among the stored colors.
    pub channel: usize,
    /// Index of its sample in (view, row, column).
    pub index: usize,
    /// Value of the sample.
    pub found: f32,
}

/// Makes pyramids of views on a Vulkan device.
pub struct ViewDecoder {
    // Fields are dropped in this order, the device last.
    /// Memory of earlier views, which is reused when nobody uses it any more.
    made: Vec<Arc<Views>>,
    pub(super) samples: Block,
    pub(super) curve: Block,
    tables: Block,
    sums: Option<Block>,
    /// Arguments of each level but the first, from the level before.
    halvings: Vec<halve_views::Args>,
    pub(super) sizes: Vec<(usize, usize)>,
    /// Number of colors of a sample, and the colors that are used.
    pub(super) stored: usize,
    pub(super) channels: Vec<usize>,
    pub(super) gpu: Commands,
}

impl ViewDecoder {
    /// Makes a decoder for views of `size` rows and columns with `stored` colors, of which `channels` are wanted. All
    /// views of a frame take at most `bytes` bytes.
    ///
    /// # Errors
    /// [`EngineError::Unsuitable`] if a kernel of this device cannot bind the views at once, and lack of memory.
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
            return Err(gpu.unsuitable(format!("all views of a frame take {bytes} bytes, but a kernel binds {limit}")));
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

    /// Returns the device of the decoder.
    pub fn gpu(&self) -> &Gpu {
        &self.gpu.shared
    }

    /// Loses the device after this number of submissions, in tests of what follows.
    #[cfg(any(test, feature = "test-hooks"))]
    pub fn pretend_lost_after(&mut self, submissions: u64) {
        self.gpu.recorder.fail_after(submissions, ash::vk::Result::ERROR_DEVICE_LOST);
    }

    /// Returns the number of colors of a sample.
    pub fn stored_colors(&self) -> usize {
        self.stored
    }

    /// Returns the number of colors that are used.
    pub fn colors(&self) -> usize {
        self.channels.len()
    }

    /// Uploads samples, padded to whole words of 4 bytes.
    ///
    /// # Errors
    /// [`EngineError`] if there are more than the decoder was made for, or the device is lost.
    pub fn upload(&mut self, samples: &[u8]) -> Result<(), EngineError> {
        let bytes = samples.len() as u64;
        if bytes > self.samples.size || !bytes.is_multiple_of(4) {
            return Err(EngineError::mismatch(format!(
                "{bytes} bytes of views, but at most {} in words of 4 bytes fit",
                self.samples.size
            )));
        }
        self.gpu.put(&mut self.samples, samples, [(0, 0, bytes)])
    }

    /// Copies `bytes` bytes of samples that another process left in memory of this device, from `at` on. Both are
    /// multiples of 4.
    ///
    /// # Errors
    /// [`EngineError`] if they exceed the shared memory or this decoder, or the device is lost.
    #[cfg(target_os = "linux")]
    pub fn copy(&mut self, from: &SharedMemory, at: u64, bytes: u64) -> Result<(), EngineError> {
        take(&mut self.gpu, from, (at, bytes), &self.samples)
    }

    pub(super) fn pixels(&self) -> usize {
        self.sizes.first().map_or(0, |(height, width)| height * width)
    }

    fn parts(&self) -> u32 {
        (self.pixels() as u32).div_ceil(2 * WIDTH * WORDS).clamp(1, PARTS)
    }

    /// Returns the bytes of the sums of a color of this number of views.
    fn sums_bytes(&self, count: usize) -> u64 {
        (4 * SUMS as u64 * u64::from(self.parts()) * count as u64).next_multiple_of(256)
    }

    fn args(&self, views: &StoredViews, channel: usize) -> decode_views::Args {
        let (channels, channel, first) = match views.planar {
            true => (1, 0, (channel * views.count()) as u32),
            false => (self.stored as u32, channel as u32, 0),
        };
        decode_views::Args {
            pixels: self.pixels() as u32,
            channels,
            channel,
            sample: views.sample,
            coded: u32::from(views.coded),
            first,
            stride: 0,
            scale: 0.0,
        }
    }

    /// Returns the bytes of samples that are read for a color of this number of views.
    fn samples_read(&self, views: &StoredViews, count: usize) -> u64 {
        let colors = if views.planar { 1 } else { self.stored };
        views.sample_bytes() * (count * self.pixels() * colors) as u64
    }

    /// Draws views of splats in three colors from these cameras, on a grid, as the samples. The splats are drawn in
    /// this order of their indices.
    ///
    /// # Errors
    /// [`EngineError`] if the views or the splats do not fit the decoder or the device, memory runs out, or the device
    /// is lost.
    pub fn draw(
        &mut self,
        room: &mut DeviceSplats,
        (splats, order): (&dyn StoredSplats, &[u32]),
        cameras: &[Camera],
        grid: [usize; 2],
    ) -> Result<StoredViews, EngineError> {
        let views = StoredViews { grid, sample: decode_views::F32, coded: false, planar: true };
        let (pixels, count) = (self.pixels(), views.count());
        let sizes =
            cameras.iter().all(|camera| self.sizes.first() == Some(&(camera.height as usize, camera.width as usize)));
        if self.stored != 3 || !sizes || count != cameras.len() {
            return Err(EngineError::mismatch("the cameras do not belong to the views of the decoder"));
        }
        room.store(&mut self.gpu, splats, order)?;
        self.gpu.recorder.begin(0)?;
        self.gpu.recorder.barrier();
        let (next, stride) = (pixels as u32, (pixels * count) as u32);
        let pictures = Pictures { to: self.samples.all(), next, stride, light: true };
        room.record(&mut self.gpu, cameras, &pictures)?;
        self.gpu.recorder.submit("views of splats")?;
        Ok(views)
    }

    /// Returns the light in the views whose samples are on the device, color by color, or an invalid sample.
    ///
    /// # Errors
    /// [`EngineError`] if there are more views than the decoder was made for, or the device is lost.
    pub fn measure(&mut self, views: &StoredViews) -> Result<Result<Vec<ViewsLight>, NoLight>, EngineError> {
        let (count, pixels, parts) = (views.count(), self.pixels(), self.parts());
        let bytes = views.sample_bytes() * (count * pixels * self.stored) as u64;
        if count == 0 || bytes > self.samples.size {
            return Err(EngineError::mismatch(format!(
                "{count} views take {bytes} bytes, but {} fit",
                self.samples.size
            )));
        }
        let step = self.sums_bytes(count);
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
            // This run stores nothing, so the output may be bound to anything.
            let buffers = [self.samples.all(), self.curve.all(), to, to];
            let args = self.args(views, *channel);
            self.gpu.recorder.dispatch(pipeline, &buffers, bytemuck::bytes_of(&args), [parts, count as u32, 1])?;
            let read = self.samples_read(views, count);
            self.gpu.recorder.moved(|| vec![self.samples.all().reads(read), to.writes(step)]);
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

    /// Reads the invalid sample.
    fn no_light(
        &mut self,
        views: &StoredViews,
        channel: usize,
        view: usize,
        pixel: usize,
    ) -> Result<NoLight, EngineError> {
        let index = view * self.pixels() + pixel;
        let sample = match views.planar {
            true => channel * views.count() * self.pixels() + index,
            false => index * self.stored + channel,
        };
        let found = value(&mut self.gpu, &self.samples, views.sample, sample as u64)?;
        Ok(NoLight { channel, index, found })
    }

    /// Returns the pyramids of the views that were [measured](Self::measure) last, color by color. Their light stays
    /// on the device, except for the middle view of the first color at the [level for comparison](Pyramid::compared).
    ///
    /// # Errors
    /// [`EngineError`] if memory runs out or the device is lost.
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
        // The memory is kept even if decoding fails.
        self.made.extend(rooms.iter().cloned());
        let scales: Vec<f32> = lights.iter().map(|l| if l.brightest > 0.0 { l.brightest } else { 1.0 }).collect();
        self.gpu.recorder.begin(0)?;
        self.gpu.recorder.barrier();
        for (color, (room, scale)) in rooms.iter().zip(&scales).enumerate() {
            self.record_decoding(views, room, color, *scale)?;
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
        color: usize,
        scale: f32,
    ) -> Result<(), EngineError> {
        let (Some(level), Some(sums)) = (room.levels.first(), &self.sums) else { return Ok(()) };
        let pipeline = self.gpu.pipeline(&spirv::DECODE_VIEWS, 4, &[])?;
        let step = self.sums_bytes(views.count());
        let of_color = sums.range(color as u64 * step, step);
        for (at, piece) in level.pieces.iter().enumerate() {
            // All pieces of a color write the same sums, which nobody reads any more.
            if at > 0 {
                self.gpu.recorder.barrier();
            }
            let all = self.args(views, self.channels[color]);
            let (first, stride) = (all.first + piece.views.start as u32, level.stride as u32);
            let args = decode_views::Args { first, stride, scale, ..all };
            let to = level.range(&room.blocks, piece, &piece.views);
            let buffers = [self.samples.all(), self.curve.all(), to, of_color];
            let groups = [self.parts(), piece.views.len() as u32, 1];
            self.gpu.recorder.dispatch(pipeline, &buffers, bytemuck::bytes_of(&args), groups)?;
            let read = self.samples_read(views, piece.views.len());
            self.gpu.recorder.moved(|| vec![self.samples.all().reads(read), to.writes(to.size)]);
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
            let [from, _, to] = buffers;
            self.gpu.recorder.moved(|| vec![from.reads(from.size), to.writes(to.size)]);
        }
        Ok(())
    }

    /// Returns a level with the middle view read and all other views zero.
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

/// Returns the bytes of a sample of this type.
fn sample_bytes(sample: u32) -> u64 {
    match sample {
        decode_views::U8 => 1,
        decode_views::F32 => 4,
        _ => 2,
    }
}

/// Reads a sample of floats.
pub(super) fn value(gpu: &mut Commands, samples: &Block, sample: u32, index: u64) -> Result<f32, EngineError> {
    let at = sample_bytes(sample) * index;
    let mut word = [0; 4];
    gpu.fetch(samples, &mut word, [(at / 4 * 4, 0, 4)])?;
    let half = [word[at as usize % 4], word[(at as usize + 1) % 4]];
    Ok(match sample {
        decode_views::F32 => f32::from_le_bytes(word),
        _ => half::value(u16::from_le_bytes(half)),
    })
}

/// Copies (place, length) in bytes from memory of another process. Both are multiples of 4.
#[cfg(target_os = "linux")]
pub(super) fn take(
    gpu: &mut Commands,
    from: &SharedMemory,
    (at, bytes): (u64, u64),
    to: &Block,
) -> Result<(), EngineError> {
    let ends = at.checked_add(bytes).is_some_and(|end| end <= from.block.size);
    if !ends || bytes > to.size || !(at | bytes).is_multiple_of(4) || !from.block.is_on(&gpu.device) {
        return Err(EngineError::mismatch(format!(
            "{bytes} bytes of a frame at {at}, but only {} are shared",
            from.block.size
        )));
    }
    gpu.recorder.begin(0)?;
    gpu.recorder.take_over(&from.block);
    gpu.recorder.copy(&from.block, to, [(at, 0, bytes)]);
    gpu.recorder.hand_back(&from.block);
    gpu.recorder.submit("a frame of an application")
}

/// Returns the light of `count` views from the sums of their parts, in order.
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
