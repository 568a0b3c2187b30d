//! Sums the light in each patch of the eyebox, `energy[patch] += sum |field|^2`. A square of the spectrum is divided
//! into `patches` x `patches` (OPTICS 7, pupil-aware). All sub-frames.

use crate::{Complex32, modulate, simd};
use bytemuck::{Pod, Zeroable};

/// Position of the eyebox in the spectrum.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
pub struct Args {
    /// Rows of the grid.
    pub grid_height: u32,
    /// Columns of the grid.
    pub grid_width: u32,
    /// First row of the eyebox, as an index of the DFT.
    pub y0: u32,
    /// First column of the eyebox, as an index of the DFT.
    pub x0: u32,
    /// Rows of the eyebox, at most the rows of the grid.
    pub rows: u32,
    /// Columns of the eyebox.
    pub columns: u32,
    /// Patches along each axis, 1 to [`MOST`].
    pub patches: u32,
    /// If not 0, the sums are added to the contents of `energy`.
    pub accumulate: u32,
}

/// Maximum number of patches along an axis.
pub const MOST: u32 = 16;

impl Args {
    /// Returns true if the arguments match a grid of this size, and the number of patches is valid.
    pub fn fits(&self, grid: &modulate::Args) -> bool {
        (self.grid_height, self.grid_width) == (grid.grid_height, grid.grid_width)
            && (1..=MOST).contains(&self.patches)
            && self.rows <= self.grid_height
            && self.columns <= self.grid_width
            && self.y0 < self.grid_height
            && self.x0 < self.grid_width
    }

    /// Returns the rows (or columns) of patch `p`, if the eyebox has `n` of them.
    pub(crate) fn part(&self, p: u32, n: u32) -> std::ops::Range<u32> {
        p * n / self.patches..(p + 1) * n / self.patches
    }

    /// Returns true if the center of patch (`a`, `b`) is inside the disc inscribed in the eyebox. No centered pupil
    /// sees the corners outside it, so light may go there.
    pub(crate) fn counts(&self, a: u32, b: u32) -> bool {
        let off = |p: u32| (2 * p + 1) as i64 - i64::from(self.patches);
        off(a) * off(a) + off(b) * off(b) <= i64::from(self.patches) * i64::from(self.patches)
    }
}

/// Sums `field`, spectra of shape (frames, grid_height, grid_width). `energy` receives the sums (patches, patches) in
/// its first `patches` squared values.
pub fn energy(args: &Args, field: &[Complex32], energy: &mut [f32]) {
    let (height, width) = (args.grid_height as usize, args.grid_width as usize);
    simd(
        #[inline(always)]
        || {
            for (patch, out) in energy.iter_mut().enumerate().take((args.patches * args.patches) as usize) {
                let (a, b) = (patch as u32 / args.patches, patch as u32 % args.patches);
                let columns = args.part(b, args.columns);
                let mut sum = 0.0f64;
                for frame in field.chunks_exact(height * width) {
                    for j in args.part(a, args.rows) {
                        let row = &frame[(args.y0 + j) as usize % height * width..][..width];
                        let mut part = 0.0f32;
                        for k in columns.clone() {
                            part += row[(args.x0 + k) as usize % width].norm_sqr();
                        }
                        sum += f64::from(part);
                    }
                }
                *out = sum as f32 + if args.accumulate != 0 { *out } else { 0.0 };
            }
        },
    );
}
