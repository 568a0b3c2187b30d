//! Makes the tables of a static phase mask for the kernels (OPTICS 12).

use super::Buffer;
use crate::optics::{Display, Mask, Optics, transfer_of_bin};
use eyebox_kernels::modulate_mask::MOST;
use rayon::prelude::*;
use std::f64::consts::TAU;
use std::sync::OnceLock;

/// The mask of a display at one wavelength, on a grid of its own pixels.
#[derive(Debug)]
pub(super) struct MaskTables {
    mask: Mask,
    /// Turns of the light per turn of the mask's phases.
    slope: f64,
    slm: Optics,
    grid: Optics,
    values: OnceLock<Vec<f32>>,
    transfer: OnceLock<Vec<f32>>,
}

impl PartialEq for MaskTables {
    /// Compares the inputs of the tables.
    fn eq(&self, other: &Self) -> bool {
        let of = |t: &Self| (t.slope, t.slm, t.grid);
        self.mask == other.mask && of(self) == of(other)
    }
}

impl MaskTables {
    /// Returns the tables of this display on its SLM inside a grid, or none if it has no mask.
    pub fn of(display: &Display, slm: Optics, grid: Optics) -> Option<Self> {
        let (mask, slope) = (display.mask.clone()?, display.mask_slope(slm.wavelength));
        Some(Self { mask, slope, slm, grid, values: OnceLock::new(), transfer: OnceLock::new() })
    }

    /// Returns the mask pixels along an axis of one pixel of the SLM.
    pub(super) fn factor(&self) -> usize {
        self.mask.factor
    }

    /// Returns the distance from the SLM in meters.
    pub(super) fn distance(&self) -> f64 {
        self.mask.distance()
    }

    /// Returns the coverage of each mask pixel by a pixel of the SLM with this linear fill, over the mean coverage.
    /// All are covered if pixels are points, because then their size is not known (OPTICS 10).
    pub(super) fn cover(&self, fill: f64) -> [f32; MOST] {
        let (k, fill) = (self.mask.factor as f64, if fill > 0.0 { fill } else { 1.0 });
        std::array::from_fn(|i| {
            let (from, to) = (i as f64 / k, (i + 1) as f64 / k);
            let covered = (to.min(0.5 + 0.5 * fill) - from.max(0.5 - 0.5 * fill)).max(0.0);
            (k * covered / fill) as f32
        })
    }

    /// Returns the tables with their buffers.
    pub(super) fn buffers(&self) -> impl Iterator<Item = (Buffer, &[f32])> {
        let transfer = (self.distance() > 0.0).then(|| (Buffer::MaskTransfer, self.transfer()));
        [Some((Buffer::Mask, self.values())), transfer].into_iter().flatten()
    }

    fn values(&self) -> &[f32] {
        self.values.get_or_init(|| {
            let size = [self.slm.height, self.slm.width].map(|n| n * self.mask.factor);
            let unit = |turn: f32| {
                let (sin, cos) = (TAU * self.slope * f64::from(turn)).sin_cos();
                [cos as f32, sin as f32]
            };
            self.mask.turns(size).into_iter().flat_map(unit).collect()
        })
    }

    fn transfer(&self) -> &[f32] {
        self.transfer.get_or_init(|| {
            let mut values = vec![0.0f32; 2 * self.grid.height * self.grid.width];
            values.par_chunks_exact_mut(2 * self.grid.width).enumerate().for_each(|(row, out)| {
                for (column, out) in out.chunks_exact_mut(2).enumerate() {
                    let (re, im) = transfer_of_bin(&self.grid, self.distance(), [row, column]);
                    out.copy_from_slice(&[re as f32, im as f32]);
                }
            });
            values
        })
    }
}
