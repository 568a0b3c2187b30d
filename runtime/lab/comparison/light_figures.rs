//! Defines the results of a comparison of sources and of masks as plain data.

use super::shown::Picture;
use eyebox::low_level::optics::Color;
use serde::{Deserialize, Serialize};

/// A source of one size, measured against one scene in one color.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct CoherenceFigures {
    /// The name of the scene.
    pub scene: String,
    /// The number of sub-frames per color.
    pub frames: usize,
    /// The color of the light.
    pub color: Color,
    /// The side of the source's image in the eyebox, in mm, or 0 for a point source.
    pub image_mm: f64,
    /// The number of modes of the solve.
    pub modes: usize,
    /// The numbers of modes that the narrowest and the widest pupils need.
    pub pupil_modes: [usize; 2],
    /// The number of modes that judge the hologram.
    pub judged_modes: usize,
    /// The diameters of the narrowest and the widest pupils, in mm.
    pub diameter_mm: [f64; 2],
    /// The mean PSNR over random pupils, in dB.
    pub mean_db: Option<f64>,
    /// The worst PSNR over random pupils, in dB.
    pub worst_db: Option<f64>,
    /// The speckle contrast of an even plane through the eye's pupil, as standard deviation over mean.
    pub contrast: f64,
    /// The shares of their modulation that bars keep, at the picture's Nyquist frequency and at half of it.
    pub modulation: [f64; 2],
    /// The depth of those bars, in mm. It is the scene's farthest depth.
    pub bars_mm: f64,
    /// The diameter of the pupil that sees these bars in focus, in mm.
    pub widest_mm: f64,
    /// The diameter of the eye's pupil, in mm.
    pub eye_mm: f64,
    /// The range of focus, in mm, through which bars of half the eye's cut-off frequency keep half of their modulation.
    /// The measured range, and so the highest value, is four times the wavelength times the square of focal length over
    /// diameter.
    pub depth_of_field_mm: f64,
    /// The range of focus in dioptres.
    pub depth_of_field_dioptres: f64,
    /// The picture through the eye's pupil, in the middle of the eyebox.
    pub picture: Option<Picture>,
}

/// A mask in front of the SLM, measured against one scene in one color.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct EtendueFigures {
    /// The name of the scene.
    pub scene: String,
    /// The number of sub-frames per color.
    pub frames: usize,
    /// The color of the light.
    pub color: Color,
    /// The name of the mask for reports.
    pub mask: String,
    /// Mask pixels per SLM pixel along an axis, or 1 for no mask.
    pub factor: usize,
    /// True for a mask that sends its light evenly into half of its own eyebox along an axis.
    pub designed: bool,
    /// The side of the eyebox, in mm.
    pub eyebox_mm: f64,
    /// The area of the eyebox times the solid angle of the picture, in mm2 sr.
    pub etendue_mm2_sr: f64,
    /// The mean PSNR over random pupils in the whole eyebox, in dB.
    pub mean_db: Option<f64>,
    /// The worst PSNR over random pupils in the whole eyebox, in dB.
    pub worst_db: Option<f64>,
    /// The speckle contrast of an even plane through the eye's pupil, as standard deviation over mean.
    pub contrast: f64,
    /// The diameter of the eye's pupil, in mm.
    pub eye_mm: f64,
    /// The picture through the eye's pupil, in the middle of the eyebox.
    pub picture: Option<Picture>,
}
