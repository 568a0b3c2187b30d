//! The central order of a field on sub-pixels (OPTICS 10): the sub-pixels that lie at one place in their pixels are a plane of
//! the grid's size, and the spectra of the planes, each moved by its offset, add up to the field's. One frame.
//!
//! Planes go through their rows, those of a pixel's row of sub-pixels are added, and only these sums through their columns.

use crate::{Complex32, simd};

/// `a b`, or `conj(a) b`.
#[inline(always)]
fn times(a: &Complex32, b: &Complex32, back: bool) -> Complex32 {
    let im = if back { -a.im } else { a.im };
    Complex32::new(a.re * b.re - im * b.im, a.re * b.im + im * b.re)
}

/// Adds planes whose rows are transformed: `planes` (subpixels, height, width), of which the first becomes the sum; `factors`
/// (subpixels, width).
pub fn add_rows(width: usize, factors: &[Complex32], planes: &mut [Complex32]) {
    let (first, others) = planes.split_at_mut(planes.len() * width / factors.len());
    let points = first.len();
    simd(
        #[inline(always)]
        || {
            let (own, factors) = factors.split_at(width);
            for (y, row) in first.chunks_exact_mut(width).enumerate() {
                row.iter_mut().zip(own).for_each(|(z, f)| *z = times(f, z, false));
                for (other, factors) in others.chunks_exact(points).zip(factors.chunks_exact(width)) {
                    for ((z, f), v) in row.iter_mut().zip(factors).zip(&other[y * width..][..width]) {
                        *z += times(f, v, false);
                    }
                }
            }
        },
    );
}

/// The same transposed: the first of the planes is spread over all of them.
pub fn spread_rows(width: usize, factors: &[Complex32], planes: &mut [Complex32]) {
    let (first, others) = planes.split_at_mut(planes.len() * width / factors.len());
    simd(
        #[inline(always)]
        || {
            let (own, factors) = factors.split_at(width);
            for (other, factors) in others.chunks_exact_mut(first.len()).zip(factors.chunks_exact(width)) {
                for (to, from) in other.chunks_exact_mut(width).zip(first.chunks_exact(width)) {
                    let values = to.iter_mut().zip(from).zip(factors);
                    values.for_each(|((to, from), f)| *to = times(f, from, true));
                }
            }
            for row in first.chunks_exact_mut(width) {
                row.iter_mut().zip(own).for_each(|(z, f)| *z = times(f, z, true));
            }
        },
    );
}

/// Adds planes whose columns are transformed: the first of each `subpixels` in `planes` (subpixels, subpixels, height, width)
/// to `field` (height, width); `factors` (subpixels, height).
pub fn add_columns(width: usize, factors: &[Complex32], planes: &[Complex32], field: &mut [Complex32]) {
    let height = field.len() / width;
    let each = field.len() * (factors.len() / height);
    simd(
        #[inline(always)]
        || {
            for (i, (planes, factors)) in planes.chunks_exact(each).zip(factors.chunks_exact(height)).enumerate() {
                let rows = field.chunks_exact_mut(width).zip(planes.chunks_exact(width)).zip(factors);
                for ((to, from), f) in rows {
                    if i == 0 {
                        to.iter_mut().zip(from).for_each(|(z, v)| *z = times(f, v, false));
                    } else {
                        to.iter_mut().zip(from).for_each(|(z, v)| *z += times(f, v, false));
                    }
                }
            }
        },
    );
}

/// The same transposed: `change` (height, width) to the first of each `subpixels` in `planes`.
pub fn spread_columns(width: usize, factors: &[Complex32], change: &[Complex32], planes: &mut [Complex32]) {
    let height = change.len() / width;
    let each = change.len() * (factors.len() / height);
    simd(
        #[inline(always)]
        || {
            for (planes, factors) in planes.chunks_exact_mut(each).zip(factors.chunks_exact(height)) {
                for ((to, from), f) in planes.chunks_exact_mut(width).zip(change.chunks_exact(width)).zip(factors) {
                    to.iter_mut().zip(from).for_each(|(z, v)| *z = times(f, v, true));
                }
            }
        },
    );
}
