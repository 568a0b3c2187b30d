//! Converts phases to the bytes that the SLM receives: calibration, levels, packing.
//!
//! An [`Encoder`] is made once for a display, its calibration read and its tables built; then
//! [`Encoder::encode_into`] turns the phases of a multiplex set ([`PhaseSet`]) into its video frames
//! ([`VideoFrames`]), without allocating. In this order: the wavefront corrections are added as phase, then the
//! gratings; the hologram is flipped, rotated and moved; phases wrap; the nearest level is taken (the level after the
//! last is level 0); the level's bits go where the packing says.
//!
//! `packing` decides which bits that is, `turning` which pixel shows which phase, `levels` which level a phase becomes,
//! `calibration` and `correction` read files. All of it is decided before a phase is seen, as a [`Plan`] for the
//! kernel `encode`; this room runs it on the CPU, the Vulkan engine on a device,
//! and both give the same bytes. A [`Decoder`] is its inverse: video frames to the phases that they show, of a folder that this
//! program wrote or of pictures of any origin ([`Encoded`](crate::encoded::Encoded)).

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

/// What can be wrong with an encoding, its calibration, or the phases given to it.
#[derive(Debug, thiserror::Error, serde::Serialize)]
#[serde(tag = "code", content = "fields", rename_all = "kebab-case")]
#[non_exhaustive]
pub enum EncodeError {
    /// A calibration file could not be read, or video frames not be written.
    #[error(transparent)]
    File(#[from] FileError),
    /// A line of a table that cannot be.
    #[error("{file}, line {line}: {reason}")]
    Table {
        /// The file.
        file: String,
        /// Its line, from 1.
        line: usize,
        /// What is wrong, and what would be right.
        reason: Reason,
    },
    /// The display's encoding contradicts itself, or does not fit these colours.
    #[error("the display '{display}': {reason}")]
    Display {
        /// Its name.
        display: String,
        /// What is wrong, and what would be right.
        reason: Reason,
    },
    /// Phases of another size, or another number of colours or sub-frames.
    #[error("the hologram does not fit the display '{display}': {reason}")]
    Mismatch {
        /// The display's name.
        display: String,
        /// What is there, and what would be right.
        reason: Reason,
    },
    /// Video frames that no encoder makes for this display.
    #[error("{frame}: {reason}")]
    Frame {
        /// The frame's file, or its number.
        frame: String,
        /// What is wrong with it, where, and what would be right.
        reason: Reason,
    },
    /// A phase that is none.
    #[error(
        "the phase at colour {color}, sub-frame {sub_frame}, row {row}, column {column} is {value}: it must be finite and \
         below 4194304 radians, for float32 tells phases beyond that no more apart"
    )]
    Phase {
        /// Index of the colour.
        color: usize,
        /// Index of the sub-frame.
        sub_frame: usize,
        /// Row of the hologram.
        row: usize,
        /// Column of it.
        column: usize,
        /// What it is.
        value: f32,
    },
}
