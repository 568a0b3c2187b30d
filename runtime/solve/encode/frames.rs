//! Holds the input of encoding, which is checked phases, and its output, which is video frames.

use super::EncodeError;
use eyebox_kernels::encode::LARGEST_PHASE;
use rayon::prelude::*;

/// The phases of a multiplex set in radians, (sub-frame, row, column) per color.
#[derive(Debug, Clone, Copy)]
pub struct PhaseSet<'a>(&'a [&'a [f32]]);

impl<'a> PhaseSet<'a> {
    /// Checks all phases of any origin, (row, column) of this size.
    ///
    /// # Errors
    /// Returns [`EncodeError::Phase`] for a phase that is not finite or too large for the resolution of float32.
    pub fn new(colors: &'a [&'a [f32]], [height, width]: [usize; 2]) -> Result<Self, EncodeError> {
        for (color, phases) in colors.iter().enumerate() {
            // Whole parts come first, because a loop without an exit is fast.
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

    /// Accepts phases that were checked when they were read, such as the phases of a
    /// [`Hologram`](crate::hologram::Hologram). Unchecked phases make a meaningless picture, and nothing worse.
    pub fn trusted(colors: &'a [&'a [f32]]) -> Self {
        Self(colors)
    }

    /// Returns the phases (sub-frame, row, column) per color.
    pub fn colors(&self) -> &'a [&'a [f32]] {
        self.0
    }
}

fn is_phase(value: f32) -> bool {
    value.abs() < LARGEST_PHASE
}

/// Video frames with 8 bits per channel, in the order in which they are shown.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct VideoFrames {
    /// Rows of a frame.
    pub height: usize,
    /// Columns of a frame.
    pub width: usize,
    /// Channels of a frame, 1 (gray) or 3 (red, green, blue).
    pub channels: usize,
    pub(super) bytes: Vec<u8>,
}

impl VideoFrames {
    /// Returns frames of zeros.
    pub fn dark(count: usize, height: usize, width: usize, channels: usize) -> Self {
        Self { height, width, channels, bytes: vec![0; count * height * width * channels] }
    }

    /// Returns the number of frames.
    pub fn count(&self) -> usize {
        self.bytes.len() / self.frame_bytes()
    }

    /// Returns the bytes of one frame.
    pub fn frame_bytes(&self) -> usize {
        self.height * self.width * self.channels
    }

    /// Returns one of the frames, (row, column, channel).
    pub fn frame(&self, index: usize) -> &[u8] {
        &self.bytes[index * self.frame_bytes()..][..self.frame_bytes()]
    }

    /// Returns all frames, one after the other.
    pub fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// Returns all frames, to be filled by an encoder of another kind.
    pub fn bytes_mut(&mut self) -> &mut [u8] {
        &mut self.bytes
    }

    /// Returns the name of a frame's file.
    pub fn file_name(index: usize) -> String {
        format!("frame-{index:05}.png")
    }
}
