//! What goes in and what comes out: phases that are known to be phases, and video frames.

use super::EncodeError;
use eyebox_kernels::encode::LARGEST_PHASE;
use rayon::prelude::*;

/// The phases of a multiplex set: (sub-frame, row, column) per colour, radians.
#[derive(Debug, Clone, Copy)]
pub struct PhaseSet<'a>(&'a [&'a [f32]]);

impl<'a> PhaseSet<'a> {
    /// Phases of any origin, (row, column) of this size; all of them are looked at.
    ///
    /// # Errors
    /// [`EncodeError::Phase`] for one that is not finite or too large to be told from others.
    pub fn new(colors: &'a [&'a [f32]], [height, width]: [usize; 2]) -> Result<Self, EncodeError> {
        for (color, phases) in colors.iter().enumerate() {
            // Whole parts first: that is a loop without an exit, and fast.
            const PART: usize = 1 << 16;
            let wrong = phases.par_chunks(PART).position_first(|part| {
                eyebox_kernels::simd(
                    #[inline(always)]
                    || part.iter().fold(false, |wrong, p| wrong | !is_phase(*p)),
                )
            });
            if let Some(part) = wrong {
                let at = part * PART + phases[part * PART..].iter().position(|p| !is_phase(*p)).unwrap_or(0);
                let (sub_frame, pixel) = (at / (height * width).max(1), at % (height * width).max(1));
                let (row, column) = (pixel / width.max(1), pixel % width.max(1));
                return Err(EncodeError::Phase { color, sub_frame, row, column, value: phases[at] });
            }
        }
        Ok(Self(colors))
    }

    /// Phases that were checked when they were read, as those of a [`Hologram`](crate::hologram::Hologram) are. Others
    /// make a picture of no meaning, and nothing worse.
    pub fn trusted(colors: &'a [&'a [f32]]) -> Self {
        Self(colors)
    }

    /// (sub-frame, row, column) per colour.
    pub fn colors(&self) -> &'a [&'a [f32]] {
        self.0
    }
}

fn is_phase(value: f32) -> bool {
    value.abs() < LARGEST_PHASE
}

/// Video frames, 8 bits a channel, in the order in which they are shown.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct VideoFrames {
    /// Rows of a frame.
    pub height: usize,
    /// Columns.
    pub width: usize,
    /// 1 (grey) or 3 (red, green, blue).
    pub channels: usize,
    pub(super) bytes: Vec<u8>,
}

impl VideoFrames {
    pub(super) fn new(count: usize, height: usize, width: usize, channels: usize) -> Self {
        Self { height, width, channels, bytes: vec![0; count * height * width * channels] }
    }

    /// How many.
    pub fn count(&self) -> usize {
        self.bytes.len() / self.frame_bytes()
    }

    /// Bytes of one.
    pub fn frame_bytes(&self) -> usize {
        self.height * self.width * self.channels
    }

    /// One of them: (row, column, channel).
    pub fn frame(&self, index: usize) -> &[u8] {
        &self.bytes[index * self.frame_bytes()..][..self.frame_bytes()]
    }

    /// All of them, one after the other.
    pub fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// All of them, to be filled by an encoder of another kind.
    pub fn bytes_mut(&mut self) -> &mut [u8] {
        &mut self.bytes
    }

    /// The name of a frame's file.
    pub fn file_name(index: usize) -> String {
        format!("frame-{index:05}.png")
    }
}
