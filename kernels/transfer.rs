//! Computes the propagation kernel `K(q; p)` on the window of a pupil, `exp(i 2 pi turns)` (OPTICS 2).

use crate::{Complex32, ZERO, simd, trig};
use bytemuck::{Pod, Zeroable};

/// One pupil's window. The kernel is zero outside the spans. The shader takes each float64 as a pair of float32 (high,
/// low).
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct Args {
    /// `(wavelength / (grid_height * pitch))^2`, for `a = slope_y ky^2 + slope_x kx^2` with the shifts included.
    pub slope_y: f64,
    /// The same along columns, `(wavelength / (grid_width * pitch))^2`.
    pub slope_x: f64,
    /// Propagation distance in turns, `depth / wavelength`.
    pub turns: f64,
    /// Bins by which the light of an off-axis source arrives elsewhere, in rows (OPTICS 12).
    pub shift_y: f64,
    /// Bins by which it arrives elsewhere, in columns.
    pub shift_x: f64,
    /// Row of the first bin (signed).
    pub y0: i32,
    /// Column of the first bin (signed).
    pub x0: i32,
    /// Rows of the window.
    pub rows: u32,
    /// Columns of the window.
    pub columns: u32,
}

impl Args {
    /// Returns slopes, turns and shifts as the shader takes them, each as a pair of float32 (high, low).
    pub fn pairs(&self) -> [[f32; 2]; 5] {
        let pair = |x: f64| [x as f32, (x - f64::from(x as f32)) as f32];
        [self.slope_y, self.slope_x, self.turns, self.shift_y, self.shift_x].map(pair)
    }
}

const BLOCK: usize = 16;

/// Writes `out` (rows, columns). `spans` holds, per row, the half-open interval of columns that pass.
///
/// The phase reaches thousands of turns, so it is reduced to a fraction of a turn in float64 before the float32 sine.
pub fn transfer(args: &Args, spans: &[[u32; 2]], out: &mut [Complex32]) {
    simd(
        #[inline(always)]
        || {
            for (j, (row, &[first, end])) in out.chunks_exact_mut(args.columns as usize).zip(spans).enumerate() {
                let (first, end) = (first as usize, end as usize);
                row[..first].fill(ZERO);
                row[end..].fill(ZERO);
                let ky = f64::from(args.y0) + j as f64 + args.shift_y;
                let across = args.slope_y * (ky * ky);
                let mut k = first;
                for block in row[first..end].chunks_mut(BLOCK) {
                    let mut phases = [0.0f32; BLOCK];
                    for (i, phase) in phases.iter_mut().enumerate() {
                        let kx = f64::from(args.x0) + (k + i) as f64 + args.shift_x;
                        // Lanes beyond the end of the block may be evanescent. Their root is kept real, and they are
                        // not stored.
                        let a = (across + args.slope_x * (kx * kx)).min(1.0);
                        let turns = -args.turns * (a / (1.0 + (1.0 - a).sqrt()));
                        *phase = ((turns - turns.round_ties_even()) * std::f64::consts::TAU) as f32;
                    }
                    for (z, &phase) in block.iter_mut().zip(&phases) {
                        let (c, s) = trig::cos_sin(phase);
                        *z = Complex32::new(c, s);
                    }
                    k += BLOCK;
                }
            }
        },
    );
}
