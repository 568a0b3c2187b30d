//! Converts video frames back to the phases that the SLM shows, or to the phases of the encoded hologram.

use super::encoder::scale;
use super::turning::Turning;
use super::{EncodeError, Encoder, PackedSlot, VideoFrames, correction, levels};
use crate::optics::wrap_phase;
use crate::optics::{Color, Display};
use eyebox_base::{Reason, reason};
use rayon::prelude::*;

/// The steps of encoding that decoding does not undo. The default undoes all of them. Then the result is the encoded
/// hologram, in the SLM's levels.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct AsShown {
    /// Gratings stay, and the light goes to their direction, which in a relay is another part of the eyebox.
    pub gratings: bool,
    /// Wavefront corrections stay, as for an SLM that is flat already.
    pub corrections: bool,
    /// Flip, rotation and offset stay, so that phases are on the SLM's pixels.
    pub turns: bool,
}

impl AsShown {
    /// The names of the steps.
    pub const PARTS: [&'static str; 3] = ["gratings", "corrections", "turns"];

    /// Selects a step that stays, by its name, or `all`. Returns false if the name is unknown.
    pub fn leave(&mut self, part: &str) -> bool {
        match part {
            "gratings" => self.gratings = true,
            "corrections" => self.corrections = true,
            "turns" => self.turns = true,
            "all" => *self = Self { gratings: true, corrections: true, turns: true },
            _ => return false,
        }
        true
    }
}

/// Converts video frames of one display back into phases.
#[derive(Debug, Clone)]
pub struct Decoder {
    encoder: Encoder,
    turning: Turning,
    keeps_turns: bool,
    of_colors: Vec<OfColor>,
}

/// The decoding of one color.
#[derive(Debug, Clone)]
struct OfColor {
    /// The phase of every code up to the highest, in 2^-32 turns.
    phases: Vec<Option<u32>>,
    /// Phases to subtract from every pixel of the SLM, in 2^-32 turns. It is empty if there are none.
    undone: Vec<u32>,
}

/// A bit of a level's code, and its position in a pixel of the video frame.
struct Bit {
    cell: [usize; 2],
    channel: usize,
    to: u8,
    of_code: u8,
}

impl Decoder {
    /// Creates a decoder for sets of these colors with `sub_frames` each. It reads the display's calibration.
    ///
    /// # Errors
    /// Returns the errors of [`Encoder::new`].
    pub fn new(display: &Display, colors: &[Color], sub_frames: usize, left: AsShown) -> Result<Self, EncodeError> {
        let encoder = Encoder::new(display, colors, sub_frames)?;
        let turning = Turning::new(&display.encoding, display.height, display.width);
        let mut undone = display.clone();
        if left.gratings {
            undone.encoding.grating.clear();
        }
        if left.corrections {
            undone.encoding.correction.clear();
        }
        let of_color = |&color: &Color| {
            let phases = levels::phases(&scale(display, color)?, &display.encoding.codes);
            let phases = phases.into_iter().map(|turns| turns.map(correction::units)).collect();
            Ok(OfColor { phases, undone: correction::offsets(&undone, color, &turning)? })
        };
        let of_colors = colors.iter().map(of_color).collect::<Result<_, EncodeError>>()?;
        Ok(Self { encoder, turning, keeps_turns: left.turns, of_colors })
    }

    /// Returns the encoder whose inverse it is, with the number, size and content of frames.
    pub fn encoder(&self) -> &Encoder {
        &self.encoder
    }

    /// Returns the rows and columns of the decoded phases, which are the hologram's, or the SLM's if turns stay.
    pub fn size(&self) -> [usize; 2] {
        let display = &self.encoder.display;
        if self.keeps_turns { [display.height, display.width] } else { self.encoder.hologram_size() }
    }

    /// Returns the phases of a set, (sub-frame, row, column) per color, in radians in [-pi, pi). `name` returns the
    /// name of a frame for errors.
    ///
    /// # Errors
    /// Returns [`EncodeError::Mismatch`] for frames of another shape. Returns [`EncodeError::Frame`] if a frame holds a
    /// code that is not a level of the display, or light in bits that its packing leaves black.
    pub fn decode(
        &self,
        frames: &VideoFrames,
        name: impl Fn(usize) -> String + Sync,
    ) -> Result<Vec<Vec<f32>>, EncodeError> {
        self.encoder.check_frames(frames)?;
        let packed = self.encoder.packed();
        for index in 0..packed.video_frames {
            self.check_unused(frames, index).map_err(|reason| EncodeError::Frame { frame: name(index), reason })?;
        }
        let [height, width] = self.size();
        let decoded: Result<Vec<_>, EncodeError> = (packed.slots.par_iter())
            .map(|slot| {
                let wrong = |reason| EncodeError::Frame { frame: name(slot.video_frame), reason };
                self.slot(slot, frames.frame(slot.video_frame)).map_err(wrong)
            })
            .collect();
        let mut phases = vec![vec![0.0; packed.sub_frames * height * width]; self.of_colors.len()];
        for (slot, decoded) in packed.slots.iter().zip(decoded?) {
            phases[slot.color][slot.sub_frame * height * width..][..height * width].copy_from_slice(&decoded);
        }
        Ok(phases)
    }

    /// Decodes the phases of one sub-frame.
    fn slot(&self, slot: &PackedSlot, frame: &[u8]) -> Result<Vec<f32>, Reason> {
        let OfColor { phases, undone } = &self.of_colors[slot.color];
        let bits = self.bits(slot);
        let (height, width) = (self.encoder.display.height, self.encoder.display.width);
        let columns = self.size()[1];
        let mut out = vec![0.0; height * width];
        for y in 0..height {
            for x in 0..width {
                let bit = |b: &Bit| u16::from(frame[self.byte([y, x], b.cell, b.channel)] >> b.to & 1) << b.of_code;
                let code = bits.iter().fold(0, |code, b| code | bit(b));
                let units = phases
                    .get(usize::from(code))
                    .copied()
                    .flatten()
                    .ok_or_else(|| self.no_level(slot, code, [y, x]))?;
                let units = units.wrapping_sub(undone.get(y * width + x).copied().unwrap_or(0));
                let [row, column] = if self.keeps_turns { [y, x] } else { self.turning.source(y, x) };
                // The upper half of a turn is its negative half.
                let turns = f64::from(units as i32) / 4_294_967_296.0;
                out[row * columns + column] = wrap_phase((turns * std::f64::consts::TAU) as f32);
            }
        }
        Ok(out)
    }

    fn no_level(&self, slot: &PackedSlot, code: u16, [y, x]: [usize; 2]) -> Reason {
        let (color, display) = (self.encoder.colors()[slot.color], &self.encoder.display);
        reason!(
            "no-level",
            "{color} sub-frame {} holds {code} at the SLM's row {y}, column {x}, which is not a level of the \
             display '{}'. Set `display` to the display of the encoding",
            slot.sub_frame,
            display.name
        )
    }

    /// Returns the positions of a slot's bits.
    fn bits(&self, slot: &PackedSlot) -> Vec<Bit> {
        let place = |cell, bit: u8, of_code| Bit { cell, channel: usize::from(bit / 8), to: bit % 8, of_code };
        let cells = &self.encoder.display.encoding.cells;
        if cells.is_empty() {
            return slot.bits.iter().zip(0..).map(|(&bit, of_code)| place([0, 0], bit, of_code)).collect();
        }
        let row = |(dy, row): (usize, &Vec<u8>)| {
            let cell = |(dx, of_code): (usize, &u8)| place([dy, dx], slot.bits[0], *of_code);
            row.iter().enumerate().map(cell).collect::<Vec<_>>()
        };
        cells.iter().enumerate().flat_map(row).collect()
    }

    /// Returns the index of a byte of the video frame, for a cell of an SLM pixel and a channel.
    fn byte(&self, [y, x]: [usize; 2], [dy, dx]: [usize; 2], channel: usize) -> usize {
        let (args, flip) = (&self.encoder.plan().args, self.encoder.display.encoding.flip_video);
        let (height, width) = (args.area_height(), args.area_width());
        let (row, column) = (y * args.cell_rows as usize + dy, x * args.cell_columns as usize + dx);
        let row = if flip.overturns() { height - 1 - row } else { row };
        let column = if flip.mirrors() { width - 1 - column } else { column };
        let area = &self.encoder.plan().area;
        let [line, left] = area.line_bytes(args.channels);
        (area.offset[0] as usize + row) * line + left + column * args.channels as usize + channel
    }

    /// Refuses light in bits that the packing leaves black. Then the frame is of another packing or display. Pixels
    /// outside the SLM may have any light, because nobody sees it.
    fn check_unused(&self, frames: &VideoFrames, index: usize) -> Result<(), Reason> {
        let mut used = vec![0u8; frames.channels];
        for bit in self.encoder.packed().slots.iter().filter(|s| s.video_frame == index).flat_map(|s| &s.bits) {
            used[usize::from(bit / 8)] |= 1 << (bit % 8);
        }
        let plan = self.encoder.plan();
        let [top, left] = plan.area.offset.map(|n| n as usize);
        let (rows, columns) = (top..top + plan.args.area_height(), left..left + plan.args.area_width());
        let whole = plan.fills_frame();
        let within = |i: usize| whole || rows.contains(&(i / frames.width)) && columns.contains(&(i % frames.width));
        let lit = frames.frame(index).chunks_exact(frames.channels).enumerate().filter(|(i, _)| within(*i));
        let mut stray =
            lit.flat_map(|(i, pixel)| pixel.iter().zip(&used).enumerate().map(move |(c, (b, u))| (i, c, b & !u)));
        let Some((at, channel, bits)) = stray.find(|(_, _, bits)| *bits != 0) else { return Ok(()) };
        let channel = if frames.channels == 1 { "grey" } else { ["red", "green", "blue"][channel] };
        let (row, column) = (at / frames.width, at % frames.width);
        Err(reason!(
            "lit-bit",
            "bit {} of {channel} is lit at row {row}, column {column}, but the packing of the display '{}' leaves \
             it black. Set `display` to the display of the encoding",
            bits.trailing_zeros(),
            self.encoder.display.name
        ))
    }
}
