//! Applies the aberration of the viewer's eye (OPTICS 11). The kernel becomes `transfer *= exp(i 2 pi E)`, with a
//! polynomial E about the center of the pupil. One pupil pass.

use crate::{Complex32, simd, trig};
use bytemuck::{Pod, Zeroable};

/// The window of a pupil pass, and the degree of the polynomial.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
pub struct Args {
    /// Rows of the window.
    pub rows: u32,
    /// Columns of the window.
    pub columns: u32,
    /// Degree of the polynomial.
    pub degree: u32,
}

/// The polynomial `E = sum c_ij u^i v^j` in turns, with `i + j <= degree`, at `u = first[0] + column step[0]` and `v =
/// first[1] + row step[1]`.
#[derive(Debug, Clone, PartialEq)]
pub struct Terms {
    /// Coordinates (u, v) of the first bin of the window.
    pub first: [f64; 2],
    /// Distance (u, v) of neighboring bins.
    pub step: [f64; 2],
    /// Degree of the polynomial.
    pub degree: u32,
    /// The coefficients c_ij, ordered by i, then j.
    pub coefficients: Vec<f64>,
}

impl Terms {
    /// Returns the number of coefficients of a polynomial of this degree.
    pub fn count(degree: u32) -> usize {
        (degree as usize + 1) * (degree as usize + 2) / 2
    }

    /// Returns the first coordinates, the step and the coefficients as the shader reads them, each as a pair of float32
    /// (high, low).
    pub fn pairs(&self) -> Vec<f32> {
        let values = self.first.iter().chain(&self.step).chain(&self.coefficients);
        values.flat_map(|x| [*x as f32, (x - f64::from(*x as f32)) as f32]).collect()
    }

    /// Evaluates the polynomial at this v. `out` receives the coefficients of the polynomial in u, ordered by power.
    fn along(&self, v: f64, out: &mut Vec<f64>) {
        out.clear();
        let mut rest = &self.coefficients[..];
        for i in 0..=self.degree as usize {
            let (row, behind) = rest.split_at(self.degree as usize + 1 - i);
            out.push(row.iter().rev().fold(0.0, |sum, c| sum * v + c));
            rest = behind;
        }
    }
}

const BLOCK: usize = 16;

/// Multiplies `transfer` (rows, columns) by the error of the eye. `spans` holds, per row, the half-open interval of
/// columns that pass.
pub fn eye(args: &Args, terms: &Terms, spans: &[[u32; 2]], transfer: &mut [Complex32]) {
    let mut along = Vec::with_capacity(args.degree as usize + 1);
    simd(
        #[inline(always)]
        || {
            for (j, (row, &[first, end])) in transfer.chunks_exact_mut(args.columns as usize).zip(spans).enumerate() {
                terms.along(terms.first[1] + j as f64 * terms.step[1], &mut along);
                let mut k = first as usize;
                for block in row[k..end as usize].chunks_mut(BLOCK) {
                    let mut sums = [0.0f64; BLOCK];
                    for c in along.iter().rev() {
                        for (i, sum) in sums.iter_mut().enumerate() {
                            *sum = *sum * (terms.first[0] + (k + i) as f64 * terms.step[0]) + c;
                        }
                    }
                    for (z, turns) in block.iter_mut().zip(sums) {
                        let (c, s) = trig::cos_sin(((turns - turns.round_ties_even()) * std::f64::consts::TAU) as f32);
                        *z = Complex32::new(z.re * c - z.im * s, z.re * s + z.im * c);
                    }
                    k += BLOCK;
                }
            }
        },
    );
}
