//! What a run comes to, as plain data: kept in files, put into reports.

use eyebox::evaluate::Group;
use eyebox::optics::Color;
use serde::{Deserialize, Serialize};

/// A picture of the report, ready to be put into a page.
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
    /// Through each of the chosen pupils ([`super::pupils::Chosen`]).
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

/// What one pupil scored in one colour.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Row {
    /// Colour.
    pub color: Color,
    /// Group of the pupil.
    pub group: Group,
    /// Place in its group.
    pub index: usize,
    /// x, y, diameter, focus, mm.
    pub pupil_mm: [f64; 4],
    /// dB.
    pub psnr: f64,
    /// None for pictures smaller than its window.
    pub ssim: Option<f64>,
}

/// Figures of one colour.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct ColorFigures {
    /// Which.
    pub color: Color,
    /// The one exposure of all pupils, fitted over the focal stack.
    pub exposure: f64,
    /// Coefficient of variation of the light through a small pupil over the eyebox.
    pub variation: f64,
    /// PSNR of the epipolar slices at near and at far focus, dB.
    pub epipolar: [f64; 2],
}

/// Colour error over the random pupils, mean CIEDE2000.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
pub struct ColorError {
    /// Near edges in depth; none where the scene has no such edge.
    pub edges: Option<f64>,
    /// Everywhere else.
    pub elsewhere: Option<f64>,
    /// Share of the picture that is near edges.
    pub share: f64,
}

/// One hologram, measured against one scene.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Run {
    /// Name of the scene.
    pub scene: String,
    /// Name of the method, or the one given to the hologram.
    pub method: String,
    /// Sub-frames.
    pub frames: usize,
    /// Seconds of the solve, all colours; none for a hologram that was given.
    pub seconds: Option<f64>,
    /// Per colour.
    pub colors: Vec<ColorFigures>,
    /// Per colour and pupil.
    pub rows: Vec<Row>,
    /// None of pictures without all three colours, or without depth.
    pub color_error: Option<ColorError>,
    /// For the page alone.
    pub pictures: Pictures,
}

/// A scene and its photographs.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct SceneFigures {
    /// Its name.
    pub name: String,
    /// Rows and columns of views.
    pub views: [usize; 2],
    /// Farthest and nearest focus, mm.
    pub depth_mm: [f64; 2],
    /// Row of the picture whose epipolar slices are shown.
    pub row: usize,
    /// Photographs.
    pub pictures: Pictures,
}

/// Speckle of an even plane.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct SpeckleFigures {
    /// Method.
    pub method: String,
    /// (sub-frames, contrast) of independent frames.
    pub independent: Vec<(usize, f64)>,
    /// (sub-frames, contrast) of frames that were optimised together.
    pub joint: Vec<(usize, f64)>,
    /// Side of the plane, pixels.
    pub side: usize,
    /// Colour.
    pub color: Color,
    /// Diameter of the pupil, mm.
    pub diameter_mm: f64,
}
