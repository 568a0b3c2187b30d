//! Defines reliefs, which give views from one picture and its disparities.
//!
//! Each pixel is a small piece of surface. It is joined to neighbors of similar depth, and torn from the others. A view
//! displaces its corners, so joined pieces stretch without cracks. The pieces are drawn from near to far, and each
//! takes the uncovered part of the pixels on which it falls. Near content therefore covers far content, and outlines
//! keep their partial coverage. Behind every tear the far surface is continued once for all views. Content that appears
//! from behind is then the same from everywhere, so it refocuses. The continuation is a mirror image of the surface and
//! not a smear.
//!
//! [`relief_decode`](crate::relief_decode) reads a frame of an application, and
//! [`relief_sharpen`](crate::relief_sharpen) sharpens its disparities. [`relief_unmix`](crate::relief_unmix) separates
//! mixed colors. [`relief_jump`](crate::relief_jump), [`relief_fill`](crate::relief_fill) and
//! [`relief_soften`](crate::relief_soften) continue the far surface. [`relief_levels`](crate::relief_levels) and
//! [`relief_draw`](crate::relief_draw) draw a view, and [`relief_close`](crate::relief_close) closes its gaps.

use bytemuck::{Pod, Zeroable};

/// A difference of disparity that opens more than this many pixels in the outermost view is a tear.
pub const TEAR: f32 = 1.5;
/// Number of colors of a picture. All three are used, because they show the mixture at edges together.
pub const COLORS: usize = 3;
/// The neighbors of a pixel as (columns, rows), with the closest first.
pub const AROUND: [(i64, i64); 8] = [(-1, 0), (1, 0), (0, -1), (0, 1), (-1, -1), (1, -1), (-1, 1), (1, 1)];
/// Stored instead of a disparity if there is no surface.
pub const ABSENT: f32 = -1e30;
/// The farthest rows or columns between a pixel and a tear. Offsets are stored in 16 bits.
const FARTHEST: f32 = 32_000.0;

/// Size of a picture that is continued beyond its frame by mirroring.
///
/// A surface is stored as `plane` disparities (pixels between neighboring views, positive towards the camera), then
/// `plane` colors of [`COLORS`] values. Both are in (row, column) of the continued picture.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct Args {
    /// Rows of the picture.
    pub height: u32,
    /// Columns of the picture.
    pub width: u32,
    /// Rows and columns on each side of it.
    pub pad: u32,
    /// Pixels of the continued picture, rounded up to a multiple of 64.
    pub plane: u32,
    /// The farthest rows or columns between a pixel and the tear that shows the surface behind it.
    pub reach: u32,
    /// Smallest difference of disparity that is a tear.
    pub tear: f32,
}

impl Args {
    /// Returns the size for a picture of (rows, columns) whose disparities are between two values, if the outermost
    /// view is `reach` views from the center.
    pub fn new([height, width]: [usize; 2], [low, high]: [f32; 2], reach: f32) -> Self {
        let pad = (low.abs().max(high.abs()) * reach).ceil() as usize + 2;
        let plane = ((height + 2 * pad) * (width + 2 * pad)).next_multiple_of(64);
        Self {
            height: height as u32,
            width: width as u32,
            pad: pad as u32,
            plane: plane as u32,
            reach: ((high - low) * reach).ceil().min(FARTHEST) as u32 + 2,
            tear: tear(reach),
        }
    }

    /// Returns rows and columns of the continued picture.
    pub fn size(&self) -> [usize; 2] {
        [self.height, self.width].map(|n| (n + 2 * self.pad) as usize)
    }

    /// Returns the number of pixels of the continued picture.
    pub fn pixels(&self) -> usize {
        let [tall, wide] = self.size();
        tall * wide
    }

    /// Returns the number of values of a surface.
    pub fn values(&self) -> usize {
        (1 + COLORS) * self.plane as usize
    }

    /// Returns the column and the row of a pixel.
    pub(crate) fn place(&self, pixel: usize) -> (i64, i64) {
        let wide = self.size()[1];
        ((pixel % wide) as i64, (pixel / wide) as i64)
    }

    /// Returns the pixel in a column and a row, if it exists.
    pub(crate) fn at(&self, x: i64, y: i64) -> Option<usize> {
        let [tall, wide] = self.size();
        ((0..wide as i64).contains(&x) && (0..tall as i64).contains(&y)).then(|| y as usize * wide + x as usize)
    }

    /// Returns the column and the row relative to the first pixel of the picture itself.
    pub(crate) fn picture_place(&self, pixel: usize) -> [f32; 2] {
        let (x, y) = self.place(pixel);
        [x, y].map(|v| v as f32 - self.pad as f32)
    }

    /// Returns the steps of [`relief_jump`](crate::relief_jump), which bring every pixel to a rim within reach. There are
    /// none without tears.
    pub fn steps(&self, [low, high]: [f32; 2]) -> impl Iterator<Item = u32> + use<> {
        let longest = (high - low > self.tear).then(|| self.reach.ilog2());
        longest.into_iter().flat_map(|longest| (0..=longest).rev().map(|power| 1 << power))
    }
}

/// Returns the smallest difference of disparity that is a tear, if the outermost view is `reach` views from the center.
pub fn tear(reach: f32) -> f32 {
    TEAR / reach.max(0.5)
}

/// Returns the color of a pixel in the colors of a surface or of a picture.
pub(crate) fn color(colors: &[f32], pixel: usize) -> [f32; COLORS] {
    std::array::from_fn(|k| colors[COLORS * pixel + k])
}
