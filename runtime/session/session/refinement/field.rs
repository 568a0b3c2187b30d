//! Defines a refined color of a hologram, and a far field of which the piece around the eye is refined.

use crate::optics::Laser;
use crate::solve::Problem;
use crate::tiled::TileRect;
use std::ops::Range;

/// One color with its problem and the hologram for the whole eyebox.
#[derive(Debug, Clone)]
pub struct LiveColor {
    /// The scene before this wavelength.
    pub problem: Problem,
    /// The phases (frames, height, width) in radians.
    pub phases: Vec<f32>,
    /// The exposure that the phases were solved for.
    pub exposure: f64,
    /// The laser, if all colors share their sub-frames (OPTICS 13).
    pub laser: Option<Laser>,
}

impl LiveColor {
    /// Returns the number of its sub-frames.
    pub fn frames(&self) -> usize {
        let optics = &self.problem.optics;
        self.phases.len() / (optics.height * optics.width).max(1)
    }
}

/// All phases of a far field, of which one piece is refined.
#[derive(Debug, Clone)]
pub struct Field {
    /// The phases of each color (frames, height, width) in radians.
    pub phases: Vec<Vec<f32>>,
    /// The rows and the columns of the far field.
    pub size: [usize; 2],
    /// The rectangle of the piece.
    pub piece: TileRect,
}

impl Field {
    /// Returns the phases of a piece (frames, rows, columns).
    pub(crate) fn cut(&self, color: usize, piece: TileRect) -> Vec<f32> {
        let mut out = Vec::with_capacity(piece.size[0] * piece.size[1]);
        self.rows_of(color, piece).for_each(|row| out.extend_from_slice(&self.phases[color][row]));
        out
    }

    /// Stores the refined phases of the piece.
    pub(crate) fn put(&mut self, color: usize, phases: &[f32]) {
        let rows = self.rows_of(color, self.piece);
        let whole = &mut self.phases[color];
        for (row, new) in rows.zip(phases.chunks_exact(self.piece.size[1].max(1))) {
            whole[row].copy_from_slice(new);
        }
    }

    /// Returns the ranges of the rows of a piece, for each sub-frame.
    fn rows_of(&self, color: usize, TileRect { at, size }: TileRect) -> impl Iterator<Item = Range<usize>> + use<> {
        let [height, width] = self.size;
        let frames = self.phases[color].len() / (height * width).max(1);
        (0..frames).flat_map(move |frame| {
            (0..size[0]).map(move |row| {
                let begin = (frame * height + at[0] + row) * width + at[1];
                begin..begin + size[1]
            })
        })
    }
}
