//! Defines the pictures of a comparison.

use eyebox::low_level::optics::Color;
use serde::{Deserialize, Serialize};

/// A picture that is ready for a page.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Picture {
    /// The width in pixels.
    pub width: usize,
    /// The height in pixels.
    pub height: usize,
    /// The PSNR over all colors, in dB, for a scored reconstruction.
    pub psnr: Option<f64>,
    /// The picture as a `data:` address.
    pub data: String,
}

/// The pictures of one hologram or of the target images.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct Pictures {
    /// The images through each of the [`SHOWN`](super::SHOWN) pupils.
    pub views: Vec<Picture>,
    /// The errors of these images. Empty for target images.
    pub errors: Vec<Picture>,
    /// The images focused through the scene, from the farthest depth on.
    pub strip: Vec<Picture>,
    /// The slices of the sweep at near and at far focus.
    pub epipolar: Vec<Picture>,
    /// The energy over the pupil plane. `None` for target images.
    pub energy: Option<EnergyMap>,
}

/// The energy of one color over the pupil plane.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct EnergyMap {
    /// The color of the light.
    pub color: Color,
    /// The share of the map's side that the eyebox of all colors takes.
    pub share: f64,
    /// The map on a logarithmic scale.
    pub picture: Picture,
}
