//! Defines the methods that make views for target images if a scene's own are too far apart (OPTICS 14).
//!
//! A target image is the sum of the views in its pupil. If content moves by more than a pixel from one view to the
//! next, it shows ghosts of content that is out of focus. Closer views are then made, from Fourier disparity layers or
//! by interpolation.

use serde::{Deserialize, Serialize};
use std::fmt;

/// The views from which target images are made.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[non_exhaustive]
pub enum ViewSynthesis {
    /// The views of the folder, if they are close enough. Otherwise views of layers if these predict views in between
    /// well enough, or interpolated views if interpolation predicts them better.
    #[default]
    Auto,
    /// The scene's own views, each for its cell of the pupil plane.
    Cells,
    /// Views of Fourier disparity layers, as close as target images need them.
    Layers,
    /// Views interpolated between the scene's own views with handling of hidden content, equally close.
    Between,
}

impl fmt::Display for ViewSynthesis {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str(match self {
            Self::Auto => "auto",
            Self::Cells => "cells",
            Self::Layers => "layers",
            Self::Between => "between",
        })
    }
}

/// The method by which the views of a light field were made from fewer views.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MadeViews {
    /// The method, which is layers or interpolation.
    pub by: ViewSynthesis,
    /// Rows and columns of the scene's own views.
    pub grid: [usize; 2],
    /// Distance of the scene's own views in the pupil plane, in meters.
    pub cell: f64,
    /// Pixels by which the ends of the scene's depths move against each other between its own views, which is the
    /// aliasing of their cells.
    pub aliasing: f64,
    /// The number of layers, and their accuracy for a view that the fit leaves out, in dB of the brightest light. The
    /// accuracy is the mean over views between others, and the worst of all views.
    pub layers: Option<(usize, [f64; 2])>,
    /// If layers are not accurate enough, the accuracy of layers of every second view for the views in between, and of
    /// interpolation, in dB.
    pub held_back: Option<[f64; 2]>,
}

impl MadeViews {
    /// Describes the made views, and the reason for making them.
    pub fn in_words(&self, made: [usize; 2]) -> [String; 2] {
        let [rows, columns] = self.grid;
        let by = match self.layers {
            Some((count, _)) if self.by == ViewSynthesis::Layers => format!("{count} Fourier disparity layers"),
            _ => "interpolation".into(),
        };
        let mut why = format!(
            "content moves by {:.1} pixels between the scene's {rows} x {columns}, so their cells would show ghosts",
            self.aliasing
        );
        if let Some((_, [between, worst])) = self.layers {
            why += &format!(
                ", layers predict a view between others with {between:.1} dB and the worst view with {worst:.1} dB"
            );
        }
        if let Some([layers, between]) = self.held_back {
            why += &format!(
                ", from every second view layers predict the others with {layers:.1} dB and interpolation with \
                 {between:.1} dB"
            );
        }
        [format!("of {} x {} views by {by}", made[0], made[1]), why]
    }
}
