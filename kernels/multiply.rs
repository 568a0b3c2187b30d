//! Multiplies the field by factors, `field = scale factor field`, or by their conjugates (OPTICS 12). The factors are
//! the phases of the mask, or the propagation to it per bin. One frame.

use crate::{Complex32, simd};
use bytemuck::{Pod, Zeroable};

/// The part of the grid that has factors.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct Args {
    /// Rows of the factors.
    pub rows: u32,
    /// Columns of the factors.
    pub columns: u32,
    /// Rows of the grid.
    pub grid_height: u32,
    /// Columns of the grid.
    pub grid_width: u32,
    /// First grid row that has a factor.
    pub top: u32,
    /// First grid column that has a factor.
    pub left: u32,
    /// 1 to multiply by the conjugates of the factors.
    pub conjugate: u32,
    /// Factor on every value, also on those without an entry in `factors`.
    pub scale: f32,
}

/// Multiplies `field` (grid_height, grid_width) by `factors` (rows, columns).
pub fn multiply(args: &Args, factors: &[Complex32], field: &mut [Complex32]) {
    let (columns, width) = (args.columns as usize, args.grid_width as usize);
    let (top, left, scale) = (args.top as usize, args.left as usize, args.scale);
    let sign = if args.conjugate != 0 { -1.0 } else { 1.0 };
    simd(
        #[inline(always)]
        || {
            for z in field.iter_mut() {
                *z = Complex32::new(scale * z.re, scale * z.im);
            }
            for (row, factors) in field.chunks_exact_mut(width).skip(top).zip(factors.chunks_exact(columns)) {
                for (z, f) in row[left..left + columns].iter_mut().zip(factors) {
                    let im = sign * f.im;
                    *z = Complex32::new(z.re * f.re - z.im * im, z.re * im + z.im * f.re);
                }
            }
        },
    );
}
