//! Combines the central order of a field on sub-pixels (OPTICS 10). The sub-pixels at the same place in all pixels form
//! a plane of the grid's size. The spectra of the planes, each moved by its offset, add up to the spectrum of the
//! field. One frame.
//!
//! All planes are transformed along rows. Then the planes of one row of sub-pixels are added, and only these sums are
//! transformed along columns.

use crate::{Complex32, simd};

/// Returns `a b`, or `conj(a) b` if `back` is true.
#[inline(always)]
fn times(a: &Complex32, b: &Complex32, back: bool) -> Complex32 {
    let im = if back { -a.im } else { a.im };
    Complex32::new(a.re * b.re - im * b.im, a.re * b.im + im * b.re)
}

/// Adds planes whose rows are transformed. The first of `planes` (subpixels, height, width) becomes the sum. `factors`
/// is (subpixels, width).
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

/// Applies the transpose of [`add_rows`], which spreads the first plane over all planes.
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

/// Adds planes whose columns are transformed. The first of each `subpixels` planes in `planes` (subpixels, subpixels,
/// height, width) is added to `field` (height, width). `factors` is (subpixels, height).
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

/// Applies the transpose of [`add_columns`], from `change` (height, width) to the first of each `subpixels` planes in
/// `planes`.
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
