//! The error of the eye that looks: `transfer *= exp(i 2 pi E)`, E a polynomial about the pupil's centre (OPTICS 11).
//! One pupil pass.

use crate::{Complex32, simd, trig};
use bytemuck::{Pod, Zeroable};

/// A pupil pass's window.
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

/// The polynomial: `E = sum c_ij u^i v^j` turns, `i + j <= degree`, at `u = first[0] + column step[0]`,
/// `v = first[1] + row step[1]`.
#[derive(Debug, Clone, PartialEq)]
pub struct Terms {
    /// Where the window's first bin lies, (u, v).
    pub first: [f64; 2],
    /// From one bin to the next.
    pub step: [f64; 2],
    /// Degree of the polynomial.
    pub degree: u32,
    /// c_ij, by i and then j.
    pub coefficients: Vec<f64>,
}

impl Terms {
    /// How many coefficients a polynomial of this degree has.
    pub fn count(degree: u32) -> usize {
        (degree as usize + 1) * (degree as usize + 2) / 2
    }

    /// As the shader takes them, each a pair of float32 (high, low): the first place, the step, the coefficients.
    pub fn pairs(&self) -> Vec<f32> {
        let values = self.first.iter().chain(&self.step).chain(&self.coefficients);
        values.flat_map(|x| [*x as f32, (x - f64::from(*x as f32)) as f32]).collect()
    }

    /// The polynomial in u alone, at this v: by the power of u.
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

/// `spans`: per row, the half-open interval of columns that pass. `transfer` (rows, columns).
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
