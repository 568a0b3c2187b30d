//! What is refined: a color of a hologram, and all phases of a far field, of which the piece around the eye is.

use crate::optics::Laser;
use crate::solve::Problem;
use crate::tiled::TileRect;
use std::ops::Range;

/// One colour: what is solved for, and the hologram for the whole eyebox.
#[derive(Debug, Clone)]
pub struct LiveColor {
    /// The scene before this wavelength.
    pub problem: Problem,
    /// (frames, height, width), radians.
    pub phases: Vec<f32>,
    /// What the phases were solved for.
    pub exposure: f64,
    /// Its laser, where all colours share their sub-frames (OPTICS 13).
    pub laser: Option<Laser>,
}

impl LiveColor {
    /// Its sub-frames.
    pub fn frames(&self) -> usize {
        let optics = &self.problem.optics;
        self.phases.len() / (optics.height * optics.width).max(1)
    }
}

/// All phases of a far field, of which one piece is refined.
#[derive(Debug, Clone)]
pub struct Field {
    /// Colour by colour: (frames, height, width), radians.
    pub phases: Vec<Vec<f32>>,
    /// Rows and columns.
    pub size: [usize; 2],
    /// Where the piece lies.
    pub piece: TileRect,
}

impl Field {
    /// A piece as it is here: (frames, rows, columns).
    pub(crate) fn cut(&self, color: usize, piece: TileRect) -> Vec<f32> {
        let mut out = Vec::with_capacity(piece.size[0] * piece.size[1]);
        self.rows_of(color, piece).for_each(|row| out.extend_from_slice(&self.phases[color][row]));
        out
    }

    /// Puts what was refined of the piece where it belongs.
    pub(crate) fn put(&mut self, color: usize, phases: &[f32]) {
        let rows = self.rows_of(color, self.piece);
        let whole = &mut self.phases[color];
        for (row, new) in rows.zip(phases.chunks_exact(self.piece.size[1].max(1))) {
            whole[row].copy_from_slice(new);
        }
    }

    /// Where the rows of a piece lie, sub-frame by sub-frame.
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
