//! Evens out the light over the eyebox by changing the spectrum (Chakravarthula et al. 2022, OPTICS 7). The
//! change brings the light of each patch nearer to the mean of all patches. One sub-frame is changed at a time, and the
//! light of the patches is the sum over all sub-frames.

use crate::{Complex32, energy, simd};
use bytemuck::{Pod, Zeroable};

/// The `mode` that scales the amplitudes of each patch to the mean energy, as the projection does.
pub const PROJECTION: u32 = 0;
/// The `mode` with the derivative of `weight` times the mean of `(energy / mean - 1)^2`.
pub const GRADIENT: u32 = 1;

/// The patches, and the strength of the term.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct Args {
    /// Position of the patches in the spectrum.
    pub place: energy::Args,
    /// One of [`PROJECTION`] and [`GRADIENT`].
    pub mode: u32,
    /// Weight of the term. In [`PROJECTION`] it is divided by the points of the grid, because `change` has these units.
    pub weight: f32,
    /// Largest ratio of amplitudes in [`PROJECTION`].
    pub limit: f32,
}

impl Args {
    /// Returns the factor for the spectrum of each patch, from the energies of the patches (patches, patches). Patches
    /// outside the disc have the factor 0.
    fn factors(&self, energy: &[f32]) -> Vec<f32> {
        let patches = self.place.patches;
        let counts = |i: usize| self.place.counts(i as u32 / patches, i as u32 % patches);
        let (mut n, mut sum, mut squares) = (0.0f32, 0.0f32, 0.0f32);
        for (_, e) in energy.iter().enumerate().filter(|(i, _)| counts(*i)) {
            n += 1.0;
            sum += e;
        }
        let mean = sum / n.max(1.0);
        if mean.is_nan() || mean <= 0.0 {
            return vec![0.0; energy.len()];
        }
        for (_, e) in energy.iter().enumerate().filter(|(i, _)| counts(*i)) {
            squares += (e / mean - 1.0) * (e / mean - 1.0);
        }
        let variance = squares / n;
        let factor = |(i, e): (usize, &f32)| {
            if !counts(i) {
                0.0
            } else if self.mode == PROJECTION {
                let ratio = (mean / e.max(f32::MIN_POSITIVE)).sqrt();
                self.weight * (ratio.min(self.limit) - 1.0)
            } else {
                // The mean depends on the energies too, which gives the term with the variance.
                2.0 * self.weight / (n * mean) * (e / mean - 1.0 - variance)
            }
        };
        energy.iter().enumerate().map(factor).collect()
    }
}

/// Adds to `change` (grid_height, grid_width) the spectrum `field` (grid_height, grid_width) times the factors of the
/// patches. `energy` holds the energies (patches, patches) in its first `patches` squared values.
pub fn equalise_eyebox(args: &Args, energy: &[f32], field: &[Complex32], change: &mut [Complex32]) {
    let place = &args.place;
    let (height, width) = (place.grid_height as usize, place.grid_width as usize);
    let factors = args.factors(&energy[..(place.patches * place.patches) as usize]);
    simd(
        #[inline(always)]
        || {
            for (patch, factor) in factors.iter().enumerate().filter(|(_, f)| **f != 0.0) {
                let (a, b) = (patch as u32 / place.patches, patch as u32 % place.patches);
                for j in place.part(a, place.rows) {
                    let row = (place.y0 + j) as usize % height * width;
                    for k in place.part(b, place.columns) {
                        let at = row + (place.x0 + k) as usize % width;
                        change[at] += field[at] * factor;
                    }
                }
            }
        },
    );
}
