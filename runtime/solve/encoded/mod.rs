//! Holograms as video frames, and folders of video frames as holograms.
//!
//! [`Hologram::encode`](crate::hologram::Hologram::encode) makes the video frames of one hologram.
//! [`Encoder::save`](crate::encode::Encoder::save) writes a folder that states its display and what its frames hold; [`Encoded`] reads such
//! a folder, or pictures of any origin, back into a hologram.
//!
//! May import `encode` and `hologram`, and everything that they may.

mod folder;
mod hologram;

pub use folder::{Encoded, FrameContents, is_encoded, write_powers};
