//! The kernel K(q; p) = A(q) H(q; z), per frequency bin (OPTICS 2).

use super::{Optics, Pupil, frequency_bin};
use std::f64::consts::TAU;

/// Whether the light of bin (`ky`, `kx`) passes the pupil: inside the disc, a true DFT bin, and propagating.
///
/// Bins outside `-N/2 ..= (N - 1)/2` do not exist: they are where a window hangs over the edge of the eyebox.
pub fn aperture(optics: &Optics, pupil: &Pupil, ky: i64, kx: i64) -> bool {
    if frequency_bin(ky, optics.height) != ky || frequency_bin(kx, optics.width) != kx {
        return false;
    }
    let to_pupil = optics.wavelength * optics.focal_length;
    let (fy, fx) =
        (ky as f64 / (optics.height as f64 * optics.pitch), kx as f64 / (optics.width as f64 * optics.pitch));
    let (dx, dy) = (fx * to_pupil - pupil.x, fy * to_pupil - pupil.y);
    dx * dx + dy * dy < (pupil.diameter / 2.0).powi(2) && optics.wavelength.powi(2) * (fx * fx + fy * fy) < 1.0
}

/// Phase of H(q; z) in turns, for `a = (wavelength |q|)^2 < 1`: `-(z / wavelength) a / (1 + sqrt(1 - a))`.
///
/// The form without cancellation; thousands of turns at 1 m, so reduce to a fraction before any float32 sine.
pub fn propagation_turns(a: f64, depth: f64, wavelength: f64) -> f64 {
    -(depth / wavelength) * (a / (1.0 + (1.0 - a).max(0.0).sqrt()))
}

/// K(q; p) as (re, im): the reference that kernels are compared with.
pub fn transfer(optics: &Optics, pupil: &Pupil, ky: i64, kx: i64) -> (f64, f64) {
    if !aperture(optics, pupil, ky, kx) {
        return (0.0, 0.0);
    }
    let (fy, fx) =
        (ky as f64 / (optics.height as f64 * optics.pitch), kx as f64 / (optics.width as f64 * optics.pitch));
    let a = optics.wavelength.powi(2) * (fx * fx + fy * fy);
    let turns = propagation_turns(a, pupil.depth, optics.wavelength);
    let (sin, cos) = (TAU * (turns - turns.round())).sin_cos();
    (cos, sin)
}
