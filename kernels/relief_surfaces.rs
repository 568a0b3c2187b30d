//! Runs the twins that make the surfaces of a relief, in their order.

use crate::relief::{Args, tear};
use crate::relief_fill::relief_fill;
use crate::relief_jump::{NOWHERE, relief_jump};
use crate::relief_sharpen::{self, TIMES, relief_sharpen};
use crate::relief_soften::relief_soften;
use crate::relief_unmix::{VALUES, relief_unmix};

/// The surfaces of a picture with disparities.
pub struct Surfaces {
    /// Size of the continued picture.
    pub args: Args,
    /// The surface in front.
    pub front: Vec<f32>,
    /// The near parts of mixed pixels, as [`relief_unmix`] writes them.
    pub fringe: Vec<f32>,
    /// The surface behind the one in front.
    pub hidden: Vec<f32>,
}

impl Surfaces {
    /// Makes the surfaces of a picture of (rows, columns) from its colors (height, width, color) and its disparities
    /// (height, width), which are between `ends`. The outermost view is `reach` views from the center.
    pub fn of(size: [usize; 2], colors: &[f32], disparity: &[f32], ends: [f32; 2], reach: f32) -> Self {
        let [height, width] = size.map(|n| n as u32);
        let sharpening = relief_sharpen::Args { height, width, tear: tear(reach) };
        let (mut sharp, mut before) = (disparity.to_vec(), vec![0.0; disparity.len()]);
        for _ in 0..TIMES {
            std::mem::swap(&mut sharp, &mut before);
            relief_sharpen(&sharpening, &before, &mut sharp);
        }
        let args = Args::new(size, ends, reach);
        let plane = args.plane as usize;
        let (mut front, mut fringe) = (vec![0.0; args.values()], vec![0.0; VALUES * plane]);
        let (mut nearest, mut next) = (vec![NOWHERE; 2 * plane], vec![NOWHERE; 2 * plane]);
        relief_unmix(&args, colors, &sharp, &mut front, &mut fringe, &mut nearest);
        for step in args.steps(ends) {
            relief_jump(&args, step, &front, &nearest, &mut next);
            std::mem::swap(&mut nearest, &mut next);
        }
        let (mut filled, mut hidden) = (vec![0.0; args.values()], vec![0.0; args.values()]);
        relief_fill(&args, &front, &nearest, &mut filled);
        relief_soften(&args, &filled, &mut hidden);
        Self { args, front, fringe, hidden }
    }
}
