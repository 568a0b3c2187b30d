//! Crosstalk between pixels on the spectrum of a pair of sub-frames: `wave *= along_y * along_x` (OPTICS 10). The kernel of
//! crosstalk is real, so both sub-frames of the pair come out right; between an inverse and a forward transform, in the place
//! of a forward and an inverse one, it is transposed.

use crate::{Complex32, simd};

/// `transfer`: that along y (grid_height), then that along x (grid_width); `wave` (grid_height, grid_width).
pub fn crosstalk(height: usize, transfer: &[Complex32], wave: &mut [Complex32]) {
    let (along_y, along_x) = transfer.split_at(height);
    simd(
        #[inline(always)]
        || {
            for (row, y) in wave.chunks_exact_mut(along_x.len()).zip(along_y) {
                for (z, x) in row.iter_mut().zip(along_x) {
                    let (re, im) = (y.re * x.re - y.im * x.im, y.re * x.im + y.im * x.re);
                    *z = Complex32::new(z.re * re - z.im * im, z.re * im + z.im * re);
                }
            }
        },
    );
}
