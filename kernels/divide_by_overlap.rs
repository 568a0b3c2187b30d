//! Divides the change by a power of the overlap, `change /= max(hits, 1)^power`, in the columns in use. One frame.

use crate::{Complex32, simd};
use bytemuck::{Pod, Zeroable};

/// Size of the grid, and the power of the overlap.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct Args {
    /// Rows of the grid.
    pub grid_height: u32,
    /// Columns of the grid.
    pub grid_width: u32,
    /// Power of the overlap. 1 gives the mean over the overlapping pupils (OPTICS 6b), 1/2 lets overlap count more
    /// (OPTICS 6e).
    pub power: f32,
}

/// Divides `change` by `hits^power`, both (grid_height, grid_width). `power` is 1, 1/2 or any value between.
pub fn divide_by_overlap(args: &Args, hits: &[f32], change: &mut [Complex32]) {
    let power = args.power;
    simd(
        #[inline(always)]
        || {
            if power == 0.5 {
                for (z, hits) in change.iter_mut().zip(hits) {
                    let factor = 1.0 / hits.max(1.0).sqrt();
                    *z = Complex32::new(z.re * factor, z.im * factor);
                }
            } else {
                for (z, hits) in change.iter_mut().zip(hits).filter(|(_, hits)| **hits > 1.0) {
                    let factor = hits.powf(-power);
                    *z = Complex32::new(z.re * factor, z.im * factor);
                }
            }
        },
    );
}
