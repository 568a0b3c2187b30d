//! Writes holograms as folders of video frames, and reads such folders back.
//!
//! [`Hologram::encode`](crate::hologram::Hologram::encode) makes the video frames of one hologram.
//! [`Encoder::save`](crate::encode::Encoder::save) writes a folder that states its display and what its frames hold; [`Encoded`] reads such
//! a folder, or pictures of any origin, back into a hologram.

mod folder;

pub use folder::{Encoded, FrameContents, is_encoded, write_powers};

use crate::encode::{EncodeError, Encoder, PhaseSet, VideoFrames};
use crate::hologram::Hologram;
use crate::optics::Display;
use eyebox_base::reason;

impl Hologram {
    /// Its video frames on a display; of all colours at once, those of the drives that they share. For frame after frame make an [`Encoder`] once, and let it encode into memory that is
    /// there, of its [colours that are sent](Self::sent_colors).
    ///
    /// # Errors
    /// [`EncodeError::Display`] for colours that have no name or that the display does not have, and for an encoding that
    /// cannot be; [`EncodeError::Mismatch`] for another size; [`EncodeError::Phase`].
    pub fn encode(&self, display: &Display) -> Result<VideoFrames, EncodeError> {
        let colors = self.named_colors();
        if colors.len() != self.colors.len() {
            let reason = reason!("colors-not-named", "the hologram's colours are not all named");
            return Err(EncodeError::Display { display: display.name.clone(), reason });
        }
        let (sent, phases) = (self.sent_colors(), self.sent_phases());
        let phases: Vec<&[f32]> = phases.iter().map(|phases| &phases[..]).collect();
        let colors: Vec<_> = sent.iter().map(|i| colors[*i]).collect();
        let set = PhaseSet::new(&phases, [self.height, self.width])?;
        Encoder::new(display, &colors, self.frames)?.encode(&set)
    }
}
