//! Converts phases to the bytes that the SLM receives, by calibration, levels and packing.
//!
//! An [`Encoder`] is made once for a display. It reads the calibration and builds the tables. Then
//! [`Encoder::encode_into`] converts the phases of a multiplex set ([`PhaseSet`]) into its video frames
//! ([`VideoFrames`]) without allocation. The steps are in this order:
//!
//! - The wavefront corrections are added as phase, then the gratings.
//! - The hologram is flipped, rotated and moved.
//! - Phases wrap.
//! - Each phase becomes the nearest level. The level after the last is level 0.
//! - The level's bits are written to the bits of the packing.
//!
//! `packing` chooses the bits, `turning` the phase of each pixel, and `levels` the level of each phase. `calibration`
//! and `correction` read files. All of it is fixed before the first phase, as a [`Plan`] for the kernel `encode`. This
//! module runs the kernel on the CPU, the Vulkan engine runs it on a device, and both give the same bytes.
//!
//! A [`Decoder`] is the inverse. It converts video frames to the phases that they show, from a folder that this program
//! wrote or from pictures of any origin ([`Encoded`](crate::encoded::Encoded)).

mod calibration;
mod correction;
mod decoder;
mod encoder;
mod frames;
mod levels;
mod lighting;
mod packing;
mod turning;

#[cfg(test)]
pub(crate) mod tests;

pub use decoder::{AsShown, Decoder};
pub use encoder::Encoder;
pub use eyebox_kernels::encode::Plan;
pub use frames::{PhaseSet, VideoFrames};
pub use lighting::{Lighting, LitTimes, flicker};
pub use packing::{Packed, PackedSlot};

use crate::files::FileError;
use eyebox_base::error::Reason;

/// An error of an encoding, its calibration, or the phases given to it.
#[derive(Debug, thiserror::Error, serde::Serialize)]
#[serde(tag = "code", content = "fields", rename_all = "kebab-case")]
#[non_exhaustive]
pub enum EncodeError {
    /// A calibration file could not be read, or video frames could not be written.
    #[error(transparent)]
    File(#[from] FileError),
    /// A line of a table is wrong.
    #[error("{file}, line {line}: {reason}")]
    Table {
        /// The path of the file.
        file: String,
        /// The number of the line, from 1.
        line: usize,
        /// The problem of the line, and a correct form.
        reason: Reason,
    },
    /// The display's encoding contradicts itself, or does not fit these colors.
    #[error("the display '{display}': {reason}")]
    Display {
        /// The name of the display.
        display: String,
        /// The problem, and a correct form.
        reason: Reason,
    },
    /// The phases have another size, or another number of colors or sub-frames.
    #[error("the hologram does not fit the display '{display}': {reason}")]
    Mismatch {
        /// The name of the display.
        display: String,
        /// The size found, and the correct size.
        reason: Reason,
    },
    /// No encoder makes these video frames for this display.
    #[error("{frame}: {reason}")]
    Frame {
        /// The frame's file, or its number.
        frame: String,
        /// The problem, its position, and the remedy.
        reason: Reason,
    },
    /// A phase is not finite or too large.
    #[error(
        "the phase at color {color}, sub-frame {sub_frame}, row {row}, column {column} is {value}, but it must be \
         finite and below 4194304 radians, because float32 does not resolve larger phases"
    )]
    Phase {
        /// Index of the color.
        color: usize,
        /// Index of the sub-frame.
        sub_frame: usize,
        /// Row of the hologram.
        row: usize,
        /// Column of the hologram.
        column: usize,
        /// The value of the phase.
        value: f32,
    },
}
