//! Compensates the motion of an eye during the sub-frames (OPTICS 15). The field becomes
//! `window[f] *= weight_f A_f exp(2 pi i turns)`. The field of each sub-frame is shifted by its own phase, whose turns
//! are linear in the bins. The pupil at that moment cuts the field, and a factor weights it. The way back is the
//! adjoint. One sub-frame of one pupil.

use crate::{Complex32, ZERO, simd, trig};
use bytemuck::{Pod, Zeroable};
use std::f32::consts::TAU;

/// Columns whose factors are computed at once.
const BLOCK: usize = 64;

/// The window of a pupil pass, and the range of sub-frames.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
pub struct Args {
    /// Rows of the window.
    pub rows: u32,
    /// Columns of the window.
    pub columns: u32,
    /// Number of sub-frames in the table.
    pub frames: u32,
    /// Sub-frame of the table with which the dispatch begins.
    pub first: u32,
    /// 0 for the forward direction, 1 for its adjoint.
    pub back: u32,
}

/// The shift of one sub-frame, applied to the bins of its window.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Shift {
    /// Turns from one row to the next, from one column to the next, and at the first bin of the window.
    pub turns: [f64; 3],
    /// Factor on the field. It is 0 for a sub-frame that the eye does not see.
    pub weight: f64,
}

/// The table of the shader. It holds the shifts of all sub-frames and, per sub-frame and row, the columns that the
/// pupil of that sub-frame passes. The default has no sub-frames.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Table {
    frames: usize,
    rows: usize,
    /// Four float32 per sub-frame (turns per row, turns per column, turns at the first bin, weight), then spans
    /// (sub-frames, rows, 2).
    words: Vec<u32>,
}

impl Table {
    /// Replaces the contents by these sub-frames, in the memory that the table already has. `spans` gives all rows of
    /// the first sub-frame, then of the second, and so on.
    pub fn refill(&mut self, shifts: impl Iterator<Item = Shift>, spans: impl Iterator<Item = [u32; 2]>) {
        let bits = |x: f64| (x as f32).to_bits();
        let shift = |s: Shift| {
            let [down, along, first] = s.turns;
            [bits(down), bits(along), bits(first - first.round()), bits(s.weight)]
        };
        self.words.clear();
        self.words.extend(shifts.flat_map(shift));
        self.frames = self.words.len() / 4;
        self.words.extend(spans.flatten());
        self.rows = (self.words.len() / 2 - 2 * self.frames) / self.frames.max(1);
    }

    /// Removes all sub-frames, and keeps the memory.
    pub fn clear(&mut self) {
        self.refill(std::iter::empty(), std::iter::empty());
    }

    /// Returns the number of sub-frames.
    pub fn frames(&self) -> usize {
        self.frames
    }

    /// Returns the table as the shader reads it.
    pub fn words(&self) -> &[u32] {
        &self.words
    }

    fn shift(&self, frame: usize) -> [f32; 4] {
        std::array::from_fn(|i| f32::from_bits(self.words[4 * frame + i]))
    }

    fn spans(&self, frame: usize) -> &[[u32; 2]] {
        let spans = &self.words[4 * self.frames..][2 * frame * self.rows..][..2 * self.rows];
        bytemuck::cast_slice(spans)
    }
}

/// Shifts `window` (rows, columns) of sub-frame `args.first`. It is zero outside the spans of that sub-frame.
pub fn motion(args: &Args, table: &Table, window: &mut [Complex32]) {
    let (frame, columns) = (args.first as usize, args.columns as usize);
    let ([down, along, first, weight], spans) = (table.shift(frame), table.spans(frame));
    if weight == 0.0 {
        window.fill(ZERO);
        return;
    }
    let sign = if args.back == 0 { TAU } else { -TAU };
    let factor = |turns: f32| {
        let (c, s) = trig::cos_sin((turns - turns.round_ties_even()) * sign);
        Complex32::new(c, s)
    };
    for (row, &[start, end]) in window.chunks_exact_mut(columns).zip(spans) {
        row[..start as usize].fill(ZERO);
        row[end as usize..].fill(ZERO);
    }
    simd(
        #[inline(always)]
        || {
            for begin in (0..columns).step_by(BLOCK) {
                let mut factors = [ZERO; BLOCK];
                for (i, f) in factors.iter_mut().enumerate() {
                    *f = factor(along * (begin + i) as f32);
                }
                for (j, (row, &[start, end])) in window.chunks_exact_mut(columns).zip(spans).enumerate() {
                    let (start, end) = ((start as usize).max(begin), (end as usize).min(begin + BLOCK));
                    if start >= end {
                        continue;
                    }
                    let row_factor = factor(first + down * j as f32);
                    let row_factor = Complex32::new(row_factor.re * weight, row_factor.im * weight);
                    for (z, f) in row[start..end].iter_mut().zip(&factors[start - begin..]) {
                        let f = Complex32::new(
                            f.re * row_factor.re - f.im * row_factor.im,
                            f.re * row_factor.im + f.im * row_factor.re,
                        );
                        *z = Complex32::new(z.re * f.re - z.im * f.im, z.re * f.im + z.im * f.re);
                    }
                }
            }
        },
    );
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Complex64;
    use proptest::prelude::*;

    /// Shifts of sub-frames, each with the spans of its rows.
    type Shifts = Vec<(Shift, Vec<[u32; 2]>)>;

    fn table(rows: usize, columns: usize, frames: usize, seed: u64) -> (Table, Shifts) {
        let number = |i: u64| {
            let x = seed.wrapping_add(i.wrapping_mul(0x9e37_79b9_7f4a_7c15)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
            (x >> 40) as f64 / (1u64 << 24) as f64
        };
        let one = |f: u64| {
            let turns = [number(3 * f) - 0.5, number(3 * f + 1) - 0.5, 40.0 * number(3 * f + 2)];
            let span = |j: u64| {
                let start = (number(1000 + f * 97 + j) * columns as f64) as u32;
                [start, start + (number(5000 + f * 89 + j) * f64::from(columns as u32 - start)) as u32]
            };
            (Shift { turns, weight: if f == 2 { 0.0 } else { 0.5 + f as f64 } }, (0..rows as u64).map(span).collect())
        };
        let all: Vec<_> = (0..frames as u64).map(one).collect();
        let mut table = Table::default();
        table.refill(all.iter().map(|(s, _)| *s), all.iter().flat_map(|(_, spans)| spans).copied());
        (table, all)
    }

    proptest! {
        /// Compared with the formula in float64. The way back must be the adjoint, <a, M b> = <M* a, b>.
        #[test]
        fn is_a_shift_with_its_adjoint(rows in 1usize..9, columns in 1usize..150, seed in 0u64..1000) {
            let (table, exact) = table(rows, columns, 3, seed);
            let field = |salt: f32| (0..rows * columns).map(move |i| Complex32::new((i as f32 * 0.7 + salt).sin(), (i as f32 * 1.3 - salt).cos()));
            for (frame, (shift, spans)) in exact.iter().enumerate() {
                let args = Args { rows: rows as u32, columns: columns as u32, frames: 3, first: frame as u32, back: 0 };
                let (mut down, mut up): (Vec<_>, Vec<_>) = (field(0.1).collect(), field(2.0).collect());
                motion(&args, &table, &mut down);
                motion(&Args { back: 1, ..args }, &table, &mut up);
                let dot = |a: &mut dyn Iterator<Item = Complex32>, b: &mut dyn Iterator<Item = Complex32>| {
                    let double = |z: Complex32| Complex64::new(z.re.into(), z.im.into());
                    a.zip(b).map(|(a, b)| double(a).conj() * double(b)).sum::<Complex64>()
                };
                let (one, other) = (dot(&mut field(2.0), &mut down.iter().copied()), dot(&mut up.iter().copied(), &mut field(0.1)));
                prop_assert!((one - other).norm() < 1e-5 * (rows * columns) as f64, "{one} {other}");
                for (i, (got, was)) in down.iter().zip(field(0.1)).enumerate() {
                    let (j, k) = (i / columns, i % columns);
                    let inside = (spans[j][0]..spans[j][1]).contains(&(k as u32));
                    let turns = shift.turns[2] + shift.turns[0] * j as f64 + shift.turns[1] * k as f64;
                    let factor = Complex64::from_polar(if inside { shift.weight } else { 0.0 }, turns * std::f64::consts::TAU);
                    let want = Complex64::new(was.re.into(), was.im.into()) * factor;
                    // A phase of a few hundred turns in float32 has a precision of 2^-18 turns.
                    prop_assert!((Complex64::new(got.re.into(), got.im.into()) - want).norm() < 2e-4, "({j}, {k}): {got} {want}");
                }
            }
        }
    }
}
