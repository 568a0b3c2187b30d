//! Moves phases with the picture that they show, sub-frame by sub-frame.

use crate::engine::{Buffer, Engine, EngineError};
use crate::optics::{Geometry, Optics};
use crate::plan::Planner;
use eyebox_kernels::trig;
use std::f64::consts::TAU;

/// Memory for the values before and after a move.
#[derive(Default)]
pub(super) struct Carry {
    before: Vec<f32>,
    after: Vec<f32>,
}

impl Carry {
    /// Moves the values of each sub-frame by whole pixels (x, y). Sub-frames after the last shift do not move.
    ///
    /// # Errors
    /// [`EngineError`] if the engine fails.
    pub(super) fn shift(
        &mut self,
        engine: &mut dyn Engine,
        planner: &Planner,
        buffer: Buffer,
        shifts: &[[f64; 2]],
    ) -> Result<(), EngineError> {
        let Planner { slm, grid, frames, .. } = planner;
        let Self { before, after } = self;
        let pixels = slm.height * slm.width;
        for values in [&mut *before, &mut *after] {
            values.resize(frames * pixels, 0.0);
        }
        engine.read_into(buffer, before)?;
        let still = [0.0; 2];
        let shifts = shifts.iter().chain(std::iter::repeat(&still));
        for ((from, to), shift) in before.chunks_exact(pixels).zip(after.chunks_exact_mut(pixels)).zip(shifts) {
            move_frame(from, to, [slm, grid], *shift);
        }
        engine.write(buffer, after)
    }

    /// Returns the values before the last move.
    pub(super) fn before(&self) -> &[f32] {
        &self.before
    }
}

/// Computes the values of a sub-frame whose picture moves by `shift` pixels (x, y).
///
/// If there is a relay, the pattern itself moves and wraps around its edges. In the far field a phase ramp is added.
pub(super) fn move_frame(from: &[f32], to: &mut [f32], [slm, grid]: [&Optics; 2], [x, y]: [f64; 2]) {
    let (h, w) = (slm.height, slm.width);
    if [x, y] == [0.0; 2] {
        return to.copy_from_slice(from);
    }
    match slm.geometry {
        Geometry::Relay => {
            let whole = |v: f64, n: usize| (v.round() as i64).rem_euclid(n as i64) as usize;
            let (dy, dx) = (whole(y, h), whole(x, w));
            for (row, to) in to.chunks_exact_mut(w).enumerate() {
                let from = &from[(row + h - dy) % h * w..][..w];
                to[dx..].copy_from_slice(&from[..w - dx]);
                to[..dx].copy_from_slice(&from[w - dx..]);
            }
        }
        Geometry::FarField => {
            let (per_row, per_column) = (-y / grid.height as f64, -x / grid.width as f64);
            let ramp = |i: usize| TAU * ((i / w) as f64 * per_row + (i % w) as f64 * per_column).fract();
            for (i, (to, from)) in to.iter_mut().zip(from).enumerate() {
                *to = trig::wrap(from + ramp(i) as f32);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pattern_goes_round_its_edges() {
        let optics = Optics::new(3, 4, 8e-6, 520e-9, 0.4).unwrap();
        let from: Vec<f32> = (0..12u8).map(f32::from).collect();
        for (x, y) in [(0, 0), (1, 0), (-1, 0), (0, 1), (-5, 7), (400, -301)] {
            let mut to = vec![0.0; 12];
            move_frame(&from, &mut to, [&optics; 2], [f64::from(x), f64::from(y)]);
            for (i, is) in to.iter().enumerate() {
                let (row, column) = ((i / 4) as i32 - y, (i % 4) as i32 - x);
                let was = row.rem_euclid(3) * 4 + column.rem_euclid(4);
                assert_eq!(*is, was as f32, "{x}, {y}: value {i}");
            }
        }
    }
}
