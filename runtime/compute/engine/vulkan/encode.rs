//! Converts phases to video frames on a device with the kernel `encode`, for displays that are driven from it.
//!
//! The kernel is not part of lists. Buffers are made once, for a [`Plan`]. A run covers one color of one video frame,
//! and as many of its sub-frames as a kernel may bind at once. Runs of a frame follow each other, because they
//! combine their bits with OR. The bits and places of a run are constants of its pipeline. Rows of frames on the
//! device are padded to whole words, with four pixels of the SLM each.

use super::super::EngineError;
use super::layout::{Layout, Value};
use crate::gpu::{Block, Commands, Gpu, PhasesOnDevice, Pictures, Pipeline, PixelOrder};
use eyebox_kernels::encode::{self, Area, Args, Levels, Part, Plan};
use eyebox_kernels::{WIDTH, pixels};
use eyebox_spirv as spirv;

/// Sub-frames that an entry can distinguish.
const MOST: usize = 256;
/// Most workgroups down the rows, and across.
const ROWS: u32 = 4096;
const ACROSS: u32 = 65535;

/// The buffers of one color.
struct Ink {
    /// Phases that the host uploaded, if any.
    phases: Option<Block>,
    /// A dummy block if there are none.
    offsets: Block,
    table: Block,
    /// Specialization constants that all runs share.
    constants: [u32; 6],
    /// The highest level, or memory code.
    highest: u32,
}

/// Slots of one color in one video frame that a kernel binds at once.
struct Run {
    video_frame: usize,
    color: usize,
    /// First sub-frame and number of sub-frames.
    first: usize,
    count: usize,
    entries: Vec<u32>,
    flat: Flat,
    constants: [u32; CONSTANTS],
    /// Pipelines for float32 phases, made in advance, and for binary angles, made on first use.
    pipelines: [Option<Pipeline>; 2],
}

/// Number of the shader's constants.
const CONSTANTS: usize = 13 + encode::ENTRIES;
/// Index of the constant with the number of values between sub-frames, and of the flag for binary angles.
const STRIDE_AT: usize = 10;
const ANGLES_AT: usize = 12 + encode::ENTRIES;

/// The way in which the shader iterates over the picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
enum Flat {
    /// By rows, one after the other.
    Rows = encode::ROWS,
    /// By groups of four pixels, with contiguous rows on both sides.
    Fours = encode::FOURS,
    /// By four such groups, which one entry fills.
    Wide = encode::WIDE,
}

/// Encodes video frames on a Vulkan device.
pub struct VulkanEncoder {
    // Fields are dropped in this order, the device last.
    inks: Vec<Ink>,
    frames: Block,
    runs: Vec<Run>,
    /// Sub-frames of a color on the device, and video frames.
    input: Layout,
    output: Layout,
    args: Args,
    area: Area,
    /// The bit of a code that each cell holds, 4 bits per cell.
    cells: u32,
    /// The SLM's part of the video frames with padded rows, as read from the device. It is empty if the rows have no
    /// padding and the SLM is all of the video frame.
    padded: Vec<u8>,
    seconds: f64,
    gpu: Commands,
}

impl VulkanEncoder {
    /// Makes the buffers and pipelines for sets of this plan on a device.
    ///
    /// # Errors
    /// [`EngineError`] if the kernels cannot bind a whole sub-frame or video frame, or memory runs out.
    pub fn new(gpu: &Gpu, plan: &Plan) -> Result<Self, EngineError> {
        Self::on(Commands::new(gpu)?, plan)
    }

    /// Makes the encoder on a device with lower limits.
    #[cfg(any(test, feature = "test-hooks"))]
    pub fn on_lesser(gpu: &Gpu, plan: &Plan, lesser: &super::LesserDevice) -> Result<Self, EngineError> {
        Self::on(lesser.commands(gpu)?, plan)
    }

    fn on(mut gpu: Commands, plan: &Plan) -> Result<Self, EngineError> {
        let args = plan.args;
        let pixels = args.height as usize * args.width as usize;
        let row_words = (args.channels * args.cell_columns * args.width.div_ceil(4)) as usize;
        let input = Layout { offset: 0, frames: plan.sub_frames, values: pixels, value: Value::Real };
        let values = row_words * args.area_height();
        let output = Layout { offset: 0, frames: plan.video_frames.len(), values, value: Value::Real };
        let limit = gpu.limits.storage_range;
        for (layout, what) in [(&input, "sub-frame"), (&output, "video frame")] {
            if layout.at_once(limit) == 0 {
                let bytes = 4 * layout.values;
                return Err(gpu.unsuitable(format!("one {what} takes {bytes} bytes, but a kernel binds {limit}")));
            }
        }
        let mut inks = Vec::with_capacity(plan.colors.len());
        for color in &plan.colors {
            let (kind, levels, table) = match &color.levels {
                Levels::Even(count) if count.is_power_of_two() => (encode::POWER, *count, &[][..]),
                Levels::Even(count @ ..=256) => (encode::EVEN, *count, &[][..]),
                Levels::Even(count) => (encode::FINE, *count, &[][..]),
                Levels::Table(table) => (encode::TABLED, 0, &table[..]),
                Levels::FineTable(table) => (encode::FINE_TABLED, 0, bytemuck::cast_slice(table)),
            };
            let highest = color.levels.highest();
            let has_offsets = u32::from(!color.offsets.is_empty());
            let constants = [args.channels, kind, has_offsets, args.cell_rows, args.cell_columns, levels];
            inks.push(Ink {
                phases: None,
                offsets: gpu.filled(bytemuck::cast_slice(&color.offsets), "offsets")?,
                table: gpu.filled(table, "a table of levels")?,
                constants,
                highest,
            });
        }
        let mut runs = runs(plan, input.at_once(limit).min(MOST));
        let mut before = None;
        let aligned = u32::from(are_aligned(&args, input.stride()));
        for run in &mut runs {
            let Ink { constants, highest, .. } = inks[run.color];
            let follows = before.replace(run.video_frame) == Some(run.video_frame);
            let entire = u32::from(run.entries.iter().all(|entry| takes_all(*entry, highest)));
            run.flat = flat(&args, aligned == 1, run.entries.len() == 1 && !follows);
            let (count, stride) = (run.entries.len() as u32, input.stride() as u32);
            run.constants[..6].copy_from_slice(&constants);
            let own = [count, u32::from(follows), aligned, entire, stride, run.flat as u32];
            run.constants[6..12].copy_from_slice(&own);
            run.constants[12..][..run.entries.len()].copy_from_slice(&run.entries);
            run.pipelines[0] = Some(gpu.pipeline(&spirv::ENCODE, 4, &run.constants)?);
        }
        let cells = (plan.video_frames.iter().flatten().next())
            .map_or(0, |slot| slot.parts.iter().fold(0, |all, p| all | p.from << (4 * p.cell)));
        let frames = gpu.block(output.bytes(), "video frames")?;
        let dense = args.width.is_multiple_of(4) && plan.fills_frame();
        let padded = if dense { Vec::new() } else { vec![0; 4 * output.values * output.frames] };
        Ok(Self { inks, frames, runs, input, output, args, area: plan.area, cells, padded, seconds: 0.0, gpu })
    }

    /// Makes the driver report a lost device after `submissions` more submissions.
    #[cfg(any(test, feature = "test-hooks"))]
    pub fn pretend_lost_after(&mut self, submissions: u64) {
        self.gpu.recorder.fail_after(submissions, ash::vk::Result::ERROR_DEVICE_LOST);
    }

    /// Makes the driver report a lack of device memory after `submissions` more submissions, which has no remedy.
    #[cfg(any(test, feature = "test-hooks"))]
    pub fn pretend_full_after(&mut self, submissions: u64) {
        self.gpu.recorder.fail_after(submissions, ash::vk::Result::ERROR_OUT_OF_DEVICE_MEMORY);
    }

    /// Returns the device of the encoder.
    pub fn gpu(&self) -> &Gpu {
        &self.gpu.shared
    }

    /// Returns the seconds of the kernel for the last set, without transfers, or 0 if the device has no timestamps.
    pub fn seconds(&self) -> f64 {
        self.seconds
    }

    /// Uploads a set, (sub-frame, row, column) per color, for [`encode_uploaded`](Self::encode_uploaded).
    ///
    /// # Errors
    /// [`EngineError::Mismatch`] if the shape differs, and a lost device.
    pub fn upload(&mut self, phases: &[&[f32]]) -> Result<(), EngineError> {
        let wanted = self.input.floats();
        if phases.len() != self.inks.len() || phases.iter().any(|p| p.len() != wanted) {
            return Err(EngineError::mismatch(format!("a set has {} colors of {wanted} phases each", self.inks.len())));
        }
        for (ink, phases) in self.inks.iter_mut().zip(phases) {
            if ink.phases.is_none() {
                ink.phases = Some(self.gpu.block(self.input.bytes(), "phases")?);
            }
            let Some(block) = &mut ink.phases else { continue };
            self.gpu.put(block, bytemuck::cast_slice(phases), self.input.pieces())?;
        }
        Ok(())
    }

    /// Encodes the set that was uploaded last. The video frames stay on the device.
    ///
    /// # Errors
    /// [`EngineError::Mismatch`] if no set was uploaded, and a lost device.
    pub fn encode_uploaded(&mut self) -> Result<(), EngineError> {
        self.run(None)
    }

    /// Encodes phases that are on this device, color by color. The video frames stay there too.
    ///
    /// # Errors
    /// [`EngineError::Mismatch`] if the phases have another shape or device, and a lost device.
    pub fn encode_on_device(&mut self, phases: &[PhasesOnDevice<'_>]) -> Result<(), EngineError> {
        let Layout { frames, values, .. } = self.input;
        let fits = |p: &PhasesOnDevice<'_>| (p.frames, p.values) == (frames, values) && p.block.is_on(&self.gpu.device);
        if phases.len() != self.inks.len() || !phases.iter().all(fits) {
            return Err(EngineError::mismatch(format!(
                "a set has {} colors of {frames} x {values} phases on one device",
                self.inks.len()
            )));
        }
        self.run(Some(phases))
    }

    /// Encodes phases `given` on the device, or the uploaded ones if none are given.
    fn run(&mut self, given: Option<&[PhasesOnDevice<'_>]>) -> Result<(), EngineError> {
        let Self { inks, frames, runs, input, output, args, cells, gpu, .. } = self;
        let angles_of = |color: usize| given.is_some_and(|given| given[color].binary_angles);
        let layout = |angles: bool| Layout { value: if angles { Value::Angle } else { Value::Real }, ..*input };
        for run in runs.iter_mut().filter(|run| angles_of(run.color) && run.pipelines[1].is_none()) {
            run.constants[STRIDE_AT] = layout(true).stride() as u32;
            run.constants[ANGLES_AT] = 1;
            run.pipelines[1] = Some(gpu.pipeline(&spirv::ENCODE, 4, &run.constants)?);
        }
        gpu.recorder.begin(1)?;
        // These frames receive no slots.
        for frame in (0..output.frames).filter(|f| !runs.iter().any(|run| run.video_frame == *f)) {
            gpu.recorder.clear(output.range(frames, frame, 1));
        }
        let fours = args.width.div_ceil(4);
        let groups_of = |invocations: u32| invocations.div_ceil(WIDTH);
        for round in rounds(runs) {
            gpu.recorder.barrier();
            for run in round {
                let angles = angles_of(run.color);
                let (ink, Some(pipeline)) = (&inks[run.color], run.pipelines[usize::from(angles)]) else { continue };
                let groups = match run.flat {
                    // With little work per pixel, an invocation takes a few rows.
                    Flat::Rows => {
                        let rows = args.height.div_ceil(if run.entries.len() == 1 { 4 } else { 1 });
                        [groups_of(fours), rows.min(ROWS), 1]
                    }
                    Flat::Fours => [groups_of(fours * args.height).min(ACROSS), 1, 1],
                    Flat::Wide => [groups_of(fours * args.height / 4).min(ACROSS), 1, 1],
                };
                let mut push = [0u32; 12];
                push[..11].copy_from_slice(bytemuck::cast_slice(std::slice::from_ref(args)));
                push[11] = *cells;
                let phases = match given {
                    Some(given) => Some(given[run.color].block),
                    None => ink.phases.as_ref(),
                };
                let phases = phases.ok_or_else(|| EngineError::mismatch("no phases were uploaded"))?;
                let buffers = [
                    layout(angles).range(phases, run.first, run.count),
                    ink.offsets.all(),
                    ink.table.all(),
                    output.range(frames, run.video_frame, 1),
                ];
                gpu.recorder.dispatch(pipeline, &buffers, bytemuck::cast_slice(&push), groups)?;
            }
        }
        gpu.recorder.mark(0);
        gpu.recorder.submit("encode")?;
        self.seconds = gpu.recorder.times.drain(..).map(|t| t.seconds).sum();
        Ok(())
    }

    /// Makes room on the device for the video frames of a set as pixels, for its swapchains.
    ///
    /// # Errors
    /// [`EngineError`] if a video frame exceeds the range of a kernel, or memory runs out.
    pub fn pictures(&self, order: PixelOrder) -> Result<Pictures, EngineError> {
        Pictures::new(&self.gpu, self.output.frames, self.area.frame.map(|n| n as usize), order)
    }

    /// Converts the video frames that were encoded last to pixels, on the device.
    ///
    /// # Errors
    /// [`EngineError::Mismatch`] if the pictures are another encoder's or still being read, and a lost device.
    pub fn draw(&mut self, pictures: &mut Pictures) -> Result<(), EngineError> {
        let Self { frames, output, args, area, gpu, .. } = self;
        let fits = (pictures.count(), pictures.size()) == (output.frames, area.frame.map(|n| n as usize));
        if !fits || pictures.in_use() || !pictures.block.is_on(&gpu.device) {
            return Err(EngineError::mismatch("the pictures belong to another encoder or are still shown"));
        }
        let pipeline = gpu.pipeline(&spirv::PIXELS, 2, &[])?;
        let push = pixels::Args {
            height: area.frame[0],
            width: area.frame[1],
            row: (4 * output.values / args.area_height().max(1)) as u32,
            channels: args.channels,
            blue_first: u32::from(pictures.order() == PixelOrder::Bgra),
            top: area.offset[0],
            left: area.offset[1],
            rows: args.area_height() as u32,
            columns: args.area_width() as u32,
            fill: area.fill.into(),
        };
        gpu.recorder.begin(0)?;
        gpu.recorder.barrier();
        for frame in 0..output.frames {
            let to = pictures.block.range(frame as u64 * pictures.step, pictures.step);
            let groups = [push.width.div_ceil(WIDTH), push.height.min(ROWS), 1];
            gpu.recorder.dispatch(
                pipeline,
                &[output.range(frames, frame, 1), to],
                bytemuck::bytes_of(&push),
                groups,
            )?;
        }
        gpu.recorder.submit("pixels")?;
        pictures.ready = Some(gpu.recorder.last());
        Ok(())
    }

    /// Reads the video frames that were encoded last (frame, row, column, channel), all of them.
    ///
    /// # Errors
    /// [`EngineError::Mismatch`] if the length differs, and a lost device.
    pub fn download(&mut self, bytes: &mut [u8]) -> Result<(), EngineError> {
        let [line, left] = self.area.line_bytes(self.args.channels);
        let frame = self.area.frame[0] as usize * line;
        if bytes.len() != frame * self.output.frames {
            return Err(EngineError::mismatch(format!(
                "the video frames have {} bytes, but {} were given",
                frame * self.output.frames,
                bytes.len()
            )));
        }
        let pieces = self.output.pieces_back();
        if self.padded.is_empty() {
            return self.gpu.fetch(&self.frames, bytes, pieces);
        }
        self.gpu.fetch(&self.frames, &mut self.padded, pieces)?;
        if frame > self.args.area_height() * self.args.area_width() * self.args.channels as usize {
            bytes.fill(self.area.fill);
        }
        let row = self.args.area_width() * self.args.channels as usize;
        let padded = self.padded.len() / (self.args.area_height() * self.output.frames);
        let above = self.area.offset[0] as usize * line;
        let parts = self.padded.chunks_exact(padded * self.args.area_height());
        for (to, from) in bytes.chunks_exact_mut(frame).zip(parts) {
            for (to, from) in to[above..].chunks_exact_mut(line).zip(from.chunks_exact(padded)) {
                to[left..left + row].copy_from_slice(&from[..row]);
            }
        }
        Ok(())
    }

    /// Uploads a set, encodes it, and reads its video frames.
    ///
    /// # Errors
    /// [`EngineError::Mismatch`] if a shape or length differs, and a lost device.
    pub fn encode(&mut self, phases: &[&[f32]], bytes: &mut [u8]) -> Result<(), EngineError> {
        self.upload(phases)?;
        self.encode_uploaded()?;
        self.download(bytes)
    }
}

/// Returns the runs, in which a kernel may bind `at_once` sub-frames.
fn runs(plan: &Plan, at_once: usize) -> Vec<Run> {
    let mut runs = Vec::<Run>::new();
    for (video_frame, slots) in plan.video_frames.iter().enumerate() {
        let mut sorted: Vec<_> = slots.iter().collect();
        sorted.sort_by_key(|s| (s.color, s.sub_frame));
        let start = runs.len();
        for slot in sorted {
            // Only the first of several cells has entries, because their bits are push constants.
            let cells = slot.parts.iter().any(|p| p.cell > 0);
            for part in &slot.parts[..if cells { 1 } else { slot.parts.len() }] {
                match runs[start..].last_mut() {
                    Some(run)
                        if run.color == slot.color
                            && slot.sub_frame - run.first < at_once
                            && run.entries.len() < encode::ENTRIES =>
                    {
                        run.count = slot.sub_frame - run.first + 1;
                        run.entries.push(entry(slot.sub_frame - run.first, part));
                    }
                    _ => runs.push(Run {
                        video_frame,
                        color: slot.color,
                        first: slot.sub_frame,
                        count: 1,
                        entries: vec![entry(0, part)],
                        flat: Flat::Rows,
                        constants: [0; CONSTANTS],
                        pipelines: [None; 2],
                    }),
                }
            }
        }
    }
    runs
}

/// Returns the shader's iteration over the picture. `fills` is true for one entry that is the first of its frame.
fn flat(args: &Args, aligned: bool, fills: bool) -> Flat {
    let places = [args.first, args.shift_x, args.shift_y, args.flips];
    let cells = args.cell_rows * args.cell_columns;
    if !aligned || args.step_y != args.width || places != [0; 4] || cells != 1 {
        return Flat::Rows;
    }
    let fours = args.width / 4 * args.height;
    if fills && args.channels == 1 && fours.is_multiple_of(4) { Flat::Wide } else { Flat::Fours }
}

/// Packs an entry. `sub_frame` counts from the run's first.
fn entry(sub_frame: usize, part: &Part) -> u32 {
    (sub_frame as u32) << 24 | part.mask << 16 | part.from << 8 | part.to << 4 | part.channel
}

/// Returns true if an entry takes all bits of levels up to the highest.
fn takes_all(entry: u32, highest: u32) -> bool {
    let (mask, from) = ((entry >> 16) & 255, (entry >> 8) & 15);
    from == 0 && highest & !mask == 0
}

/// Returns true if each four pixels of the SLM, from a multiple of four on, take four contiguous phases, from a
/// multiple of four on. `stride` is the number of values between sub-frames.
fn are_aligned(args: &Args, stride: usize) -> bool {
    let sides = [args.width, args.first, args.step_y, args.shift_x];
    args.step_x == 1 && args.flips & 1 == 0 && sides.iter().all(|n| n.is_multiple_of(4)) && stride.is_multiple_of(4)
}

/// Returns the n-th runs of every frame together, because runs of different video frames may run at the same time.
/// The runs of one frame follow each other.
fn rounds(runs: &[Run]) -> impl Iterator<Item = impl Iterator<Item = &Run>> {
    let rank = |i: usize| runs[..i].iter().rev().take_while(|r| r.video_frame == runs[i].video_frame).count();
    let most = (0..runs.len()).map(rank).max().map_or(0, |n| n + 1);
    (0..most).map(move |n| (0..runs.len()).filter(move |i| rank(*i) == n).map(|i| &runs[i]))
}
