//! Makes views from one picture and its disparities, as [reliefs](eyebox_kernels::relief) describe.

use crate::depth::map::ends;
use eyebox_kernels::relief::{Args, COLORS};
use eyebox_kernels::relief_close::relief_close;
use eyebox_kernels::relief_draw::{Piece, pieces, relief_draw};
use eyebox_kernels::relief_surfaces::Surfaces;
use rayon::prelude::*;

/// A picture with disparities, prepared for rendering from any view.
pub(crate) struct Relief {
    args: Args,
    /// Pieces of the surface, from near to far.
    pieces: Vec<Piece>,
}

/// Builds the relief of a picture. `disparity` is in pixels between neighboring views (positive towards the camera),
/// and the outermost view is `reach` views from the center. Each plane is `height * width`.
pub(crate) fn relief(planes: &[Vec<f32>], disparity: &[f32], size: [usize; 2], reach: f32) -> Relief {
    let mut colors = vec![0.0; COLORS * disparity.len()];
    colors.par_chunks_exact_mut(COLORS).enumerate().for_each(|(p, color)| {
        color.iter_mut().zip(planes).for_each(|(to, plane)| *to = plane[p]);
    });
    let surfaces = Surfaces::of(size, &colors, disparity, ends(disparity), reach);
    Relief { args: surfaces.args, pieces: pieces(&surfaces) }
}

impl Relief {
    /// Returns the bytes in memory.
    pub fn bytes(&self) -> u64 {
        (self.pieces.capacity() * size_of::<Piece>()) as u64
    }

    /// Returns the picture from `u` columns and `v` rows of views from the center, as one plane per color.
    pub fn view(&self, u: f32, v: f32) -> Vec<Vec<f32>> {
        let pixels = relief_draw(&self.args, &self.pieces, [u, v]);
        relief_close([self.args.height, self.args.width].map(|n| n as usize), &pixels, [u, v])
    }
}
