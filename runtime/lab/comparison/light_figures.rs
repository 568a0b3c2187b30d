//! What a comparison of sources and of masks comes to, as plain data.

use super::shown::Picture;
use eyebox::low_level::optics::Color;
use serde::{Deserialize, Serialize};

/// A source of one size, measured against one scene, in one colour.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct CoherenceFigures {
    /// Name of the scene.
    pub scene: String,
    /// Sub-frames.
    pub frames: usize,
    /// Colour.
    pub color: Color,
    /// Side of the source's image in the eyebox, mm; 0 for a point.
    pub image_mm: f64,
    /// Modes that it was solved for with.
    pub modes: usize,
    /// Of which its narrowest and its widest pupils needed these.
    pub pupil_modes: [usize; 2],
    /// Modes that judged it.
    pub judged_modes: usize,
    /// Diameters of those pupils, mm.
    pub diameter_mm: [f64; 2],
    /// PSNR over random pupils, dB: mean,
    pub mean_db: Option<f64>,
    /// and worst.
    pub worst_db: Option<f64>,
    /// Contrast of an even plane through the eye's pupil, standard deviation over mean.
    pub contrast: f64,
    /// Modulation that bars at the picture's Nyquist frequency keep, and at half of it, of theirs.
    pub modulation: [f64; 2],
    /// Where those bars lie, mm: at the scene's farthest depth.
    pub bars_mm: f64,
    /// Diameter of the pupil that looks at them, in focus, mm.
    pub widest_mm: f64,
    /// Diameter of the eye's pupil, mm.
    pub eye_mm: f64,
    /// Width of the focus through which bars of half the eye's cut-off keep half of their modulation, mm: at most what was looked
    /// through, four times the wavelength times the square of focal length over diameter,
    pub depth_of_field_mm: f64,
    /// and dioptres.
    pub depth_of_field_dioptres: f64,
    /// Through the eye's pupil, in the middle of the eyebox.
    pub picture: Option<Picture>,
}

/// A mask in front of the SLM, measured against one scene, in one colour.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct EtendueFigures {
    /// Name of the scene.
    pub scene: String,
    /// Sub-frames.
    pub frames: usize,
    /// Colour.
    pub color: Color,
    /// The mask, for people.
    pub mask: String,
    /// Its pixels along an axis of one of the SLM's; 1 for no mask.
    pub factor: usize,
    /// Whether it sends its light evenly into half of its own eyebox along an axis.
    pub designed: bool,
    /// Side of the eyebox, mm.
    pub eyebox_mm: f64,
    /// Area of the eyebox times the solid angle of the picture, mm2 sr.
    pub etendue_mm2_sr: f64,
    /// PSNR over random pupils in all of the eyebox, dB: mean,
    pub mean_db: Option<f64>,
    /// and worst.
    pub worst_db: Option<f64>,
    /// Contrast of an even plane through the eye's pupil, standard deviation over mean.
    pub contrast: f64,
    /// Diameter of that pupil, mm.
    pub eye_mm: f64,
    /// Through it, in the middle of the eyebox.
    pub picture: Option<Picture>,
}
