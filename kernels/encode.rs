//! Encodes phases as gray levels, and packs the bits of the levels into the pixels of a video frame.
//!
//! The four float operations at the beginning are exact, and everything after them is integer arithmetic. The shader
//! therefore gives the same bytes on every device, however the device rounds. A phase is split into whole radians and
//! the rest, both exact. Integer products turn each into units of 2^-32 turns, and a turn wraps as `u32` does.
//!
//! The shader takes one color of one video frame at a time, and ORs it into the frame.

pub use crate::encode_levels::{LARGEST_PHASE, Levels, TABLE, turns};
pub(crate) use crate::encode_levels::{PART, PARTS, RADIAN};

use crate::encode_levels::{quantise, quantise_fine};
use crate::simd;
use bytemuck::{Pod, Zeroable};

/// The shader finds the level by a shift. This requires a power of two of evenly spaced levels.
pub const POWER: u32 = 0;
/// The shader finds the level by a product. This requires evenly spaced levels.
pub const EVEN: u32 = 1;
/// The shader looks the level up in the table.
pub const TABLED: u32 = 2;
/// The shader finds one of more than 256 evenly spaced levels by two products.
pub const FINE: u32 = 3;
/// The shader looks the level up in a table with two bytes per entry.
pub const FINE_TABLED: u32 = 4;
/// The shader goes over the picture row by row.
pub const ROWS: u32 = 0;
/// The shader goes over the picture in groups of four pixels. This requires rows without gaps on both sides.
pub const FOURS: u32 = 1;
/// The shader goes over the picture in groups of sixteen pixels, which one entry fills.
pub const WIDE: u32 = 2;
/// Entries in one run of the shader.
pub const ENTRIES: usize = 24;
/// Maximum number of memory cells of a pixel.
const MOST_CELLS: usize = 4;

/// Pixels that are encoded at once, in the nearest cache. A set has several sub-frames, and each is a separate stream.
/// Blocks are long because a processor fetches ahead along a stream.
pub const BLOCK: usize = 8192;
/// Phases in one cache line of a processor.
const LINE: usize = 16;
/// Pixels of a block if its phases are not contiguous, or if the pixels have several cells.
const SMALL: usize = BLOCK / MOST_CELLS;

/// The size of the SLM and of its video frame, and the map from the pixels of the SLM to the pixels of the hologram.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
pub struct Args {
    /// Rows of the SLM.
    pub height: u32,
    /// Columns of the SLM.
    pub width: u32,
    /// Pixel (y, x) shows phase `first + yy step_y + xx step_x` (wrapping), `yy = (y + shift_y) mod height`,
    /// `xx = (x + shift_x) mod width`.
    pub first: u32,
    /// Phases from one row to the next.
    pub step_y: u32,
    /// Phases from one column to the next.
    pub step_x: u32,
    /// Shift in rows, less than `height`.
    pub shift_y: u32,
    /// Shift in columns, less than `width`.
    pub shift_x: u32,
    /// Rows of memory cells per pixel.
    pub cell_rows: u32,
    /// Columns of memory cells per pixel.
    pub cell_columns: u32,
    /// Bytes per pixel of the video frame, 1 or 3.
    pub channels: u32,
    /// Mirroring of the video frame after everything else. Bit 1 mirrors left-right, bit 2 up-down.
    pub flips: u32,
}

impl Args {
    /// Returns the number of rows that the SLM takes of the video frame.
    pub fn area_height(&self) -> usize {
        self.height as usize * self.cell_rows as usize
    }

    /// Returns the number of columns that the SLM takes of the video frame.
    pub fn area_width(&self) -> usize {
        self.width as usize * self.cell_columns as usize
    }
}

/// The place of the SLM's pixels in the video frame, which may be larger than the SLM.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Area {
    /// Rows and columns of the video frame.
    pub frame: [u32; 2],
    /// Row and column of the video frame at which the SLM's pixels begin.
    pub offset: [u32; 2],
    /// Value of each channel of the pixels around the SLM's.
    pub fill: u8,
}

impl Area {
    /// Returns the bytes of a row of the video frame with this number of bytes per pixel, and the bytes in it before
    /// the SLM's pixels.
    pub fn line_bytes(&self, channels: u32) -> [usize; 2] {
        [self.frame[1], self.offset[1]].map(|columns| columns as usize * channels as usize)
    }
}

/// The conversion from the phases of one color to levels.
#[derive(Debug, Clone, PartialEq)]
pub struct Color {
    /// Added to every phase, per pixel of the SLM, in 2^-32 turns. An empty vector adds nothing.
    pub offsets: Vec<u32>,
    /// The levels that the phases are converted to.
    pub levels: Levels,
}

/// The destination of the levels of one sub-frame of one color.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Slot {
    /// Index of the color.
    pub color: usize,
    /// Sub-frame of the color.
    pub sub_frame: usize,
    /// The pieces in which the bits of the level go to the pixel.
    pub parts: Vec<Part>,
}

/// Some bits of a level, and their destination, as in `pixel[cell][channel] |= ((level >> from) & mask) << to`.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
pub struct Part {
    /// Memory cell of the pixel, counted row by row.
    pub cell: u32,
    /// Byte of the pixel.
    pub channel: u32,
    /// First of the bits in the level.
    pub from: u32,
    /// Mask of the bits after the shift to bit 0.
    pub mask: u32,
    /// First of the bits in the byte.
    pub to: u32,
}

/// The plan for encoding the video frames of a set, made before the phases arrive.
#[derive(Debug, Clone, PartialEq)]
pub struct Plan {
    /// Sizes, and the position of the hologram.
    pub args: Args,
    /// The place of the SLM's pixels in the video frame.
    pub area: Area,
    /// Offsets and levels, per color.
    pub colors: Vec<Color>,
    /// The slots of each video frame.
    pub video_frames: Vec<Vec<Slot>>,
    /// Number of sub-frames per color.
    pub sub_frames: usize,
}

/// Working memory for one block.
struct Scratch {
    /// Bytes of the video frame, ordered by cell, channel and pixel.
    planes: [u8; 3 * BLOCK],
    /// Levels, in the first bytes if they have one byte each.
    levels: [u16; BLOCK],
    /// Phases of the block, if they are not contiguous in the sub-frame.
    phases: [f32; SMALL],
}

impl Plan {
    /// Returns the bytes of the rows of the video frame that one row of the SLM is in.
    pub fn row_bytes(&self) -> usize {
        self.args.cell_rows as usize * self.area.line_bytes(self.args.channels)[0]
    }

    /// Returns the rows and columns of the video frame.
    pub fn video_size(&self) -> [usize; 2] {
        self.area.frame.map(|n| n as usize)
    }

    /// Returns true if the SLM's pixels are all of the video frame.
    pub fn fills_frame(&self) -> bool {
        self.video_size() == [self.args.area_height(), self.args.area_width()]
    }
}

/// Encodes the rows of the SLM from row `first` on into one video frame. `out` is the complete rows of the frame that
/// they are in. All bytes of the area are written, and no others.
///
/// `slots` are the slots of the frame. `phases` (sub-frame, row, column) has one slice per color, in the orientation of
/// the hologram.
pub fn encode(
    (args, area): (&Args, &Area),
    colors: &[Color],
    slots: &[Slot],
    phases: &[&[f32]],
    first: usize,
    out: &mut [u8],
) {
    let frame = Frame { args, colors, slots, phases };
    simd(
        #[inline(always)]
        || {
            let mut scratch = Scratch { planes: [0; 3 * BLOCK], levels: [0; BLOCK], phases: [0.0; SMALL] };
            let (height, width) = (args.height as usize, args.width as usize);
            let bytes = args.cell_rows as usize * area.line_bytes(args.channels)[0];
            let rows = out.len() / bytes;
            let yy = (first + args.shift_y as usize) % height;
            // Rows that are contiguous in memory on both sides form one run.
            let plain = args.flips == 0 && args.shift_x == 0 && args.cell_rows * args.cell_columns == 1;
            let plain = plain && area.frame[1] == args.width;
            if plain && args.step_x == 1 && args.step_y == args.width && yy + rows <= height {
                let source = args.first as usize + yy * width;
                for (i, out) in out.chunks_mut(BLOCK * args.channels as usize).enumerate() {
                    let count = out.len() / args.channels as usize;
                    frame.block(first * width + i * BLOCK, Source::Along(source + i * BLOCK), count, &mut scratch);
                    interleave(args, &scratch.planes, count, out);
                }
                return;
            }
            for (row, out) in (first..).zip(out.chunks_exact_mut(bytes)) {
                let y = if args.flips & 2 != 0 { height - 1 - row } else { row };
                for x in (0..width).step_by(SMALL) {
                    let count = SMALL.min(width - x);
                    frame.block(y * width + x, source(args, y, x, count), count, &mut scratch);
                    scatter((args, area), &scratch.planes, x, count, out);
                }
            }
        },
    );
}

/// The location of the phases of a block in a sub-frame.
#[derive(Clone, Copy)]
enum Source {
    /// Contiguous, from this index on.
    Along(usize),
    /// At `row + xx step_x`. `xx` begins at this column and wraps at the edge.
    Scattered { row: u32, column: usize },
}

/// Returns the location of the phases for `count` pixels of row `y`, from column `x` on.
#[inline(always)]
fn source(args: &Args, y: usize, x: usize, count: usize) -> Source {
    let yy = (y + args.shift_y as usize) % args.height as usize;
    let row = args.first.wrapping_add((yy as u32).wrapping_mul(args.step_y));
    let column = (x + args.shift_x as usize) % args.width as usize;
    if args.step_x == 1 && column + count <= args.width as usize {
        return Source::Along(row.wrapping_add(column as u32) as usize);
    }
    Source::Scattered { row, column }
}

/// The input of one video frame.
struct Frame<'a> {
    args: &'a Args,
    colors: &'a [Color],
    slots: &'a [Slot],
    phases: &'a [&'a [f32]],
}

impl Frame<'_> {
    /// Encodes `count` pixels, from pixel `at` of the SLM on, into the planes of the working memory.
    #[inline(always)]
    fn block(&self, at: usize, source: Source, count: usize, scratch: &mut Scratch) {
        let args = self.args;
        let pixels = args.width as usize * args.height as usize;
        let planes = (args.cell_rows * args.cell_columns * args.channels) as usize;
        scratch.planes[..planes * count].fill(0);
        for slot in self.slots {
            let color = &self.colors[slot.color];
            let frame = &self.phases[slot.color][slot.sub_frame * pixels..][..pixels];
            let phases = match source {
                Source::Along(from) => &frame[from..][..count],
                Source::Scattered { row, column } => {
                    let index = |i: usize| (column + i) % args.width as usize;
                    for (i, value) in scratch.phases[..count].iter_mut().enumerate() {
                        *value = frame[row.wrapping_add((index(i) as u32).wrapping_mul(args.step_x)) as usize];
                    }
                    &scratch.phases[..count]
                }
            };
            if self.slots.len() > 1 {
                // There are many streams here. One wait for the memory of all lines of the block takes less time than a
                // wait for each line at its use.
                std::hint::black_box(phases.iter().step_by(LINE).fold(0, |sum: u32, p| sum ^ p.to_bits()));
            }
            let offsets = if color.offsets.is_empty() { &[] } else { &color.offsets[at..at + count] };
            let planes = &mut scratch.planes;
            let plane = |part: &Part| {
                let plane = (part.cell * args.channels + part.channel) as usize * count;
                plane..plane + count
            };
            if color.levels.are_fine() {
                let levels = &mut scratch.levels[..count];
                quantise_fine(&color.levels, phases, offsets, levels);
                for part in &slot.parts {
                    place_fine(part, levels, &mut planes[plane(part)]);
                }
            } else {
                let levels = &mut bytemuck::cast_slice_mut(&mut scratch.levels)[..count];
                quantise(&color.levels, phases, offsets, levels);
                for part in &slot.parts {
                    place(part, levels, &mut planes[plane(part)]);
                }
            }
        }
    }
}

/// ORs some bits of levels into the bytes of pixels.
#[inline(always)]
fn place(part: &Part, levels: &[u8], plane: &mut [u8]) {
    let (from, mask, to) = (part.from & 7, part.mask as u8, part.to & 7);
    if mask == 1 {
        // No processor shifts bytes in SIMD, so one bit is chosen instead.
        let (bit, value) = (1 << from, 1 << to);
        for (byte, level) in plane.iter_mut().zip(levels) {
            *byte |= if level & bit == 0 { 0 } else { value };
        }
    } else if from == 0 && to == 0 {
        for (byte, level) in plane.iter_mut().zip(levels) {
            *byte |= level & mask;
        }
    } else {
        for (byte, level) in plane.iter_mut().zip(levels) {
            *byte |= ((level >> from) & mask) << to;
        }
    }
}

/// ORs some bits of levels of two bytes into the bytes of pixels.
#[inline(always)]
fn place_fine(part: &Part, levels: &[u16], plane: &mut [u8]) {
    let (from, mask, to) = (part.from & 15, part.mask as u8, part.to & 7);
    for (byte, level) in plane.iter_mut().zip(levels) {
        *byte |= ((level >> from) as u8 & mask) << to;
    }
}

/// Copies the bytes of a block into contiguous pixels.
#[inline(always)]
fn interleave(args: &Args, planes: &[u8], count: usize, out: &mut [u8]) {
    if args.channels == 1 {
        return out.copy_from_slice(&planes[..count]);
    }
    let (a, rest) = planes.split_at(count);
    let (b, c) = rest.split_at(count);
    for (((pixel, a), b), c) in out.chunks_exact_mut(3).zip(a).zip(b).zip(c) {
        [pixel[0], pixel[1], pixel[2]] = [*a, *b, *c];
    }
}

/// Copies the bytes of a block into the rows of the video frame, at their cells.
#[inline(always)]
fn scatter((args, area): (&Args, &Area), planes: &[u8], x: usize, count: usize, out: &mut [u8]) {
    let (rows, columns, channels) = (args.cell_rows as usize, args.cell_columns as usize, args.channels as usize);
    let width = args.area_width();
    let [line_bytes, left] = area.line_bytes(args.channels);
    let (mirrored, upside_down) = (args.flips & 1 != 0, args.flips & 2 != 0);
    for cell in 0..rows * columns {
        let (dy, dx) = (cell / columns, cell % columns);
        let dy = if upside_down { rows - 1 - dy } else { dy };
        let line = &mut out[dy * line_bytes + left..][..width * channels];
        let planes = &planes[cell * channels * count..][..channels * count];
        if columns == 1 && !mirrored {
            interleave(args, planes, count, &mut line[x * channels..][..count * channels]);
            continue;
        }
        for i in 0..count {
            let at = (x + i) * columns + dx;
            let at = if mirrored { width - 1 - at } else { at };
            for channel in 0..channels {
                line[at * channels + channel] = planes[channel * count + i];
            }
        }
    }
}
