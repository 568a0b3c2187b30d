//! Writes the composed picture of an eye as a frame of live input on a device. These are linear colors and dioptres in
//! float32. Content that is too near is moved back, and a flag records this.
//!
//! The CPU twin is `Canvas` of `composition` in `tools/openxr`. All values are valid light and dioptres, whatever the
//! picture has.

use bytemuck::{Pod, Zeroable};

/// Layout of the frame.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct Args {
    /// Number of pixels of the picture.
    pub pixels: u32,
    /// The colors of the frame, as 1 red + 2 green + 4 blue.
    pub colors: u32,
    /// First word of the colors.
    pub light: u32,
    /// First word of the dioptres.
    pub depth: u32,
    /// Dioptres of the nearest content.
    pub nearest: f32,
}

/// The brightest light of a frame.
pub const BRIGHTEST: f32 = 65_504.0;
