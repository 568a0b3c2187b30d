//! Phases to video frames on a device, by the kernel `encode`: beside the lists of kernels, for a display that is
//! driven from the device.
//!
//! Buffers are made once, for a [`Plan`]. A run covers one colour of one video frame, and as many of its sub-frames as
//! a kernel may see at once; runs of a frame follow each other, for they OR into it. What a run puts where are constants of
//! its pipeline. Rows of frames on the device are padded to whole words, four pixels of the SLM each.

use super::super::EngineError;
use super::layout::{Layout, Value};
use crate::gpu::{Block, Commands, Gpu, PhasesOnDevice, Pictures, Pipeline, PixelOrder};
use eyebox_kernels::encode::{self, Args, Levels, Part, Plan};
use eyebox_kernels::{WIDTH, pixels};
use eyebox_spirv as spirv;

/// Sub-frames that an entry can tell apart.
const MOST: usize = 256;
/// Most workgroups down the rows, and across.
const ROWS: u32 = 4096;
const ACROSS: u32 = 65535;

/// One colour's buffers.
struct Ink {
    /// Those that the host uploads, once it did.
    phases: Option<Block>,
    /// A block of nothing where there are none.
    offsets: Block,
    table: Block,
    /// Specialisation constants, but those of a run.
    constants: [u32; 6],
    /// The highest level, or memory code.
    highest: u32,
}

/// Slots of one colour in one video frame that a kernel sees at once.
struct Run {
    video_frame: usize,
    color: usize,
    /// Sub-frames that are seen.
    first: usize,
    count: usize,
    entries: Vec<u32>,
    flat: Flat,
    constants: [u32; CONSTANTS],
    /// For phases as float32, made ahead, and as binary angles, once such are given.
    pipelines: [Option<Pipeline>; 2],
}

/// Of the shader.
const CONSTANTS: usize = 13 + encode::ENTRIES;
/// Which of them says how many values there are from one sub-frame to the next, and which that phases are binary angles.
const STRIDE_AT: usize = 10;
const ANGLES_AT: usize = 12 + encode::ENTRIES;

/// How the shader goes over the picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
enum Flat {
    /// Row by row.
    Rows = encode::ROWS,
    /// Fours of pixels: rows follow each other on both sides.
    Fours = encode::FOURS,
    /// Fours of such fours, which one entry fills.
    Wide = encode::WIDE,
}

/// Encodes on a Vulkan device.
pub struct VulkanEncoder {
    // Dropped in this order: the device last.
    inks: Vec<Ink>,
    frames: Block,
    runs: Vec<Run>,
    /// Sub-frames of a colour on the device, and video frames.
    input: Layout,
    output: Layout,
    args: Args,
    /// The bit of a code that each cell holds, 4 bits each.
    cells: u32,
    /// Video frames with padded rows, as they come from the device.
    padded: Vec<u8>,
    seconds: f64,
    gpu: Commands,
}

impl VulkanEncoder {
    /// Makes the buffers and pipelines for sets of this plan on a device.
    ///
    /// # Errors
    /// A device whose kernels cannot see a whole sub-frame or video frame; out of memory.
    pub fn new(gpu: &Gpu, plan: &Plan) -> Result<Self, EngineError> {
        Self::on(Commands::new(gpu)?, plan)
    }

    /// The same on a device that can do less.
    #[cfg(any(test, feature = "test-hooks"))]
    pub fn on_lesser(gpu: &Gpu, plan: &Plan, lesser: &super::LesserDevice) -> Result<Self, EngineError> {
        Self::on(lesser.commands(gpu)?, plan)
    }

    fn on(mut gpu: Commands, plan: &Plan) -> Result<Self, EngineError> {
        let args = plan.args;
        let pixels = args.height as usize * args.width as usize;
        let row_words = (args.channels * args.cell_columns * args.width.div_ceil(4)) as usize;
        let input = Layout { offset: 0, frames: plan.sub_frames, values: pixels, value: Value::Real };
        let values = row_words * args.video_height();
        let output = Layout { offset: 0, frames: plan.video_frames.len(), values, value: Value::Real };
        let limit = gpu.limits.storage_range;
        for (layout, what) in [(&input, "sub-frame"), (&output, "video frame")] {
            if layout.at_once(limit) == 0 {
                let bytes = 4 * layout.values;
                return Err(gpu.unsuitable(format!("one {what} takes {bytes} bytes, a kernel may see {limit}")));
            }
        }
        let mut inks = Vec::with_capacity(plan.colors.len());
        for color in &plan.colors {
            let (kind, levels, table) = match &color.levels {
                Levels::Even(count) if count.is_power_of_two() => (encode::POWER, *count, &[][..]),
                Levels::Even(count) => (encode::EVEN, *count, &[][..]),
                Levels::Table(table) => (encode::TABLED, 0, &table[..]),
            };
            let highest = match &color.levels {
                Levels::Even(count) => count.saturating_sub(1),
                Levels::Table(table) => table.iter().copied().max().unwrap_or(0).into(),
            };
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
        let even = args.width.is_multiple_of(4);
        let padded = if even { Vec::new() } else { vec![0; 4 * output.values * output.frames] };
        Ok(Self { inks, frames, runs, input, output, args, cells, padded, seconds: 0.0, gpu })
    }

    /// The driver says that the device was lost from its so many-th submission from now on.
    #[cfg(any(test, feature = "test-hooks"))]
    pub fn pretend_lost_after(&mut self, submissions: u64) {
        self.gpu.recorder.fail_after(submissions, ash::vk::Result::ERROR_DEVICE_LOST);
    }

    /// The same, of the device's memory, which nothing is done about.
    #[cfg(any(test, feature = "test-hooks"))]
    pub fn pretend_full_after(&mut self, submissions: u64) {
        self.gpu.recorder.fail_after(submissions, ash::vk::Result::ERROR_OUT_OF_DEVICE_MEMORY);
    }

    /// The device.
    pub fn gpu(&self) -> &Gpu {
        &self.gpu.shared
    }

    /// Seconds that the kernel took over the last set, without transfers; 0 where the device tells no time.
    pub fn seconds(&self) -> f64 {
        self.seconds
    }

    /// Uploads a set, (sub-frame, row, column) per colour, as [`encode_uploaded`](Self::encode_uploaded) takes it.
    ///
    /// # Errors
    /// [`EngineError::Mismatch`]; a lost device.
    pub fn upload(&mut self, phases: &[&[f32]]) -> Result<(), EngineError> {
        let wanted = self.input.floats();
        if phases.len() != self.inks.len() || phases.iter().any(|p| p.len() != wanted) {
            return Err(EngineError::mismatch(format!(
                "a set has {} colours of {wanted} phases each",
                self.inks.len()
            )));
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

    /// Encodes the set that was uploaded last; the video frames stay on the device.
    ///
    /// # Errors
    /// [`EngineError::Mismatch`] where none was uploaded; a lost device.
    pub fn encode_uploaded(&mut self) -> Result<(), EngineError> {
        self.run(None)
    }

    /// Encodes phases that are on this device, colour by colour; the video frames stay there too.
    ///
    /// # Errors
    /// [`EngineError::Mismatch`] for phases of another shape or another device; a lost device.
    pub fn encode_on_device(&mut self, phases: &[PhasesOnDevice<'_>]) -> Result<(), EngineError> {
        let Layout { frames, values, .. } = self.input;
        let fits = |p: &PhasesOnDevice<'_>| (p.frames, p.values) == (frames, values) && p.block.is_on(&self.gpu.device);
        if phases.len() != self.inks.len() || !phases.iter().all(fits) {
            return Err(EngineError::mismatch(format!(
                "a set has {} colours of {frames} x {values} phases on one device",
                self.inks.len()
            )));
        }
        self.run(Some(phases))
    }

    /// `given`: phases on the device; those that were uploaded if there are none.
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
        // A frame that nothing is put into.
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
                    // Where there is little to do for a pixel, an invocation takes a few rows.
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

    /// Room on the device for the video frames of a set as pixels, for its swapchains.
    ///
    /// # Errors
    /// A video frame that is larger than a kernel may see; out of memory.
    pub fn pictures(&self, order: PixelOrder) -> Result<Pictures, EngineError> {
        let size = [self.args.video_height(), self.args.video_width()];
        Pictures::new(&self.gpu, self.output.frames, size, order)
    }

    /// Makes pixels of the video frames that were encoded last, on the device.
    ///
    /// # Errors
    /// [`EngineError::Mismatch`] for pictures of another encoder, or that are still read; a lost device.
    pub fn draw(&mut self, pictures: &mut Pictures) -> Result<(), EngineError> {
        let Self { frames, output, args, gpu, .. } = self;
        let [height, width] = [args.video_height(), args.video_width()];
        let fits = (pictures.count(), pictures.size()) == (output.frames, [height, width]);
        if !fits || pictures.in_use() || !pictures.block.is_on(&gpu.device) {
            return Err(EngineError::mismatch("these pictures are another encoder's, or still shown"));
        }
        let pipeline = gpu.pipeline(&spirv::PIXELS, 2, &[])?;
        let push = pixels::Args {
            height: height as u32,
            width: width as u32,
            row: (4 * output.values / height.max(1)) as u32,
            channels: args.channels,
            blue_first: u32::from(pictures.order() == PixelOrder::Bgra),
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

    /// Fetches the video frames that were encoded last: (frame, row, column, channel), as long as all of them are.
    ///
    /// # Errors
    /// [`EngineError::Mismatch`]; a lost device.
    pub fn download(&mut self, bytes: &mut [u8]) -> Result<(), EngineError> {
        let row = self.args.video_width() * self.args.channels as usize;
        let rows = self.args.video_height() * self.output.frames;
        if bytes.len() != row * rows {
            return Err(EngineError::mismatch(format!(
                "the video frames have {} bytes, {} were given",
                row * rows,
                bytes.len()
            )));
        }
        let pieces = self.output.pieces_back();
        if self.padded.is_empty() {
            return self.gpu.fetch(&self.frames, bytes, pieces);
        }
        self.gpu.fetch(&self.frames, &mut self.padded, pieces)?;
        let padded = self.padded.len() / rows;
        for (to, from) in bytes.chunks_exact_mut(row).zip(self.padded.chunks_exact(padded)) {
            to.copy_from_slice(&from[..row]);
        }
        Ok(())
    }

    /// Uploads a set, encodes it, and fetches its video frames.
    ///
    /// # Errors
    /// [`EngineError::Mismatch`]; a lost device.
    pub fn encode(&mut self, phases: &[&[f32]], bytes: &mut [u8]) -> Result<(), EngineError> {
        self.upload(phases)?;
        self.encode_uploaded()?;
        self.download(bytes)
    }
}

/// The runs. `at_once`: sub-frames that a kernel may see.
fn runs(plan: &Plan, at_once: usize) -> Vec<Run> {
    let mut runs = Vec::<Run>::new();
    for (video_frame, slots) in plan.video_frames.iter().enumerate() {
        let mut sorted: Vec<_> = slots.iter().collect();
        sorted.sort_by_key(|s| (s.color, s.sub_frame));
        let start = runs.len();
        for slot in sorted {
            // Of cells, the first: their bits go with the push constants.
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

/// How the shader may go over the picture. `fills`: one entry, and the first of its frame.
fn flat(args: &Args, aligned: bool, fills: bool) -> Flat {
    let places = [args.first, args.shift_x, args.shift_y, args.flips];
    let cells = args.cell_rows * args.cell_columns;
    if !aligned || args.step_y != args.width || places != [0; 4] || cells != 1 {
        return Flat::Rows;
    }
    let fours = args.width / 4 * args.height;
    if fills && args.channels == 1 && fours.is_multiple_of(4) { Flat::Wide } else { Flat::Fours }
}

/// An entry; `sub_frame` from the run's first.
fn entry(sub_frame: usize, part: &Part) -> u32 {
    (sub_frame as u32) << 24 | part.mask << 16 | part.from << 8 | part.to << 4 | part.channel
}

/// Whether an entry takes all bits of levels up to the highest.
fn takes_all(entry: u32, highest: u32) -> bool {
    let (mask, from) = ((entry >> 16) & 255, (entry >> 8) & 15);
    from == 0 && highest & !mask == 0
}

/// Whether four pixels of the SLM, from a multiple of four on, always take phases that lie side by side, from a multiple
/// of four on. `stride`: values from one sub-frame to the next.
fn are_aligned(args: &Args, stride: usize) -> bool {
    let sides = [args.width, args.first, args.step_y, args.shift_x];
    args.step_x == 1 && args.flips & 1 == 0 && sides.iter().all(|n| n.is_multiple_of(4)) && stride.is_multiple_of(4)
}

/// Runs of different video frames may run side by side, those of one frame follow each other: the n-th of every frame.
fn rounds(runs: &[Run]) -> impl Iterator<Item = impl Iterator<Item = &Run>> {
    let rank = |i: usize| runs[..i].iter().rev().take_while(|r| r.video_frame == runs[i].video_frame).count();
    let most = (0..runs.len()).map(rank).max().map_or(0, |n| n + 1);
    (0..most).map(move |n| (0..runs.len()).filter(move |i| rank(*i) == n).map(|i| &runs[i]))
}
