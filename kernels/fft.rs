//! Transforms complex frames in two dimensions, without a factor, pruned to the columns in use.
//!
//! Forward transforms take all rows, then the columns in use. Inverse transforms take the columns in use, then all rows,
//! and all other columns must be zero.
//! RustFFT transforms the rows, and columns whose length has a prime factor above 7. The shaders have other plans.

use crate::fft_columns::{ColumnPlan, TOGETHER};
use crate::{Complex32, ZERO};
use num_complex::Complex64;
use rayon::prelude::*;
use rustfft::{Fft, FftDirection, FftPlanner};
use std::cell::RefCell;
use std::collections::HashMap;
use std::sync::{Arc, Mutex};

/// The sign of the exponent.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Direction {
    /// `exp(-i 2 pi k n / N)`.
    Forward,
    /// `exp(+i 2 pi k n / N)`, without `1 / N`.
    Inverse,
}

impl From<Direction> for FftDirection {
    fn from(direction: Direction) -> Self {
        if direction == Direction::Forward { Self::Forward } else { Self::Inverse }
    }
}

/// Transforms consecutive lines of `length` values in float64, without a factor.
///
/// References and tables use it. It is in this crate so that RustFFT is compiled once.
pub fn transform_f64(lines: &mut [Complex64], length: usize, direction: Direction) {
    thread_local! {
        /// Keeps the twiddle factors of earlier lengths.
        static PLANNER: RefCell<FftPlanner<f64>> = RefCell::new(FftPlanner::new());
    }
    PLANNER.with_borrow_mut(|planner| planner.plan_fft(length, direction.into())).process(lines);
}

/// The columns in use, `count` of them from `first`. They continue at the left edge.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Columns {
    /// The first column.
    pub first: usize,
    /// Number of columns.
    pub count: usize,
}

impl Columns {
    /// Returns all columns of a frame.
    pub fn all(width: usize) -> Self {
        Self { first: 0, count: width }
    }

    /// Returns the shortest interval that holds all the given ones. It may continue at the left edge.
    pub fn union(width: usize, intervals: impl Iterator<Item = Columns> + Clone) -> Self {
        let intervals = intervals.filter(|interval| interval.count > 0);
        let ahead = |from: usize, to: usize| (to % width + width - from % width) % width;
        // Distance from a column to the next interval, 0 for a column in use.
        let unused = |from: usize| {
            let next = |i: Columns| if ahead(i.first, from) < i.count { 0 } else { ahead(from, i.first) };
            intervals.clone().map(next).min().unwrap_or(0)
        };
        // The longest run of unused columns begins behind an interval and stays outside. If several have this length, the
        // first one does.
        let Some(start) = intervals.clone().map(|i| i.first % width).min() else { return Self { first: 0, count: 0 } };
        let runs = intervals.clone().map(|i| i.first + i.count).map(|end| (unused(end), end));
        let later = |end: usize| std::cmp::Reverse(ahead(start, end));
        let longest = runs.filter(|(run, _)| *run > 0).max_by_key(|(run, end)| (*run, later(*end)));
        let (run, end) = longest.unwrap_or((0, start));
        Self { first: (end + run) % width, count: width - run }
    }

    /// Returns the contiguous pieces as (first, count), at most two.
    fn pieces(self, width: usize) -> impl Iterator<Item = (usize, usize)> {
        let ahead = self.count.min(width - self.first.min(width));
        [(self.first, ahead), (0, self.count - ahead)].into_iter().filter(|p| p.1 > 0)
    }
}

type Plan = Arc<dyn Fft<f32>>;

/// Rounds values when they are stored, between the axes and at the end. It does nothing for float32.
pub type Store = fn(&mut [Complex32]);

/// The method for columns of one length.
#[derive(Clone)]
enum Down {
    /// Columns are transformed in place.
    InPlace(Arc<ColumnPlan>),
    /// Columns are gathered into rows, because [`ColumnPlan`] does not take the length.
    Gathered(Plan),
}

/// Plans by length and direction, which are made at their first use.
#[derive(Default)]
pub struct Plans {
    rows: Mutex<HashMap<(usize, Direction), Plan>>,
    columns: Mutex<HashMap<(usize, Direction), Down>>,
}

thread_local! {
    static SCRATCH: RefCell<(Vec<Complex32>, Vec<Complex32>)> = const { RefCell::new((Vec::new(), Vec::new())) };
}

impl Plans {
    fn along(&self, length: usize, direction: Direction) -> Plan {
        let mut made = self.rows.lock().unwrap_or_else(|e| e.into_inner());
        let plan =
            made.entry((length, direction)).or_insert_with(|| FftPlanner::new().plan_fft(length, direction.into()));
        Arc::clone(plan)
    }

    fn down(&self, length: usize, direction: Direction) -> Down {
        let mut made = self.columns.lock().unwrap_or_else(|e| e.into_inner());
        let plan = || match ColumnPlan::new(length, direction == Direction::Inverse) {
            Some(plan) => Down::InPlace(Arc::new(plan)),
            None => Down::Gathered(self.along(length, direction)),
        };
        made.entry((length, direction)).or_insert_with(plan).clone()
    }

    /// Makes the plans for frames of these rows and columns.
    pub fn prepare(&self, [height, width]: [usize; 2]) {
        for direction in [Direction::Forward, Direction::Inverse] {
            self.along(width, direction);
            self.down(height, direction);
        }
    }

    /// Transforms `frame` (height, width) in place, on this thread.
    pub fn fft(
        &self,
        frame: &mut [Complex32],
        height: usize,
        width: usize,
        direction: Direction,
        columns: Columns,
        store: Store,
    ) {
        if direction == Direction::Forward {
            self.rows(frame, width, direction, store);
        }
        self.columns(frame, height, width, direction, columns, store);
        if direction == Direction::Inverse {
            self.rows(frame, width, direction, store);
        }
    }

    /// Transforms only the rows.
    pub fn rows(&self, frame: &mut [Complex32], width: usize, direction: Direction, store: Store) {
        if width > 1 {
            in_place(&self.along(width, direction), frame);
            store(frame);
        }
    }

    /// Transforms only the columns in use.
    pub fn columns(
        &self,
        frame: &mut [Complex32],
        height: usize,
        width: usize,
        direction: Direction,
        columns: Columns,
        store: Store,
    ) {
        if height < 2 {
            return;
        }
        let down = self.down(height, direction);
        for (first, count) in columns.pieces(width) {
            down.transform(frame, width, [first, count]);
            for row in frame.chunks_exact_mut(width) {
                store(&mut row[first..first + count]);
            }
        }
    }

    /// Does the same as [`fft`](Self::fft) on all cores, with the same bits. `blocks` holds a copy of the columns and
    /// grows as needed.
    #[allow(clippy::too_many_arguments)]
    pub fn fft_wide(
        &self,
        frame: &mut [Complex32],
        height: usize,
        width: usize,
        direction: Direction,
        columns: Columns,
        blocks: &mut Vec<Complex32>,
        store: Store,
    ) {
        let (rows, down) = (self.along(width, direction), self.down(height, direction));
        let along = |frame: &mut [Complex32]| {
            let some = width * height.div_ceil(4 * rayon::current_num_threads());
            frame.par_chunks_mut(some.max(width)).for_each(|part| {
                in_place(&rows, part);
                store(part);
            });
        };
        if direction == Direction::Forward && width > 1 {
            along(frame);
        }
        if height > 1 && columns.count > 0 {
            // Block by block of neighboring columns, each a frame of its own.
            let blocks = room(blocks, columns.count * height);
            let from = &*frame;
            blocks.par_chunks_mut(TOGETHER * height).enumerate().for_each(|(b, block)| {
                let count = block.len() / height;
                for (row, line) in from.chunks_exact(width).zip(block.chunks_exact_mut(count)) {
                    for (i, value) in line.iter_mut().enumerate() {
                        *value = row[(columns.first + b * TOGETHER + i) % width];
                    }
                }
                down.transform(block, count, [0, count]);
                store(block);
            });
            let blocks = &*blocks;
            frame.par_chunks_mut(width).enumerate().for_each(|(y, row)| {
                for (b, block) in blocks.chunks(TOGETHER * height).enumerate() {
                    let count = block.len() / height;
                    for (i, value) in block[y * count..][..count].iter().enumerate() {
                        row[(columns.first + b * TOGETHER + i) % width] = *value;
                    }
                }
            });
        }
        if direction == Direction::Inverse && width > 1 {
            along(frame);
        }
    }
}

/// Returns `count` values of a list, which grows if it is shorter. They begin on a cache line if the platform can tell.
fn room(values: &mut Vec<Complex32>, count: usize) -> &mut [Complex32] {
    const LINE: usize = 8;
    if values.len() < count + LINE {
        values.resize(count + LINE, ZERO);
    }
    let start = values.as_ptr().align_offset(64).min(LINE);
    &mut values[start..start + count]
}

fn in_place(plan: &Plan, data: &mut [Complex32]) {
    SCRATCH.with_borrow_mut(|(_, scratch)| lines(plan, data, room(scratch, plan.get_inplace_scratch_len())));
}

/// Up to this length, RustFFT transforms two lines at once on some processors, and rounds a single one differently.
const PAIRED: usize = 32;

/// Transforms lines so that the bits of each depend on no other line.
fn lines(plan: &Plan, data: &mut [Complex32], scratch: &mut [Complex32]) {
    let each = if plan.len() <= PAIRED { plan.len() } else { data.len() };
    data.chunks_exact_mut(each.max(1)).for_each(|part| plan.process_with_scratch(part, scratch));
}

impl Down {
    /// Transforms `count` columns of a frame from column `first`, without rounding.
    fn transform(&self, frame: &mut [Complex32], width: usize, [first, count]: [usize; 2]) {
        SCRATCH.with_borrow_mut(|(block, scratch)| match self {
            Down::InPlace(plan) => plan.transform(frame, width, [first, count], room(scratch, plan.scratch())),
            Down::Gathered(plan) => {
                let height = frame.len() / width;
                let (block, scratch) = (room(block, TOGETHER * height), room(scratch, plan.get_inplace_scratch_len()));
                for x in (first..first + count).step_by(TOGETHER) {
                    let n = TOGETHER.min(first + count - x);
                    let block = &mut block[..n * height];
                    gather(frame, block, width, x, n);
                    lines(plan, block, scratch);
                    scatter(block, frame, width, x, n);
                }
            }
        });
    }
}

fn gather(frame: &[Complex32], block: &mut [Complex32], width: usize, x: usize, n: usize) {
    let height = block.len() / n;
    // Tiles of rows keep the lines that are written in the first cache.
    for y0 in (0..height).step_by(TOGETHER) {
        for i in 0..n {
            let line = &mut block[i * height..][..height];
            for y in y0..(y0 + TOGETHER).min(height) {
                line[y] = frame[y * width + x + i];
            }
        }
    }
}

fn scatter(block: &[Complex32], frame: &mut [Complex32], width: usize, x: usize, n: usize) {
    let height = block.len() / n;
    for y0 in (0..height).step_by(TOGETHER) {
        for y in y0..(y0 + TOGETHER).min(height) {
            let row = &mut frame[y * width + x..][..n];
            for (i, v) in row.iter_mut().enumerate() {
                *v = block[i * height + y];
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::f64::consts::TAU;

    fn noise(n: usize, mut seed: u64) -> Vec<Complex32> {
        let mut next = || {
            seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (seed >> 40) as f32 / (1u64 << 23) as f32 - 1.0
        };
        (0..n).map(|_| Complex32::new(next(), next())).collect()
    }

    /// The definition, in float64.
    fn naive(x: &[Complex32], h: usize, w: usize, sign: f64) -> Vec<(f64, f64)> {
        let mut out = vec![(0.0, 0.0); h * w];
        for (at, out) in out.iter_mut().enumerate() {
            for (from, z) in x.iter().enumerate() {
                let turn =
                    ((at / w * (from / w)) % h) as f64 / h as f64 + ((at % w * (from % w)) % w) as f64 / w as f64;
                let (s, c) = (sign * TAU * turn).sin_cos();
                out.0 += f64::from(z.re) * c - f64::from(z.im) * s;
                out.1 += f64::from(z.re) * s + f64::from(z.im) * c;
            }
        }
        out
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(40))]
        #[test]
        fn is_the_transform(h in 1usize..24, w in 1usize..30, first in 0usize..30, count in 0usize..31, forward: bool) {
            let columns = Columns { first: first % w, count: count.min(w) };
            let in_use = |x: usize| (x + w - columns.first) % w < columns.count;
            let direction = if forward { Direction::Forward } else { Direction::Inverse };
            let mut x = noise(h * w, 7);
            if !forward {
                for (i, z) in x.iter_mut().enumerate() { if !in_use(i % w) { *z = ZERO; } }
            }
            let want = naive(&x, h, w, if forward { -1.0 } else { 1.0 });
            let plans = Plans::default();
            let (mut one, mut wide) = (x.clone(), x);
            plans.fft(&mut one, h, w, direction, columns, |_| ());
            plans.fft_wide(&mut wide, h, w, direction, columns, &mut Vec::new(), |_| ());
            let (mut error, mut power) = (0.0, 1e-30);
            for (i, (got, want)) in one.iter().zip(&want).enumerate() {
                if forward && !in_use(i % w) { continue; }
                prop_assert_eq!(got, &wide[i]);
                error += (f64::from(got.re) - want.0).powi(2) + (f64::from(got.im) - want.1).powi(2);
                power += want.0.powi(2) + want.1.powi(2);
            }
            prop_assert!(error < 1e-12 * power, "error power {} of signal", error / power);
        }

        #[test]
        fn a_union_holds_its_parts(w in 1usize..50, parts in prop::collection::vec((0usize..50, 1usize..20), 0..4)) {
            let parts: Vec<Columns> = parts.iter().map(|&(f, c)| Columns { first: f % w, count: c.min(w) }).collect();
            let union = Columns::union(w, parts.iter().copied());
            let holds = |x: usize| (x + w - union.first) % w < union.count;
            for p in &parts { for k in 0..p.count { prop_assert!(holds((p.first + k) % w)); } }
            prop_assert!(union.count <= parts.iter().map(|p| p.count).sum::<usize>().max(w));
            prop_assert!(!parts.is_empty() || union.count == 0);
        }
    }
}
