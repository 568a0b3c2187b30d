//! A hologram as the video frames that a display receives.

use super::{EncodeError, Encoder, PhaseSet, VideoFrames};
use crate::hologram::Hologram;
use crate::optics::Display;

impl Hologram {
    /// Its video frames on a display. For frame after frame make an [`Encoder`] once, and let it encode into memory that is
    /// there.
    ///
    /// # Errors
    /// [`EncodeError::Display`] for colours that have no name or that the display does not have, and for an encoding that
    /// cannot be; [`EncodeError::Mismatch`] for another size; [`EncodeError::Phase`].
    pub fn encode(&self, display: &Display) -> Result<VideoFrames, EncodeError> {
        let colors = self.named_colors();
        if colors.len() != self.colors.len() {
            let reason = "the hologram's colours are not all named".into();
            return Err(EncodeError::Display { display: display.name.clone(), reason });
        }
        let phases: Vec<&[f32]> = self.colors.iter().map(|c| &c.phases[..]).collect();
        let set = PhaseSet::new(&phases, [self.height, self.width])?;
        Encoder::new(display, &colors, self.frames)?.encode(&set)
    }
}
