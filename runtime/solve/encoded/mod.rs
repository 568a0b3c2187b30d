//! Writes holograms as folders of video frames, and reads such folders back.
//!
//! [`Hologram::encode`](crate::hologram::Hologram::encode) makes the video frames of one hologram.
//! [`Encoder::save`](crate::encode::Encoder::save) writes a folder that states its display and what its frames hold; [`Encoded`] reads such
//! a folder, or pictures of any origin, back into a hologram.

mod folder;
mod hologram;

pub use folder::{Encoded, FrameContents, is_encoded, write_powers};
