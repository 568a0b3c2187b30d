//! Encodes phases with a plan that is computed once per display and shape.

use super::levels::{Scale, levels};
use super::turning::Turning;
use super::{EncodeError, Lighting, Packed, PackedSlot, PhaseSet, VideoFrames, calibration, correction};
use crate::optics::{ActiveArea, Color, Display, Encoding, TwoPi};
use eyebox_base::{Reason, reason};
use eyebox_kernels::encode::{self, Area, Args, Part, Plan, Slot};
use rayon::prelude::*;

/// Converts multiplex sets of one shape into video frames of one display.
#[derive(Debug, Clone)]
pub struct Encoder {
    pub(super) display: Display,
    colors: Vec<Color>,
    packed: Packed,
    hologram: [usize; 2],
    plan: Plan,
    notes: Vec<String>,
}

impl Encoder {
    /// Creates an encoder for sets of these colors with `sub_frames` each. It reads the display's calibration.
    ///
    /// # Errors
    /// - [`EncodeError::Mismatch`] if the packing holds another number of colors or sub-frames.
    /// - [`EncodeError::Display`] if the encoding contradicts itself or lacks a color's calibration.
    /// - [`EncodeError::File`] and [`EncodeError::Table`] for calibration files.
    pub fn new(display: &Display, colors: &[Color], sub_frames: usize) -> Result<Self, EncodeError> {
        let wrong = |reason| EncodeError::Display { display: display.name.clone(), reason };
        let mismatch = |reason| EncodeError::Mismatch { display: display.name.clone(), reason };
        let (encoding, height, width) = (&display.encoding, display.height, display.width);
        let Some(pixels) = (height.checked_mul(width)).filter(|n| (1..=1 << 32).contains(n)) else {
            return Err(wrong(reason!("size", "it has {height}x{width} pixels, but each axis must be 1 to 65536")));
        };
        if let Some(color) = colors.iter().find(|c| !display.wavelengths.iter().any(|w| w.color == **c)) {
            let has: Vec<_> = display.wavelengths.iter().map(|w| w.color.to_string()).collect();
            let has = has.join(", ");
            return Err(mismatch(reason!("no-such-color", "it has the color {color}, but the display has only {has}")));
        }
        let area = area(encoding, [height, width]).map_err(wrong)?;
        let packed = Packed::new(encoding, colors, sub_frames).map_err(mismatch)?;
        let turning = Turning::new(encoding, height, width);
        let (mut of_colors, mut notes) = (Vec::new(), Vec::new());
        let mut codes = 0;
        for &color in colors {
            let (levels, note) = levels(&scale(display, color)?, &encoding.codes);
            if let Some(note) = note {
                tracing::warn!("{color}: {note}");
                notes.push(format!("{color}: {note}"));
            }
            codes = codes.max(levels.highest());
            of_colors.push(encode::Color { offsets: correction::offsets(display, color, &turning)?, levels });
        }
        let cells: Vec<u8> = encoding.cells.concat();
        let bits = 32 - codes.leading_zeros();
        let mut video_frames = vec![Vec::new(); packed.video_frames];
        for s in &packed.slots {
            let parts = parts(s, &cells, bits).map_err(wrong)?;
            video_frames[s.video_frame].push(Slot { color: s.color, sub_frame: s.sub_frame, parts });
        }
        let [first, step_y, step_x] = turning.steps();
        let args = Args {
            height: height as u32,
            width: width as u32,
            first,
            step_y,
            step_x,
            shift_y: turning.shift[0] as u32,
            shift_x: turning.shift[1] as u32,
            cell_rows: encoding.cells.len().max(1) as u32,
            cell_columns: encoding.cells.first().map_or(1, Vec::len) as u32,
            channels: packed.channels as u32,
            flips: u32::from(encoding.flip_video.mirrors()) + 2 * u32::from(encoding.flip_video.overturns()),
        };
        // Every buffer of a set can be counted in usize.
        let plan = Plan { args, area, colors: of_colors, video_frames, sub_frames };
        let rows = area.frame[0] as usize;
        let most = rows.checked_mul(plan.row_bytes()).and_then(|n| n.checked_mul(packed.video_frames));
        if most.is_none() || pixels.checked_mul(size_of::<f32>()).is_none() {
            return Err(wrong(reason!(
                "too-many-frames",
                "{} video frames of that size do not fit into memory",
                packed.video_frames
            )));
        }
        Ok(Self { display: display.clone(), colors: colors.to_vec(), packed, hologram: turning.hologram, plan, notes })
    }

    /// Returns the rows and columns of its holograms, which are the SLM's before rotation.
    pub fn hologram_size(&self) -> [usize; 2] {
        self.hologram
    }

    /// Returns the display for which it encodes.
    pub fn display(&self) -> &Display {
        &self.display
    }

    /// Returns the plan for the kernel.
    pub fn plan(&self) -> &Plan {
        &self.plan
    }

    /// Returns the colors in the order of a set.
    pub fn colors(&self) -> &[Color] {
        &self.colors
    }

    /// Returns the times at which the sub-frames of a set are lit, in the order of the packing. If `rolls`, sets are
    /// rolling updates, otherwise they are shown whole.
    pub fn lighting(&self, rolls: bool) -> Lighting {
        Lighting::of(&self.packed, rolls)
    }

    /// Returns the position of every sub-frame.
    pub fn packed(&self) -> &Packed {
        &self.packed
    }

    /// Returns notes for the user about the calibration, in sentences.
    pub fn notes(&self) -> &[String] {
        &self.notes
    }

    /// Returns empty video frames for a set.
    pub fn frames(&self) -> VideoFrames {
        let [count, height, width, channels] = self.video_shape();
        VideoFrames::dark(count, height, width, channels)
    }

    /// Encodes a set into new frames.
    ///
    /// # Errors
    /// Returns the errors of [`encode_into`](Self::encode_into).
    pub fn encode(&self, phases: &PhaseSet<'_>) -> Result<VideoFrames, EncodeError> {
        let mut frames = self.frames();
        self.encode_into(phases, &mut frames)?;
        Ok(frames)
    }

    /// Encodes a set into frames of [`frames`](Self::frames), with every byte written, on all threads of the current
    /// pool. It allocates nothing when it is called from a thread of that pool.
    ///
    /// # Errors
    /// Returns [`EncodeError::Mismatch`] for phases or frames of another shape. Then nothing was written.
    pub fn encode_into(&self, phases: &PhaseSet<'_>, frames: &mut VideoFrames) -> Result<(), EncodeError> {
        self.check(phases, frames)?;
        self.fill(phases, &mut frames.bytes);
        Ok(())
    }

    /// Encodes a set into memory of the caller, which has the length of [`VideoFrames::bytes`].
    ///
    /// # Errors
    /// Returns [`EncodeError::Mismatch`] for phases of another shape or memory of another length. Then nothing was
    /// written.
    pub fn encode_bytes(&self, phases: &PhaseSet<'_>, out: &mut [u8]) -> Result<(), EncodeError> {
        self.check_phases(phases)?;
        let wanted = self.bytes();
        if out.len() != wanted {
            let reason = reason!("frames-length", "its video frames take {wanted} bytes, but there are {}", out.len());
            return Err(EncodeError::Mismatch { display: self.display.name.clone(), reason });
        }
        self.fill(phases, out);
        Ok(())
    }

    /// Returns the bytes of a set's video frames.
    pub fn bytes(&self) -> usize {
        self.video_shape().iter().product()
    }

    /// Returns the number of video frames of a set, and their rows, columns and channels.
    pub fn video_shape(&self) -> [usize; 4] {
        let [height, width] = self.plan.video_size();
        [self.packed.video_frames, height, width, self.packed.channels]
    }

    fn fill(&self, phases: &PhaseSet<'_>, bytes: &mut [u8]) {
        let Plan { args, area, colors, video_frames, .. } = &self.plan;
        let phases = phases.colors();
        let row = self.plan.row_bytes();
        let height = args.height as usize;
        // Several blocks of the kernel run in one task.
        let rows = (4 * encode::BLOCK).div_ceil(args.width as usize).min(height);
        let [line, _] = area.line_bytes(args.channels);
        let frame = area.frame[0] as usize * line;
        let above = area.offset[0] as usize * line;
        bytes.par_chunks_exact_mut(frame).zip(video_frames).for_each(|(frame, slots)| {
            let (above, rest) = frame.split_at_mut(above);
            let (slm, below) = rest.split_at_mut(row * height);
            above.fill(area.fill);
            below.fill(area.fill);
            slm.par_chunks_mut(row * rows).enumerate().for_each(|(share, out)| {
                if area.frame[1] as usize > args.area_width() {
                    out.fill(area.fill);
                }
                encode::encode((args, area), colors, slots, phases, share * rows, out);
            });
        });
    }

    /// Checks that phases and frames have this encoder's shape.
    ///
    /// # Errors
    /// Returns [`EncodeError::Mismatch`] for another shape.
    pub fn check(&self, phases: &PhaseSet<'_>, frames: &VideoFrames) -> Result<(), EncodeError> {
        self.check_phases(phases)?;
        self.check_frames(frames)
    }

    fn check_phases(&self, phases: &PhaseSet<'_>) -> Result<(), EncodeError> {
        let wrong = |reason| Err(EncodeError::Mismatch { display: self.display.name.clone(), reason });
        let phases = phases.colors();
        if phases.len() != self.colors.len() {
            return wrong(reason!("colors-count", "it has {} colors, not {}", phases.len(), self.colors.len()));
        }
        let [height, width] = self.hologram;
        let expected = self.plan.sub_frames * height * width;
        if let Some((i, p)) = phases.iter().enumerate().find(|(_, p)| p.len() != expected) {
            let count = self.plan.sub_frames;
            return wrong(reason!(
                "phases-count",
                "color {i} has {} phases, not {count} x {height} x {width}",
                p.len()
            ));
        }
        Ok(())
    }

    /// Checks that frames have this encoder's shape.
    ///
    /// # Errors
    /// Returns [`EncodeError::Mismatch`] for another shape.
    pub(super) fn check_frames(&self, frames: &VideoFrames) -> Result<(), EncodeError> {
        let [count, height, width, channels] = self.video_shape();
        let size = (height, width, channels);
        if (frames.height, frames.width, frames.channels) != size || frames.bytes.len() != count * frames.frame_bytes()
        {
            let reason = reason!("other-encoder", "the video frames were made for another encoder");
            return Err(EncodeError::Mismatch { display: self.display.name.clone(), reason });
        }
        Ok(())
    }
}

/// Returns the place of an SLM of this size in the video frame.
fn area(encoding: &Encoding, size: [usize; 2]) -> Result<Area, Reason> {
    let ActiveArea { video_size, offset, fill } = encoding.area(size)?;
    let [frame, offset] = [video_size, offset].map(|sides| sides.map(|n| n as u32));
    Ok(Area { frame, offset, fill })
}

/// Returns the phases of the levels at one color.
pub(super) fn scale(display: &Display, color: Color) -> Result<Scale, EncodeError> {
    let wrong = |reason| EncodeError::Display { display: display.name.clone(), reason };
    let (encoding, levels) = (&display.encoding, display.levels);
    let given = [!encoding.look_up.is_empty(), !encoding.phases_turns.is_empty(), encoding.two_pi_level.is_some()];
    if given.iter().filter(|g| **g).count() > 1 {
        return Err(wrong(reason!(
            "two-tables",
            "look_up, phases_turns and two_pi_level exclude each other. Give one"
        )));
    }
    if levels > 65536 {
        return Err(wrong(reason!("levels", "it has {levels} levels, but a video frame carries at most 65536")));
    }
    let missing = |what: &str| wrong(reason!("no-table", "it has {what} for other colors, but none for {color}"));
    if !encoding.look_up.is_empty() {
        let file = encoding.look_up.get(&color).ok_or_else(|| missing("a look_up table"))?;
        return Ok(Scale::Listed(calibration::read_table(file, levels)?));
    }
    if !encoding.phases_turns.is_empty() {
        return Ok(Scale::Listed((0..=u16::MAX).zip(encoding.phases_turns.iter().copied()).collect()));
    }
    let two_pi = match &encoding.two_pi_level {
        None => f64::from(levels),
        Some(TwoPi::One(level)) => *level,
        Some(TwoPi::Each(each)) => *each.get(&color).ok_or_else(|| missing("a two_pi_level"))?,
    };
    Ok(Scale::Even { two_pi, levels })
}

/// Returns the pieces of a slot's bits. They are runs of neighboring bits of one channel, or one bit of each cell.
fn parts(slot: &PackedSlot, cells: &[u8], bits: u32) -> Result<Vec<Part>, Reason> {
    let part = |cell: usize, from: u32, bit: u8| Part {
        cell: cell as u32,
        channel: u32::from(bit / 8),
        from,
        mask: 1,
        to: u32::from(bit % 8),
    };
    if !cells.is_empty() {
        let [bit] = slot.bits[..] else {
            return Err(reason!(
                "cells-and-bits",
                "pixels of several cells take one bit of the video frame each. Use planes24, planes8 or a map of \
                 single bits"
            ));
        };
        if let Some(lost) = (0..bits as u8).find(|b| !cells.contains(b)) {
            return Err(reason!("lost-bit", "its codes have {bits} bits, but no cell holds bit {lost}"));
        }
        return Ok(cells.iter().enumerate().map(|(cell, from)| part(cell, u32::from(*from), bit)).collect());
    }
    if bits as usize > slot.bits.len() {
        return Err(reason!(
            "bits",
            "its levels need {bits} bits, but the packing has {} for each sub-frame. Set levels = {}",
            slot.bits.len(),
            1u32 << slot.bits.len()
        ));
    }
    let mut parts: Vec<Part> = Vec::new();
    for (from, &bit) in (0..bits).zip(&slot.bits) {
        match parts.last_mut() {
            Some(p) if p.channel == u32::from(bit / 8) && p.to + from - p.from == u32::from(bit % 8) => {
                p.mask = 2 * p.mask + 1;
            }
            _ => parts.push(part(0, from, bit)),
        }
    }
    Ok(parts)
}
