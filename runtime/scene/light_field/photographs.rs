//! Of which views photographs are made where those of a scene stand apart (OPTICS 14).
//!
//! A photograph adds up the views in its pupil. Where content moves by more than a pixel from one to the next, it shows ghosts
//! of what is out of focus: then closer views are made, from Fourier disparity layers or by interpolation.

use serde::{Deserialize, Serialize};
use std::fmt;

/// Of which views photographs are made.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[non_exhaustive]
pub enum ViewSynthesis {
    /// Of a folder's own where they are close enough; else of layers where these show views in between well enough, else interpolated
    /// where that shows them better.
    #[default]
    Auto,
    /// The scene's own, each for its cell of the pupil plane.
    Cells,
    /// Those of Fourier disparity layers, as close as photographs need them.
    Layers,
    /// Those interpolated between the scene's own, with what is hidden; as close.
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

/// How the views of a light field were made of fewer.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MadeViews {
    /// By layers, or by interpolation.
    pub by: ViewSynthesis,
    /// Rows and columns of the scene's own views,
    pub grid: [usize; 2],
    /// and their distance in the pupil plane, meters.
    pub cell: f64,
    /// Pixels by which the ends of the scene's depths move against each other between its own views: the aliasing of their cells.
    pub aliasing: f64,
    /// How many layers there are, or would be, and how well they show a view that they were not told of, dB of the brightest: the mean over views
    /// between others, and the worst of all.
    pub layers: Option<(usize, [f64; 2])>,
    /// Where layers do not do: how well layers of every second view show those in between, and how well these are interpolated, dB.
    pub held_back: Option<[f64; 2]>,
}

impl MadeViews {
    /// What was made of what, and why.
    pub fn in_words(&self, made: [usize; 2]) -> [String; 2] {
        let [rows, columns] = self.grid;
        let by = match self.layers {
            Some((count, _)) if self.by == ViewSynthesis::Layers => format!("{count} Fourier disparity layers"),
            _ => "interpolation".into(),
        };
        let mut why = format!(
            "content moves by {:.1} pixels between the scene's {rows} x {columns}: their cells would show ghosts",
            self.aliasing
        );
        if let Some((_, [between, worst])) = self.layers {
            why += &format!("; layers show a view between others to {between:.1} dB, the worst view to {worst:.1} dB");
        }
        if let Some([layers, between]) = self.held_back {
            why += &format!(
                "; of every second view layers show the others to {layers:.1} dB, interpolation to {between:.1} dB"
            );
        }
        [format!("of {} x {} views by {by}", made[0], made[1]), why]
    }
}
