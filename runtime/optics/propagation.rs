//! Evaluates the kernel K(q; p) = A(q) H(q; z) per frequency bin (OPTICS 2).

use super::{Optics, Pupil, frequency_bin};
use std::f64::consts::TAU;

/// True if the light of bin (`ky`, `kx`) passes the pupil. The bin must be inside the disc, exist in the DFT, and
/// propagate.
///
/// Bins beyond the grid do not exist. They occur in a window that extends beyond the edge of the eyebox.
pub fn aperture(optics: &Optics, pupil: &Pupil, ky: i64, kx: i64) -> bool {
    Aperture::new(optics, pupil).row(ky)(kx)
}

/// The numbers that decide the aperture for all bins of a pupil.
pub(super) struct Aperture {
    optics: Optics,
    pupil: Pupil,
    bin: (f64, f64),
    slope: (f64, f64),
    /// The square of the disc's radius.
    reach: f64,
}

impl Aperture {
    pub(super) fn new(optics: &Optics, pupil: &Pupil) -> Self {
        let (bin, slope) = (optics.bin_size(), optics.cosine_per_bin());
        Self { optics: *optics, pupil: *pupil, bin, slope, reach: (pupil.diameter / 2.0).powi(2) }
    }

    /// The aperture of the bins in a row.
    pub(super) fn row(&self, ky: i64) -> impl Fn(i64) -> bool {
        let (bin_x, slope_x, x, reach) = (self.bin.1, self.slope.1, self.pupil.x, self.reach);
        let (dy, cy) = (ky as f64 * self.bin.0 - self.pupil.y, ky as f64 * self.slope.0);
        let (dy, cy) = (dy * dy, cy * cy);
        let (first_y, first_x) = self.optics.first_bin();
        let is_row = (first_y..first_y + self.optics.height as i64).contains(&ky);
        let columns = first_x..first_x + self.optics.width as i64;
        move |kx| {
            let (dx, cx) = (kx as f64 * bin_x - x, kx as f64 * slope_x);
            is_row && columns.contains(&kx) && dx * dx + dy < reach && cx * cx + cy < 1.0
        }
    }
}

/// Phase of H(q; z) in turns, for `a = (wavelength |q|)^2 < 1`. It is `-(z / wavelength) a / (1 + sqrt(1 - a))`.
///
/// This form loses no digits at small `a`. The phase reaches thousands of turns at 1 m, so reduce it to a fraction before any float32
/// sine.
pub fn propagation_turns(a: f64, depth: f64, wavelength: f64) -> f64 {
    -(depth / wavelength) * (a / (1.0 + (1.0 - a).max(0.0).sqrt()))
}

/// H(q; z) of light with these direction cosines, as (re, im). It is 0 for light that does not propagate.
fn propagated(optics: &Optics, depth: f64, cy: f64, cx: f64) -> (f64, f64) {
    let a = cx * cx + cy * cy;
    if a >= 1.0 {
        return (0.0, 0.0);
    }
    let turns = propagation_turns(a, depth, optics.wavelength);
    let (sin, cos) = (TAU * (turns - turns.round())).sin_cos();
    (cos, sin)
}

/// H(q; z) at an index (row, column) of a transform, as (re, im). It is 0 for light that does not propagate.
pub fn transfer_of_bin(optics: &Optics, depth: f64, [row, column]: [usize; 2]) -> (f64, f64) {
    let (slope_y, slope_x) = optics.cosine_per_bin();
    let cosine = |at: usize, n: usize, slope: f64| frequency_bin(at as i64, n) as f64 * slope;
    propagated(optics, depth, cosine(row, optics.height, slope_y), cosine(column, optics.width, slope_x))
}

/// K(q; p) as (re, im). It is the reference for kernels.
pub fn transfer(optics: &Optics, pupil: &Pupil, ky: i64, kx: i64) -> (f64, f64) {
    if !aperture(optics, pupil, ky, kx) {
        return (0.0, 0.0);
    }
    let (slope_y, slope_x) = optics.cosine_per_bin();
    propagated(optics, pupil.depth, ky as f64 * slope_y, kx as f64 * slope_x)
}
