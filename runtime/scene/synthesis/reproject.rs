//! Makes views from one picture and its disparities, as [reliefs](eyebox_kernels::relief) describe.

use eyebox_kernels::relief::{Args, COLORS, tear};
use eyebox_kernels::relief_close::relief_close;
use eyebox_kernels::relief_draw::{Piece, pieces, relief_draw};
use eyebox_kernels::relief_fill::relief_fill;
use eyebox_kernels::relief_jump::{NOWHERE, relief_jump};
use eyebox_kernels::relief_sharpen::{self, TIMES, relief_sharpen};
use eyebox_kernels::relief_soften::relief_soften;
use eyebox_kernels::relief_unmix::{VALUES, relief_unmix};
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
    let [height, width] = size;
    let sharpening = relief_sharpen::Args { height: height as u32, width: width as u32, tear: tear(reach) };
    let (mut sharp, mut before) = (disparity.to_vec(), vec![0.0; height * width]);
    for _ in 0..TIMES {
        std::mem::swap(&mut sharp, &mut before);
        relief_sharpen(&sharpening, &before, &mut sharp);
    }
    let ends = disparity.iter().fold([f32::INFINITY, f32::NEG_INFINITY], |[a, b], &v| [a.min(v), b.max(v)]);
    let args = Args::new(size, ends, reach);
    let mut colors = vec![0.0; COLORS * height * width];
    colors.par_chunks_exact_mut(COLORS).enumerate().for_each(|(p, color)| {
        color.iter_mut().zip(planes).for_each(|(to, plane)| *to = plane[p]);
    });
    let plane = args.plane as usize;
    let (mut front, mut fringe) = (vec![0.0; args.values()], vec![0.0; VALUES * plane]);
    let (mut nearest, mut next) = (vec![NOWHERE; 2 * plane], vec![NOWHERE; 2 * plane]);
    relief_unmix(&args, &colors, &sharp, &mut front, &mut fringe, &mut nearest);
    for step in args.steps(ends) {
        relief_jump(&args, step, &front, &nearest, &mut next);
        std::mem::swap(&mut nearest, &mut next);
    }
    let (mut filled, mut hidden) = (vec![0.0; args.values()], vec![0.0; args.values()]);
    relief_fill(&args, &front, &nearest, &mut filled);
    relief_soften(&args, &filled, &mut hidden);
    Relief { args, pieces: pieces(&args, &front, &fringe, &hidden) }
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
