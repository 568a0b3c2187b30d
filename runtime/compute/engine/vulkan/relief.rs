//! Makes views of a picture with depths on the device.
//!
//! It uses the kernels of [reliefs](eyebox_kernels::relief), which are not part of lists. A frame is read and checked
//! when it arrives. Its views are drawn for the pupil of the next set.

use super::super::EngineError;
#[cfg(target_os = "linux")]
use super::decode::take;
use super::decode::{NoLight, StoredViews, ViewDecoder, value};
use super::splats::make_room;
#[cfg(target_os = "linux")]
use crate::gpu::SharedMemory;
use crate::gpu::{Block, Commands, Range};
use eyebox_kernels::relief::{Args, COLORS};
use eyebox_kernels::relief_close::direction;
use eyebox_kernels::relief_decode::{self, ALL_VALID, START, of_ordered};
use eyebox_kernels::relief_levels::{Levels, SIDE, WORDS, blocks};
use eyebox_kernels::relief_sharpen::{self, TIMES};
use eyebox_kernels::relief_unmix::VALUES as FRINGE;
use eyebox_kernels::{WIDTH, decode_views};
use eyebox_spirv as spirv;

/// Bytes of the coverage and the disparity of a pixel.
const SEEN: u64 = 8;

/// A picture with depths as an application stored it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StoredDepths {
    /// Type of the colors, [`decode_views::U8`] to [`decode_views::F32`].
    pub sample: u32,
    /// True if integers are coded in sRGB, false if they are linear.
    pub coded: bool,
    /// Place of the depths in bytes, a multiple of 4. They are dioptres in float32.
    pub depths: u64,
    /// Pixels by which content at one dioptre moves per unit of the places of views.
    pub per_dioptre: f32,
}

/// A picture with depths on a device, and room for its surfaces.
#[derive(Default)]
pub struct DeviceRelief {
    frame: Option<Block>,
    state: Option<Block>,
    picture: Option<Block>,
    sharp: [Option<Block>; 2],
    nearest: [Option<Block>; 2],
    front: Option<Block>,
    fringe: Option<Block>,
    filled: Option<Block>,
    hidden: Option<Block>,
    marks: Option<Block>,
    seen: Option<Block>,
    /// The smallest and the largest disparity of the picture.
    ends: Option<[f32; 2]>,
}

/// The blocks of a relief.
struct Blocks<'a> {
    picture: &'a Block,
    sharp: [&'a Block; 2],
    nearest: [&'a Block; 2],
    front: &'a Block,
    fringe: &'a Block,
    filled: &'a Block,
    hidden: &'a Block,
    marks: &'a Block,
    seen: &'a Block,
}

/// The place of the views in a range, as one plane for each color.
struct Views<'a> {
    to: Range<'a>,
    /// Number of colors, and the index of the plane of each in 8 bits.
    colors: u32,
    planes: u32,
    /// Values from a plane to the next.
    stride: u32,
}

impl DeviceRelief {
    /// Returns the smallest and the largest disparity of the picture that was read last, unless it was invalid.
    pub fn ends(&self) -> Option<[f32; 2]> {
        self.ends
    }

    /// Makes room for the surfaces of a picture.
    fn room(&mut self, gpu: &Commands, args: &Args) -> Result<Blocks<'_>, EngineError> {
        let pixels = u64::from(args.height) * u64::from(args.width);
        let (surface, plane) = (4 * args.values() as u64, 4 * u64::from(args.plane));
        let [down, across] = blocks(args);
        let [sharp_0, sharp_1] = &mut self.sharp;
        let [nearest_0, nearest_1] = &mut self.nearest;
        let sharp = |block| Ok::<_, EngineError>(&*make_room(gpu, block, 4 * pixels, "sharpened disparities")?);
        let sharp = [sharp(sharp_0)?, sharp(sharp_1)?];
        let nearest = |block| Ok::<_, EngineError>(&*make_room(gpu, block, 2 * plane, "rims of tears")?);
        let nearest = [nearest(nearest_0)?, nearest(nearest_1)?];
        Ok(Blocks {
            picture: make_room(gpu, &mut self.picture, 4 * (1 + COLORS as u64) * pixels, "a picture with depths")?,
            sharp,
            nearest,
            front: make_room(gpu, &mut self.front, surface, "a surface")?,
            fringe: make_room(gpu, &mut self.fringe, FRINGE as u64 * plane, "fringes")?,
            filled: make_room(gpu, &mut self.filled, surface, "a continued surface")?,
            hidden: make_room(gpu, &mut self.hidden, surface, "a hidden surface")?,
            marks: make_room(gpu, &mut self.marks, 4 * (WORDS * down * across) as u64, "levels of disparity")?,
            seen: make_room(gpu, &mut self.seen, SEEN * pixels, "coverage of a view")?,
        })
    }

    /// Reads and checks the frame. Returns the smallest and the largest disparity, or an invalid value. For a depth, the
    /// channel is the number of colors.
    fn read(
        &mut self,
        gpu: &mut Commands,
        curve: &Block,
        args: &relief_decode::Args,
    ) -> Result<Result<[f32; 2], NoLight>, EngineError> {
        self.ends = None;
        let pixels = u64::from(args.pixels);
        let picture = make_room(gpu, &mut self.picture, 4 * (1 + COLORS as u64) * pixels, "a picture with depths")?;
        let state = make_room(gpu, &mut self.state, size_of_val(&START) as u64, "the state of a frame")?;
        gpu.put(state, bytemuck::bytes_of(&START), [(0, 0, size_of_val(&START) as u64)])?;
        let Some(frame) = &self.frame else { return Err(EngineError::mismatch("no frame was stored")) };
        if 4 * (u64::from(args.depths) + pixels) > frame.size {
            return Err(EngineError::mismatch("the frame ends before its depths"));
        }
        let pipeline = gpu.pipeline(&spirv::RELIEF_DECODE, 4, &[])?;
        gpu.recorder.begin(0)?;
        gpu.recorder.barrier();
        let buffers = [frame.all(), curve.all(), picture.all(), state.all()];
        gpu.recorder.dispatch(pipeline, &buffers, bytemuck::bytes_of(args), lines(args.pixels))?;
        gpu.recorder.moved(|| vec![frame.all().reads(4 * u64::from(args.depths)), picture.all().writes(picture.size)]);
        gpu.recorder.submit("relief_decode")?;
        let mut found = START;
        gpu.fetch(state, bytemuck::bytes_of_mut(&mut found), [(0, 0, size_of_val(&START) as u64)])?;
        let [light, depth, low, high] = found;
        if light == ALL_VALID && depth == ALL_VALID {
            let ends = [low, high].map(of_ordered);
            self.ends = Some(ends);
            return Ok(Ok(ends));
        }
        let (channel, index, kind, at) = match light {
            ALL_VALID => (args.channels, depth, decode_views::F32, args.depths + depth),
            light => (light % args.channels, light / args.channels, args.sample, light),
        };
        let found = value(gpu, frame, kind, at.into())?;
        Ok(Err(NoLight { channel: channel as usize, index: index as usize, found }))
    }

    /// Records the surfaces of the picture, and then the views from these places. A barrier is at the end.
    fn record(
        &mut self,
        gpu: &mut Commands,
        size: [usize; 2],
        (places, reach): (&[[f32; 2]], f32),
        views: &Views<'_>,
    ) -> Result<(), EngineError> {
        let Some(ends) = self.ends else { return Err(EngineError::mismatch("no picture with depths was read")) };
        let args = Args::new(size, ends, reach);
        let pixels = args.height * args.width;
        let levels = Levels::new(ends, reach);
        let blocks = self.room(gpu, &args)?;
        blocks.sharpen(gpu, &args)?;
        blocks.separate(gpu, &args, &levels)?;
        for (view, place) in places.iter().enumerate() {
            // The views are in one range, and the newest validation layer takes it as a whole. So each view waits for the
            // one before.
            blocks.draw(gpu, (&args, &levels), *place, (view as u32 * pixels, views))?;
            gpu.recorder.barrier();
            blocks.close(gpu, &args, *place, (view as u32 * pixels, views))?;
            gpu.recorder.barrier();
        }
        Ok(())
    }
}

impl Blocks<'_> {
    /// Records the drawing of a view from a place. It begins at `first` in each plane.
    fn draw(
        &self,
        gpu: &mut Commands,
        (args, levels): (&Args, &Levels),
        place: [f32; 2],
        (first, views): (u32, &Views<'_>),
    ) -> Result<(), EngineError> {
        let pipeline = gpu.pipeline(&spirv::RELIEF_DRAW, 6, &[])?;
        let tiles = [args.width.div_ceil(SIDE), args.height.div_ceil(SIDE), 1];
        let [u, v] = place.map(f32::to_bits);
        let mut push: Vec<u32> = bytemuck::cast_slice(bytemuck::bytes_of(args)).to_vec();
        push.extend_from_slice(bytemuck::cast_slice(bytemuck::bytes_of(levels)));
        push.extend([u, v, views.colors, views.planes, first, views.stride]);
        let Blocks { front, fringe, hidden, marks, seen, .. } = self;
        let buffers = [front.all(), fringe.all(), hidden.all(), marks.all(), views.to, seen.all()];
        gpu.recorder.dispatch(pipeline, &buffers, bytemuck::cast_slice(&push), tiles)?;
        gpu.recorder.moved(|| {
            let (plane, pixels) = (u64::from(args.plane), u64::from(args.height * args.width));
            // A pixel reads disparities and one color.
            let read = [front, fringe, hidden].map(|block| block.all().reads(4 * plane));
            let mut moves = read.to_vec();
            moves.push(front.all().reads(4 * COLORS as u64 * plane));
            moves.extend([views.to.writes(4 * u64::from(views.colors) * pixels), seen.all().writes(SEEN * pixels)]);
            moves
        });
        Ok(())
    }

    /// Records the closing of the gaps of a view.
    fn close(
        &self,
        gpu: &mut Commands,
        args: &Args,
        place: [f32; 2],
        (first, views): (u32, &Views<'_>),
    ) -> Result<(), EngineError> {
        let pipeline = gpu.pipeline(&spirv::RELIEF_CLOSE, 2, &[])?;
        let [x, y] = direction(place).map(f32::to_bits);
        let push = [args.height, args.width, x, y, views.colors, views.planes, first, views.stride];
        let buffers = [views.to, self.seen.all()];
        let pixels = args.height * args.width;
        gpu.recorder.dispatch(pipeline, &buffers, bytemuck::cast_slice(&push), lines(pixels))?;
        gpu.recorder.moved(|| vec![self.seen.all().reads(SEEN * u64::from(pixels))]);
        Ok(())
    }

    /// Records the sharpening of the disparities.
    fn sharpen(&self, gpu: &mut Commands, args: &Args) -> Result<(), EngineError> {
        let pipeline = gpu.pipeline(&spirv::RELIEF_SHARPEN, 2, &[])?;
        let push = relief_sharpen::Args { height: args.height, width: args.width, tear: args.tear };
        let pixels = args.height * args.width;
        for time in 0..TIMES {
            let from = if time == 0 { self.picture } else { self.sharp[(time + 1) % 2] };
            let buffers = [from.all(), self.sharp[time % 2].all()];
            gpu.recorder.dispatch(pipeline, &buffers, bytemuck::bytes_of(&push), lines(pixels))?;
            gpu.recorder
                .moved(|| buffers.iter().flat_map(|b| b.moves(2 * u64::from(pixels), 2 * u64::from(pixels))).collect());
            gpu.recorder.barrier();
        }
        Ok(())
    }

    /// Records the separation of mixed colors, the hidden surface, and the levels of all blocks.
    fn separate(&self, gpu: &mut Commands, args: &Args, levels: &Levels) -> Result<(), EngineError> {
        let sharp = self.sharp[(TIMES + 1) % 2];
        let (groups, plane) = (lines(args.pixels() as u32), 4 * u64::from(args.plane));
        let push = bytemuck::bytes_of(args);
        let mut run =
            |module: &'static spirv::Module, buffers: &[&Block], push: &[u8], groups: [u32; 3], planes: u64| {
                let pipeline = gpu.pipeline(module, buffers.len() as u32, &[])?;
                let ranges: Vec<Range<'_>> = buffers.iter().map(|block| block.all()).collect();
                gpu.recorder.dispatch(pipeline, &ranges, push, groups)?;
                gpu.recorder
                    .moved(|| ranges.iter().map(|range| range.reads(plane * planes / ranges.len() as u64)).collect());
                gpu.recorder.barrier();
                Ok::<(), EngineError>(())
            };
        let [start, _] = self.nearest;
        run(&spirv::RELIEF_UNMIX, &[self.picture, sharp, self.front, self.fringe, start], push, groups, 15)?;
        let mut nearest = self.nearest;
        for step in args.steps([levels.low, levels.high]) {
            let push: Vec<u32> = bytemuck::cast_slice(push).iter().copied().chain([step]).collect();
            let [from, to] = nearest;
            run(&spirv::RELIEF_JUMP, &[self.front, from, to], bytemuck::cast_slice(&push), groups, 5)?;
            nearest = [to, from];
        }
        run(&spirv::RELIEF_FILL, &[self.front, nearest[0], self.filled], push, groups, 6)?;
        run(&spirv::RELIEF_SOFTEN, &[self.filled, self.hidden], push, groups, 8)?;
        let [down, across] = blocks(args).map(|n| n as u32);
        let buffers = [self.front, self.fringe, self.hidden, self.marks];
        let push = [push, bytemuck::bytes_of(levels)].concat();
        run(&spirv::RELIEF_LEVELS, &buffers, &push, lines(down * across), 3)
    }
}

/// Returns the workgroups of a kernel over pixels, which take further pixels in turn.
fn lines(pixels: u32) -> [u32; 3] {
    [pixels.div_ceil(WIDTH).clamp(1, 65_535), 1, 1]
}

impl ViewDecoder {
    /// Uploads a picture with depths, padded to whole words of 4 bytes.
    ///
    /// # Errors
    /// [`EngineError`] if it does not fit the device, or the device is lost.
    pub fn upload_depths(&mut self, room: &mut DeviceRelief, samples: &[u8]) -> Result<(), EngineError> {
        let bytes = samples.len() as u64;
        let frame = make_room(&self.gpu, &mut room.frame, bytes, "a frame of an application")?;
        self.gpu.put(frame, samples, [(0, 0, bytes)])
    }

    /// Copies a picture with depths of `bytes` bytes, which another process left in memory of this device, from `at` on.
    /// Both are multiples of 4.
    ///
    /// # Errors
    /// [`EngineError`] if they exceed the shared memory, or the device is lost.
    #[cfg(target_os = "linux")]
    pub fn copy_depths(
        &mut self,
        room: &mut DeviceRelief,
        from: &SharedMemory,
        at: u64,
        bytes: u64,
    ) -> Result<(), EngineError> {
        let frame = make_room(&self.gpu, &mut room.frame, bytes, "a frame of an application")?;
        take(&mut self.gpu, from, (at, bytes), frame)
    }

    /// Copies the stored picture with depths to the host.
    ///
    /// # Errors
    /// [`EngineError`] if no such picture was stored, or the device is lost.
    pub fn fetch_depths(&mut self, room: &DeviceRelief, samples: &mut [u8]) -> Result<(), EngineError> {
        let bytes = samples.len() as u64;
        let frame = room.frame.as_ref().filter(|frame| frame.size >= bytes);
        let frame = frame.ok_or_else(|| EngineError::mismatch("no frame was stored"))?;
        self.gpu.fetch(frame, samples, [(0, 0, bytes)])
    }

    /// Reads and checks the picture with depths. Returns its smallest and its largest disparity, or an invalid value. If
    /// the value is a depth, its channel is the number of colors.
    ///
    /// # Errors
    /// [`EngineError`] if no such picture was stored, it does not fit the device, or the device is lost.
    pub fn read_depths(
        &mut self,
        room: &mut DeviceRelief,
        stored: &StoredDepths,
    ) -> Result<Result<[f32; 2], NoLight>, EngineError> {
        let wanted = |k: usize| self.channels[k.min(self.channels.len() - 1)] as u32;
        let args = relief_decode::Args {
            pixels: self.pixels() as u32,
            channels: self.stored as u32,
            wanted: std::array::from_fn(wanted),
            sample: stored.sample,
            coded: u32::from(stored.coded),
            depths: (stored.depths / 4) as u32,
            per_dioptre: stored.per_dioptre,
        };
        room.read(&mut self.gpu, &self.curve, &args)
    }

    /// Draws views of the picture that was [read](Self::read_depths) last, from these places (x, y) on a grid, as the
    /// samples. No place is farther than `reach` from the center along an axis.
    ///
    /// # Errors
    /// [`EngineError`] if no picture was read, the views do not fit the decoder or the device, memory runs out, or the
    /// device is lost.
    pub fn draw_depths(
        &mut self,
        room: &mut DeviceRelief,
        (places, reach): (&[[f32; 2]], f32),
        grid: [usize; 2],
    ) -> Result<StoredViews, EngineError> {
        let views = StoredViews { grid, sample: decode_views::F32, coded: false, planar: true };
        let (pixels, count) = (self.pixels(), places.len());
        let fits = 4 * (pixels * count * self.stored) as u64 <= self.samples.size;
        let Some((height, width)) = self.sizes.first().copied().filter(|_| fits && count == grid[0] * grid[1]) else {
            return Err(EngineError::mismatch("the places do not belong to the views of the decoder"));
        };
        let planes = self.channels.iter().enumerate().map(|(k, channel)| (*channel as u32) << (8 * k)).sum();
        self.gpu.recorder.begin(0)?;
        self.gpu.recorder.barrier();
        let (colors, stride) = (self.channels.len() as u32, (pixels * count) as u32);
        let of = Views { to: self.samples.all(), colors, planes, stride };
        room.record(&mut self.gpu, [height, width], (places, reach), &of)?;
        self.gpu.recorder.submit("views of depths")?;
        Ok(views)
    }
}

#[cfg(test)]
impl DeviceRelief {
    /// Returns the blocks of the surface in front, the fringes, the hidden surface, and the levels of blocks, as they
    /// were drawn last.
    pub(super) fn surfaces(&self) -> [&Block; 4] {
        [&self.front, &self.fringe, &self.hidden, &self.marks].map(|block| block.as_ref().expect("views were drawn"))
    }
}
