//! Computes `field = scale exp(i phases)` on the SLM, and zero in the padding around it. One frame.

use crate::{Complex32, ZERO, simd, trig};
use bytemuck::{Pod, Zeroable};

/// Sizes of the SLM and of the grid, and the position of the SLM in the grid.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
pub struct Args {
    /// Rows of the SLM.
    pub height: u32,
    /// Columns of the SLM.
    pub width: u32,
    /// Rows of the grid.
    pub grid_height: u32,
    /// Columns of the grid.
    pub grid_width: u32,
    /// First grid row of the SLM.
    pub top: u32,
    /// First grid column of the SLM.
    pub left: u32,
}

/// Writes `field` (grid_height, grid_width) from `phases` (height, width) in radians, |phase| < 10^4. `scale` is 1, or
/// a power of two that suits the storage of the field.
pub fn modulate(args: &Args, scale: f32, phases: &[f32], field: &mut [Complex32]) {
    let (w, gw) = (args.width as usize, args.grid_width as usize);
    let (top, left) = (args.top as usize, args.left as usize);
    simd(
        #[inline(always)]
        || {
            if args.height == args.grid_height && args.width == args.grid_width {
                trig::expi(phases, field);
            } else {
                field.fill(ZERO);
                for (row, out) in phases.chunks_exact(w).zip(field.chunks_exact_mut(gw).skip(top)) {
                    trig::expi(row, &mut out[left..left + w]);
                }
            }
            if scale != 1.0 {
                for z in field.iter_mut() {
                    *z = Complex32::new(z.re * scale, z.im * scale);
                }
            }
        },
    );
}
