//! Pictures of a comparison, as files beside its page.

use eyebox::low_level::optics::Color;
use serde::{Deserialize, Serialize};

/// A picture, ready to be put into a page.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Picture {
    /// Pixels across.
    pub width: usize,
    /// Pixels down.
    pub height: usize,
    /// PSNR of what it shows over all colours, dB, where it is a view that was scored.
    pub psnr: Option<f64>,
    /// `data:` address.
    pub data: String,
}

/// Pictures of one hologram, or of the photographs that it is compared with.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct Pictures {
    /// Through each of the [`SHOWN`](super::SHOWN) pupils.
    pub views: Vec<Picture>,
    /// Their error; none of photographs.
    pub errors: Vec<Picture>,
    /// Focused through the scene, farthest first.
    pub strip: Vec<Picture>,
    /// Slices of the sweep at near and at far focus.
    pub epipolar: Vec<Picture>,
    /// Energy over the pupil plane; none of photographs.
    pub energy: Option<EnergyMap>,
}

/// The energy of one colour over the pupil plane.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct EnergyMap {
    /// Which colour.
    pub color: Color,
    /// Share of the map's side that the eyebox of all colours takes.
    pub share: f64,
    /// The map, log scale.
    pub picture: Picture,
}
