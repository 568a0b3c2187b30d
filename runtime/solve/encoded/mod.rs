//! Writes holograms as folders of video frames, and reads such folders back.
//!
//! [`Hologram::encode`](crate::hologram::Hologram::encode) makes the video frames of one hologram.
//! [`Encoder::save`](crate::encode::Encoder::save) writes a folder with the display and the contents of the frames.
//! [`Encoded`] reads such a folder, or pictures of any origin, back into a hologram.

mod folder;

pub use folder::{Encoded, FrameContents, is_encoded, write_powers};

use crate::encode::{EncodeError, Encoder, PhaseSet, VideoFrames};
use crate::hologram::Hologram;
use crate::optics::Display;
use eyebox_base::reason;

impl Hologram {
    /// Returns its video frames on a display. For simultaneous color they are the frames of the drives that the colors
    /// share. To encode many holograms, make an [`Encoder`] of its [sent colors](Self::sent_colors) once, and encode
    /// into existing memory.
    ///
    /// # Errors
    /// Returns [`EncodeError::Display`] for colors that have no name or that the display does not have, and for an
    /// impossible encoding. Returns [`EncodeError::Mismatch`] for another size, or [`EncodeError::Phase`].
    pub fn encode(&self, display: &Display) -> Result<VideoFrames, EncodeError> {
        let colors = self.named_colors();
        if colors.len() != self.colors.len() {
            let reason = reason!("colors-not-named", "not all colors of the hologram have names");
            return Err(EncodeError::Display { display: display.name.clone(), reason });
        }
        let (sent, phases) = (self.sent_colors(), self.sent_phases());
        let phases: Vec<&[f32]> = phases.iter().map(|phases| &phases[..]).collect();
        let colors: Vec<_> = sent.iter().map(|i| colors[*i]).collect();
        let set = PhaseSet::new(&phases, [self.height, self.width])?;
        Encoder::new(display, &colors, self.frames)?.encode(&set)
    }
}
