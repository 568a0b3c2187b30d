//! Transforms columns in place. Neighbors in a row form a vector, so nothing is transposed.
//!
//! The plan decimates in frequency, depth first. The first pass reads rows of the frame and writes scratch. There, each
//! part is contiguous and small enough for the first cache. The last pass writes rows of the frame in digit-reversed
//! order, which costs nothing, because the part of a row in a block is whole cache lines. Multiplications and additions
//! are not fused, so all vector widths give the same bits.

use crate::Complex32;
use pulp::{NullaryFnOnce, Simd, WithSimd};
use std::f64::consts::TAU;

/// Number of columns that are transformed together, which are two cache lines of each row.
pub(crate) const TOGETHER: usize = 16;

/// The passes, at least two, that transform a length whose prime factors are 2, 3, 5 and 7.
pub(crate) struct ColumnPlan {
    passes: Vec<Pass>,
    length: usize,
    /// If true, real and imaginary parts change places at reading and writing, which changes the sign of the exponent.
    inverse: bool,
}

/// A pass transforms `radix` values, each `rest` rows after the one before.
struct Pass {
    radix: usize,
    /// Length of the parts that this pass leaves.
    rest: usize,
    /// Product of the radices of earlier passes, which is the distance between the rows of results of this pass.
    stride: usize,
    /// Factors of results 1 to `radix - 1`, for each of the `rest` transforms.
    twiddles: Vec<Complex32>,
}

impl ColumnPlan {
    /// Returns the plan of a length, or none if it has a prime factor above 7 or is at most 8 with a single pass.
    pub(crate) fn new(length: usize, inverse: bool) -> Option<Self> {
        let (mut rest, mut stride) = (length, 1);
        let mut passes = Vec::new();
        for radix in radices(length)? {
            let angle = |p: usize, k: usize| -TAU * (p * k) as f64 / rest as f64;
            let factor = |angle: f64| Complex32::new(angle.cos() as f32, angle.sin() as f32);
            let parts = rest / radix;
            let twiddles = (0..parts).flat_map(|p| (1..radix).map(move |k| factor(angle(p, k)))).collect();
            passes.push(Pass { radix, rest: parts, stride, twiddles });
            (rest, stride) = (parts, stride * radix);
        }
        Some(Self { passes, length, inverse })
    }

    /// Number of values of scratch that [`transform`](Self::transform) takes.
    pub(crate) fn scratch(&self) -> usize {
        2 * TOGETHER * self.length
    }

    /// Transforms `count` columns of a frame from column `first`. The frame's rows have `width` values.
    ///
    /// It is fastest if frame and scratch begin on a cache line.
    pub(crate) fn transform(
        &self,
        frame: &mut [Complex32],
        width: usize,
        [first, count]: [usize; 2],
        scratch: &mut [Complex32],
    ) {
        crate::simd::vectors(Transform { plan: self, frame, width, first, count, scratch });
    }
}

/// Returns the radices of a length. Eights come first, then at most two fours or one two, then the odd ones. Returns none
/// if a factor is left, or for a single pass.
fn radices(length: usize) -> Option<Vec<usize>> {
    let (mut rest, twos) = (length >> length.trailing_zeros(), length.trailing_zeros() as usize);
    let (eights, fours, two) = match twos % 3 {
        0 => (twos / 3, 0, 0),
        1 if twos > 1 => (twos / 3 - 1, 2, 0),
        1 => (0, 0, 1),
        _ => (twos / 3, 1, 0),
    };
    let mut radices = [(8, eights), (4, fours), (2, two)].map(|(radix, times)| vec![radix; times]).concat();
    for odd in [3, 5, 7] {
        while rest % odd == 0 {
            radices.push(odd);
            rest /= odd;
        }
    }
    (rest == 1 && radices.len() > 1).then_some(radices)
}

struct Transform<'a> {
    plan: &'a ColumnPlan,
    frame: &'a mut [Complex32],
    width: usize,
    first: usize,
    count: usize,
    scratch: &'a mut [Complex32],
}

impl WithSimd for Transform<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { plan, frame, width, first, count, scratch } = self;
        let swapped = plan.inverse;
        let lanes = S::F32_LANES;
        // Columns that do not fill a vector are padded.
        let (work, padded) = scratch.split_at_mut(TOGETHER * plan.length);
        let mut x = 0;
        while x < count {
            let columns = TOGETHER.min(count - x);
            let vectors = columns.div_ceil(lanes);
            if columns % lanes == 0 {
                one_block(
                    simd,
                    plan,
                    Rows { values: floats(frame), stride: 2 * width, at: 2 * (first + x), vectors, swapped },
                    work,
                );
            } else {
                let padded_width = vectors * lanes;
                for (row, line) in frame.chunks_exact(width).zip(padded.chunks_exact_mut(padded_width)) {
                    line[..columns].copy_from_slice(&row[first + x..][..columns]);
                }
                one_block(
                    simd,
                    plan,
                    Rows { values: floats(padded), stride: 2 * padded_width, at: 0, vectors, swapped },
                    work,
                );
                for (row, line) in frame.chunks_exact_mut(width).zip(padded.chunks_exact(padded_width)) {
                    row[first + x..][..columns].copy_from_slice(&line[..columns]);
                }
            }
            x += columns;
        }
    }
}

fn floats(values: &mut [Complex32]) -> &mut [f32] {
    bytemuck::cast_slice_mut(values)
}

/// Real parts and imaginary parts of as many columns as a vector has lanes.
type Complexes<S> = [<S as Simd>::f32s; 2];

/// A block of columns in the rows of a frame, in float32 values.
struct Rows<'a> {
    values: &'a mut [f32],
    stride: usize,
    at: usize,
    vectors: usize,
    swapped: bool,
}

impl Rows<'_> {
    /// Reads one vector of a row, in the order of the cheapest shuffle, which [`write`](Self::write) reverses.
    #[inline(always)]
    fn read<S: Simd>(&self, simd: S, row: usize, vector: usize) -> Complexes<S> {
        let at = row * self.stride + self.at + 2 * vector * S::F32_LANES;
        let (pair, _) = S::as_simd_f32s(&self.values[at..at + 2 * S::F32_LANES]);
        let [re, im] = simd.deinterleave_shfl_f32s([pair[0], pair[1]]);
        if self.swapped { [im, re] } else { [re, im] }
    }

    #[inline(always)]
    fn write<S: Simd>(&mut self, simd: S, row: usize, vector: usize, value: Complexes<S>) {
        let at = row * self.stride + self.at + 2 * vector * S::F32_LANES;
        let (pair, _) = S::as_mut_simd_f32s(&mut self.values[at..at + 2 * S::F32_LANES]);
        let value = if self.swapped { [value[1], value[0]] } else { value };
        [pair[0], pair[1]] = simd.interleave_shfl_f32s(value);
    }
}

#[inline(always)]
fn one_block<S: Simd>(simd: S, plan: &ColumnPlan, mut rows: Rows<'_>, work: &mut [Complex32]) {
    let count = rows.vectors * S::F32_LANES * plan.length;
    let work = S::as_mut_simd_f32s(&mut floats(work)[..2 * count]).0.as_chunks_mut::<2>().0;
    passes::<S>(simd, &plan.passes, &mut rows, work);
}

fn passes<S: Simd>(simd: S, passes: &[Pass], rows: &mut Rows<'_>, work: &mut [Complexes<S>]) {
    match passes {
        [] => {}
        [first, later @ ..] => {
            by_radix(simd, first, First::<S> { rows, work });
            let part = first.rest * rows.vectors;
            for (k, part) in work.chunks_exact_mut(part).enumerate() {
                parts::<S>(simd, later, part, rows, k);
            }
        }
    }
}

/// The later passes over one part, whose results belong to rows from `row`.
fn parts<S: Simd>(simd: S, passes: &[Pass], part: &mut [Complexes<S>], rows: &mut Rows<'_>, row: usize) {
    match passes {
        [] => {}
        [last] => by_radix(simd, last, Last::<S> { part, rows, row, step: 0 }),
        [pass, last] => {
            by_radix(simd, pass, Middle::<S> { part, vectors: rows.vectors });
            by_radix(simd, last, Last::<S> { part, rows, row, step: pass.stride });
        }
        [pass, later @ ..] => {
            by_radix(simd, pass, Middle::<S> { part, vectors: rows.vectors });
            for (k, part) in part.chunks_exact_mut(pass.rest * rows.vectors).enumerate() {
                parts::<S>(simd, later, part, rows, row + k * pass.stride);
            }
        }
    }
}

/// The work of one kind of pass, compiled for each radix.
trait Work<S: Simd> {
    fn run<const R: usize>(self, simd: S, pass: &Pass);
}

#[inline(always)]
fn by_radix<S: Simd, W: Work<S>>(simd: S, pass: &Pass, work: W) {
    match pass.radix {
        2 => simd.vectorize(Run::<S, W, 2> { simd, pass, work }),
        3 => simd.vectorize(Run::<S, W, 3> { simd, pass, work }),
        4 => simd.vectorize(Run::<S, W, 4> { simd, pass, work }),
        5 => simd.vectorize(Run::<S, W, 5> { simd, pass, work }),
        7 => simd.vectorize(Run::<S, W, 7> { simd, pass, work }),
        _ => simd.vectorize(Run::<S, W, 8> { simd, pass, work }),
    }
}

/// A pass of one radix. A closure would not be compiled for the vector instructions.
struct Run<'a, S, W, const R: usize> {
    simd: S,
    pass: &'a Pass,
    work: W,
}

impl<S: Simd, W: Work<S>, const R: usize> NullaryFnOnce for Run<'_, S, W, R> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        self.work.run::<R>(self.simd, self.pass);
    }
}

/// The first pass reads rows of the frame and writes scratch, part by part.
struct First<'a, 'r, S: Simd> {
    rows: &'a Rows<'r>,
    work: &'a mut [Complexes<S>],
}

impl<S: Simd> Work<S> for First<'_, '_, S> {
    #[inline(always)]
    fn run<const R: usize>(self, simd: S, pass: &Pass) {
        let vectors = self.rows.vectors;
        let mut parts = split::<S, R>(self.work);
        for (p, twiddles) in pass.twiddles.chunks_exact(R - 1).enumerate() {
            for v in 0..vectors {
                let mut values = [zero(simd); R];
                for (k, value) in values.iter_mut().enumerate() {
                    *value = self.rows.read(simd, p + k * pass.rest, v);
                }
                let results = turned::<S, R>(simd, dft::<S, R>(simd, values), twiddles);
                for (part, result) in parts.iter_mut().zip(results) {
                    part[p * vectors + v] = result;
                }
            }
        }
    }
}

/// A middle pass stays in one part of scratch.
struct Middle<'a, S: Simd> {
    part: &'a mut [Complexes<S>],
    vectors: usize,
}

impl<S: Simd> Work<S> for Middle<'_, S> {
    #[inline(always)]
    fn run<const R: usize>(self, simd: S, pass: &Pass) {
        let mut parts = split::<S, R>(self.part);
        for (p, twiddles) in pass.twiddles.chunks_exact(R - 1).enumerate() {
            for at in p * self.vectors..(p + 1) * self.vectors {
                let mut values = [zero(simd); R];
                for (value, part) in values.iter_mut().zip(&parts) {
                    *value = part[at];
                }
                let results = turned::<S, R>(simd, dft::<S, R>(simd, values), twiddles);
                for (part, result) in parts.iter_mut().zip(results) {
                    part[at] = result;
                }
            }
        }
    }
}

/// The last pass reads groups of `radix` values from scratch and writes rows, each group `step` rows after the one before.
struct Last<'a, 'r, S: Simd> {
    part: &'a [Complexes<S>],
    rows: &'a mut Rows<'r>,
    row: usize,
    step: usize,
}

impl<S: Simd> Work<S> for Last<'_, '_, S> {
    #[inline(always)]
    fn run<const R: usize>(self, simd: S, pass: &Pass) {
        let vectors = self.rows.vectors;
        for (group, values) in self.part.chunks_exact(R * vectors).enumerate() {
            let row = self.row + group * self.step;
            for v in 0..vectors {
                let mut group = [zero(simd); R];
                for (k, value) in group.iter_mut().enumerate() {
                    *value = values[k * vectors + v];
                }
                let results = dft::<S, R>(simd, group);
                for (k, result) in results.into_iter().enumerate() {
                    self.rows.write(simd, row + k * pass.stride, v, result);
                }
            }
        }
    }
}

/// Returns `R` parts of equal length.
#[inline(always)]
fn split<S: Simd, const R: usize>(values: &mut [Complexes<S>]) -> [&mut [Complexes<S>]; R] {
    let mut parts = values.chunks_exact_mut(values.len() / R);
    std::array::from_fn(|_| parts.next().unwrap_or_default())
}

#[inline(always)]
fn turned<S: Simd, const R: usize>(
    simd: S,
    mut values: [Complexes<S>; R],
    twiddles: &[Complex32],
) -> [Complexes<S>; R] {
    for (value, twiddle) in values[1..].iter_mut().zip(twiddles) {
        let (c, s) = (simd.splat_f32s(twiddle.re), simd.splat_f32s(twiddle.im));
        let [re, im] = *value;
        *value = [
            simd.sub_f32s(simd.mul_f32s(re, c), simd.mul_f32s(im, s)),
            simd.add_f32s(simd.mul_f32s(re, s), simd.mul_f32s(im, c)),
        ];
    }
    values
}

#[inline(always)]
fn zero<S: Simd>(simd: S) -> Complexes<S> {
    [simd.splat_f32s(0.0); 2]
}

#[inline(always)]
fn add<S: Simd>(simd: S, a: Complexes<S>, b: Complexes<S>) -> Complexes<S> {
    [simd.add_f32s(a[0], b[0]), simd.add_f32s(a[1], b[1])]
}

#[inline(always)]
fn sub<S: Simd>(simd: S, a: Complexes<S>, b: Complexes<S>) -> Complexes<S> {
    [simd.sub_f32s(a[0], b[0]), simd.sub_f32s(a[1], b[1])]
}

#[inline(always)]
fn scale<S: Simd>(simd: S, a: Complexes<S>, by: f32) -> Complexes<S> {
    let by = simd.splat_f32s(by);
    [simd.mul_f32s(a[0], by), simd.mul_f32s(a[1], by)]
}

/// Returns `a - i b` and `a + i b`.
#[inline(always)]
fn quarter_turns<S: Simd>(simd: S, a: Complexes<S>, b: Complexes<S>) -> [Complexes<S>; 2] {
    let minus = [simd.add_f32s(a[0], b[1]), simd.sub_f32s(a[1], b[0])];
    let plus = [simd.sub_f32s(a[0], b[1]), simd.add_f32s(a[1], b[0])];
    [minus, plus]
}

/// Transforms `R` values. The compiler knows the radix and leaves one branch.
#[inline(always)]
fn dft<S: Simd, const R: usize>(simd: S, a: [Complexes<S>; R]) -> [Complexes<S>; R] {
    let mut out = a;
    match R {
        2 => [out[0], out[1]] = [add(simd, a[0], a[1]), sub(simd, a[0], a[1])],
        4 => out.copy_from_slice(&four::<S>(simd, [a[0], a[1], a[2], a[3]])),
        8 => {
            let even = four::<S>(simd, [a[0], a[2], a[4], a[6]]);
            let odd = four::<S>(simd, [a[1], a[3], a[5], a[7]]);
            let half = std::f32::consts::FRAC_1_SQRT_2;
            // An eighth of a turn is (z -+ i z) / sqrt 2. Three eighths are one more quarter.
            let [eighth, _] = quarter_turns::<S>(simd, odd[1], odd[1]);
            let [_, three] = quarter_turns::<S>(simd, odd[3], odd[3]);
            let (eighth, three) = (scale(simd, eighth, half), scale(simd, three, -half));
            (out[0], out[4]) = (add(simd, even[0], odd[0]), sub(simd, even[0], odd[0]));
            (out[1], out[5]) = (add(simd, even[1], eighth), sub(simd, even[1], eighth));
            [out[2], out[6]] = quarter_turns::<S>(simd, even[2], odd[2]);
            (out[3], out[7]) = (add(simd, even[3], three), sub(simd, even[3], three));
        }
        _ => {
            // Sums and differences of the values k and R - k.
            let mut sums = [a[0]; 4];
            let mut differences = [a[0]; 4];
            for k in 1..=R / 2 {
                sums[k] = add(simd, a[k], a[R - k]);
                differences[k] = sub(simd, a[k], a[R - k]);
                out[0] = add(simd, out[0], sums[k]);
            }
            for j in 1..=R / 2 {
                let (mut even, mut odd) = (a[0], scale(simd, differences[1], SINES[R / 2][j]));
                even = add(simd, even, scale(simd, sums[1], COSINES[R / 2][j]));
                for k in 2..=R / 2 {
                    even = add(simd, even, scale(simd, sums[k], COSINES[R / 2][j * k % R]));
                    odd = add(simd, odd, scale(simd, differences[k], SINES[R / 2][j * k % R]));
                }
                [out[j], out[R - j]] = quarter_turns::<S>(simd, even, odd);
            }
        }
    }
    out
}

#[inline(always)]
fn four<S: Simd>(simd: S, a: [Complexes<S>; 4]) -> [Complexes<S>; 4] {
    let (even, even_difference) = (add(simd, a[0], a[2]), sub(simd, a[0], a[2]));
    let (odd, odd_difference) = (add(simd, a[1], a[3]), sub(simd, a[1], a[3]));
    let [one, three] = quarter_turns::<S>(simd, even_difference, odd_difference);
    [add(simd, even, odd), one, sub(simd, even, odd), three]
}

/// Cosines of `2 pi k / R`, by `R / 2`, for R of 3, 5 and 7.
const COSINES: [[f32; 7]; 4] = [
    [0.0; 7],
    [1.0, -0.5, -0.5, 0.0, 0.0, 0.0, 0.0],
    [1.0, 0.309_017, -0.809_017, -0.809_017, 0.309_017, 0.0, 0.0],
    [1.0, 0.623_489_8, -0.222_520_93, -0.900_968_87, -0.900_968_87, -0.222_520_93, 0.623_489_8],
];

/// Sines of `2 pi k / R`, in the layout of [`COSINES`].
const SINES: [[f32; 7]; 4] = [
    [0.0; 7],
    [0.0, 0.866_025_4, -0.866_025_4, 0.0, 0.0, 0.0, 0.0],
    [0.0, 0.951_056_5, 0.587_785_25, -0.587_785_25, -0.951_056_5, 0.0, 0.0],
    [0.0, 0.781_831_5, 0.974_927_9, 0.433_883_74, -0.433_883_74, -0.974_927_9, -0.781_831_5],
];

#[cfg(test)]
#[path = "fft_columns_tests.rs"]
mod tests;
