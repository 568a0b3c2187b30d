//! The kernel K(q; p) = A(q) H(q; z), per frequency bin (OPTICS 2).

use super::{Optics, Pupil};
use std::f64::consts::TAU;

/// Whether the light of bin (`ky`, `kx`) passes the pupil: inside the disc, a true DFT bin, and propagating.
///
/// Bins beyond the grid do not exist: they are where a window hangs over the edge of the eyebox.
pub(crate) fn aperture(optics: &Optics, pupil: &Pupil, ky: i64, kx: i64) -> bool {
    if !optics.has_bin(ky, kx) {
        return false;
    }
    let ((bin_y, bin_x), (slope_y, slope_x)) = (optics.bin_size(), optics.cosine_per_bin());
    let (dx, dy) = (kx as f64 * bin_x - pupil.x, ky as f64 * bin_y - pupil.y);
    let (cy, cx) = (ky as f64 * slope_y, kx as f64 * slope_x);
    dx * dx + dy * dy < (pupil.diameter / 2.0).powi(2) && cx * cx + cy * cy < 1.0
}

/// Phase of H(q; z) in turns, for `a = (wavelength |q|)^2 < 1`: `-(z / wavelength) a / (1 + sqrt(1 - a))`.
///
/// The form without cancellation; thousands of turns at 1 m, so reduce to a fraction before any float32 sine.
pub(crate) fn propagation_turns(a: f64, depth: f64, wavelength: f64) -> f64 {
    -(depth / wavelength) * (a / (1.0 + (1.0 - a).max(0.0).sqrt()))
}

/// K(q; p) as (re, im): the reference that kernels are compared with.
pub fn transfer(optics: &Optics, pupil: &Pupil, ky: i64, kx: i64) -> (f64, f64) {
    if !aperture(optics, pupil, ky, kx) {
        return (0.0, 0.0);
    }
    let (slope_y, slope_x) = optics.cosine_per_bin();
    let (cy, cx) = (ky as f64 * slope_y, kx as f64 * slope_x);
    let a = cx * cx + cy * cy;
    let turns = propagation_turns(a, pupil.depth, optics.wavelength);
    let (sin, cos) = (TAU * (turns - turns.round())).sin_cos();
    (cos, sin)
}
