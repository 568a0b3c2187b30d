//! How the shaders transform a length: which method, which radices, in what memory. Pure data, chosen without a device.
//!
//! Rows that fit a workgroup's shared memory are read once and written once (`fft_shared.comp`), and so are columns where
//! that is worth it ([`Axis::ColumnPairs`]). Other columns, and rows that do not fit, take one Stockham pass through global
//! memory per radix (`fft_pass.comp`; Govindaraju et al. 2008).
//! Lengths with a prime factor above 13 are convolutions with a chirp (`fft_chirp.comp`; Bluestein 1970).
//! Each pass costs a trip through memory, so a plan has as few as the largest radix allows, of radices as equal as can
//! be. Larger radices than 16 were measured and are slower: more strides than a cache has ways, more values than
//! registers. Tables are made here, in float64.

use crate::fft::{Direction, transform_f64};
use num_complex::Complex64;
use std::f64::consts::{PI, TAU};
use std::fmt;

/// What a plan must fit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PlanLimits {
    /// Bytes of memory that a workgroup shares.
    pub shared_bytes: u32,
    /// Invocations in a workgroup.
    pub invocations: u32,
}

/// Longest line that is planned: the longest chirp's indices, squared, stay far within u64, and its grid within limits.
pub const LONGEST: u32 = 1 << 15;

/// Largest radix: what an invocation transforms in registers.
pub(crate) const LARGEST_RADIX: u32 = 16;

/// Of shared memory, the slot after so many stays free: invocations that write a radix apart meet different banks.
pub(crate) const FREE_SLOT: u32 = 16;

/// Invocations of a workgroup of `fft_chirp.comp`, along memory and across it.
pub const CHIRP_WORKGROUP: [u32; 2] = [16, 4];
/// Its mode: work = data chirp, and zeros.
pub const CHIRP_BEGIN: u32 = 0;
/// Its mode: work = work filter.
pub const CHIRP_FILTER: u32 = 1;
/// Its mode: data = work chirp.
pub const CHIRP_END: u32 = 2;

/// Stages that `fft_shared.comp` has.
const STAGES: usize = 5;

/// Values that an invocation transforms at once: `a b` of them, as transforms of `b` after transforms of `a`.
/// Each is 1, 2, 4, 8 or an odd prime up to 13.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Radix {
    /// First.
    pub a: u32,
    /// Second; 1 if the radix has a butterfly of its own.
    pub b: u32,
}

impl Radix {
    /// The butterflies that make up `size`.
    pub fn new(size: u32) -> Option<Self> {
        let (a, b) = match size {
            2 | 3 | 4 | 5 | 7 | 8 | 11 | 13 => (size, 1),
            6 => (2, 3),
            9 => (3, 3),
            10 => (2, 5),
            12 => (3, 4),
            14 => (2, 7),
            15 => (3, 5),
            16 => (4, 4),
            _ => return None,
        };
        Some(Self { a, b })
    }

    /// `a b`.
    pub fn size(self) -> u32 {
        self.a * self.b
    }

    /// Tables hold `w` and this power of it; the other powers are products.
    pub(crate) fn table_power(self) -> u32 {
        if self.size() <= 4 { 2 } else { 4 }
    }
}

/// Rows, or columns two by two, through shared memory.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Shared {
    /// Radices, first to last.
    pub radices: Vec<Radix>,
    /// Butterflies (or pairs of them) that an invocation takes, per stage.
    pub counts: Vec<u32>,
    /// Whether invocations work on neighbouring butterflies of a row two by two, 16 bytes at a time. Of columns they always
    /// do: on two columns.
    pub pair: bool,
    /// Invocations per row, or pair of columns.
    pub threads: u32,
    /// Rows, or pairs of columns, per workgroup.
    pub lines: u32,
    /// Slots of one, of 16 bytes (pairs) or 8; one in `FREE_SLOT` + 1 stays free.
    pub slots: u32,
}

/// Rows of several sub-frames in one workgroup (`compare_rows.comp`).
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Together {
    /// How, with as many rows as are transformed at once.
    pub shared: Shared,
    /// Rows that shared memory holds.
    pub kept: u32,
    /// Whether those are all there are.
    pub whole: bool,
}

/// Invocations of a workgroup of rows of several sub-frames at most.
const TOGETHER: u32 = 512;

/// Pairs of values that an invocation of them holds at once at most, and in all stages together, with several butterflies in
/// one stage at most: more took more than 128 registers of RADV's.
const HELD: u32 = 16;
const HELD_IN_ALL: u32 = 40;

/// Butterflies (or pairs of them) that each of so many invocations takes of a line of `units` slots, per stage.
fn counts(units: u32, radices: &[u32], threads: u32) -> Vec<u32> {
    radices.iter().map(|r| (units / r).div_ceil(threads)).collect()
}

/// Most that an invocation holds in a stage.
fn held(counts: &[u32], radices: &[u32]) -> u32 {
    counts.iter().zip(radices).map(|(c, r)| c * r).max().unwrap_or(0)
}

/// As many invocations as some stage has butterflies and that `allowed` allows by what one then takes; of these, what leaves
/// fewest idle. Eight run in step or more.
fn threads(units: u32, radices: &[u32], most: u32, allowed: impl Fn(&[u32]) -> bool) -> Option<u32> {
    let work = |threads: u32| -> u32 {
        let counts = counts(units, radices, threads);
        counts.iter().zip(radices).map(|(c, r)| c * r).sum::<u32>() * threads.next_multiple_of(8)
    };
    let some = radices.iter().map(|r| units / r).filter(|t| *t > 0 && *t <= most);
    some.filter(|t| allowed(&counts(units, radices, *t))).min_by_key(|t| work(*t))
}

impl Shared {
    /// The same rows of `n` values with more invocations each, where one would hold more than that.
    fn spread(&self, n: u32, limits: &PlanLimits) -> Self {
        let units = if self.pair { n / 2 } else { n };
        let radices: Vec<u32> = self.radices.iter().map(|radix| radix.size()).collect();
        let few = |all: &[u32]| {
            let sum: u32 = all.iter().zip(&radices).map(|(c, r)| c * r).sum();
            held(all, &radices) <= HELD && sum <= HELD_IN_ALL && all.iter().filter(|c| **c > 1).count() <= 1
        };
        match threads(units, &radices, TOGETHER.min(limits.invocations), few) {
            Some(threads) if !few(&self.counts) => {
                Self { threads, counts: counts(units, &radices, threads), ..self.clone() }
            }
            _ => self.clone(),
        }
    }

    /// The same row of `frames` sub-frames, with a sum over them for each of its `n` pixels: of all at once if shared memory
    /// holds them, else of as many as it does.
    pub fn together(&self, n: u32, frames: u32, limits: &PlanLimits) -> Option<Together> {
        let room = limits.shared_bytes.min(TILE_BYTES);
        let row = self.spread(n, limits);
        let area = row.slots * if row.pair { 16 } else { 8 };
        let most = (TOGETHER.min(limits.invocations) / row.threads).clamp(1, frames.max(1));
        // Sums, shares of the loss, and the array that is not used.
        let beside = |lines: u32| 4 * (n + lines * row.threads) + 16;
        let fits = |kept: u32, lines: u32| kept.saturating_mul(area).saturating_add(beside(lines)) <= room;
        // Equal rounds, so that few invocations wait in the last.
        let even = |lines: u32| frames.max(1).div_ceil(frames.max(1).div_ceil(lines));
        let kept = |lines: u32| lines * frames.max(1).div_ceil(lines);
        let lines = even(most);
        if fits(kept(lines), lines) {
            return Some(Together { shared: Self { lines, ..row.clone() }, kept: kept(lines), whole: true });
        }
        let lines = even((1..=most).rev().find(|lines| fits(*lines, *lines))?);
        Some(Together { shared: Self { lines, ..row.clone() }, kept: lines, whole: false })
    }

    /// Bytes per workgroup.
    pub fn bytes(&self) -> u32 {
        // The array that is not used has one slot.
        self.lines * self.slots * if self.pair { 16 } else { 8 } + if self.pair { 8 } else { 16 }
    }
}

/// How a length is transformed.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Method {
    /// A length of 1.
    Nothing,
    /// Whole lines through shared memory.
    Shared(Shared),
    /// One pass through global memory per radix.
    Passes {
        /// First to last.
        radices: Vec<Radix>,
        /// Whether neighbouring butterflies of a row can be worked on two by two. (Of columns, whose neighbours are
        /// other columns, they can where the width is even.)
        pair: bool,
    },
    /// A convolution with a chirp.
    Bluestein {
        /// How its length is transformed.
        inner: Box<Plan>,
    },
}

/// A length and its method.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Plan {
    /// Points.
    pub n: u32,
    /// How.
    pub method: Method,
}

/// Along memory, or across it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Axis {
    /// Elements are neighbours in memory.
    Rows,
    /// Elements are a row apart; neighbouring invocations take neighbouring columns.
    Columns,
    /// The same of frames of even width, through shared memory where a pair of columns fits. For GPUs: on a device in
    /// software, whose shared memory is memory like any other, this takes five times as long as the passes.
    ColumnPairs,
}

impl Plan {
    /// Plans lines of `n` points; none of 0 points, or of more than [`LONGEST`].
    pub fn new(n: u32, axis: Axis, limits: &PlanLimits) -> Option<Self> {
        if n == 0 || n > LONGEST {
            return None;
        }
        Some(Self::with_convolution(n, axis, limits))
    }

    /// Also of the lengths of convolutions, twice as long.
    fn with_convolution(n: u32, axis: Axis, limits: &PlanLimits) -> Self {
        let method = if n == 1 {
            Method::Nothing
        } else if let Some(radices) = split(n) {
            match axis {
                Axis::Rows => shared(n, &radices, limits).map(Method::Shared),
                Axis::Columns => None,
                Axis::ColumnPairs => tile(n, &radices, limits).map(Method::Shared),
            }
            .unwrap_or_else(|| {
                let pair = pairs(n, &radices);
                let radices = radices.into_iter().filter_map(Radix::new).collect();
                Method::Passes { radices, pair }
            })
        } else {
            Method::Bluestein { inner: Box::new(Self::with_convolution(convolution(n), axis, limits)) }
        };
        Self { n, method }
    }

    /// Radices of the method, first to last; of a convolution, those of its length.
    pub fn radices(&self) -> &[Radix] {
        match &self.method {
            Method::Nothing => &[],
            Method::Shared(shared) => &shared.radices,
            Method::Passes { radices, .. } => radices,
            Method::Bluestein { inner } => inner.radices(),
        }
    }

    /// For each radix `R` but the first, with `s` the product of those before: for all `j < s` the powers 1 and
    /// `Radix::table_power` of `exp(-i 2 pi j / (s R))`. Where each radix's part starts comes second.
    pub fn twiddles(&self) -> (Vec<[f32; 4]>, Vec<u32>) {
        let (mut table, mut starts, mut s) = (Vec::new(), Vec::new(), 1);
        for radix in self.radices() {
            starts.push(table.len() as u32);
            let whole = s * radix.size();
            if s > 1 {
                for j in 0..s {
                    let ([a, b], [c, d]) = (root(j, whole), root(radix.table_power() * j % whole, whole));
                    table.push([a, b, c, d]);
                }
            }
            s = whole;
        }
        (table, starts)
    }

    /// Of a convolution: the chirp `exp(-i pi k^2 / n)`, `k < n`, and the transform of its inverse over the inner
    /// length, divided by that length.
    pub fn chirp(&self) -> Option<[Vec<[f32; 2]>; 2]> {
        let Method::Bluestein { inner } = &self.method else { return None };
        let (n, m) = (self.n as usize, inner.n as usize);
        // k^2 modulo 2 n, as exact as integers are.
        let chirp: Vec<Complex64> =
            (0..n as u64).map(|k| Complex64::cis(-PI * (k * k % (2 * n as u64)) as f64 / n as f64)).collect();
        let mut filter = vec![Complex64::default(); m];
        for (k, z) in chirp.iter().enumerate() {
            filter[k] = z.conj() / m as f64;
            filter[(m - k) % m] = filter[k];
        }
        transform_f64(&mut filter, m, Direction::Forward);
        let narrow = |z: &Complex64| [z.re as f32, z.im as f32];
        Some([chirp.iter().map(narrow).collect(), filter.iter().map(narrow).collect()])
    }
}

/// `exp(-i 2 pi k / n)`.
fn root(k: u32, n: u32) -> [f32; 2] {
    let (sin, cos) = (TAU * f64::from(k) / f64::from(n)).sin_cos();
    [cos as f32, -sin as f32]
}

/// The length from `2 n - 1` to a quarter more, or the next power of two, that has fewest radices, then least work.
fn convolution(n: u32) -> u32 {
    let least = 2 * n - 1;
    let smooth = |m: &u32| {
        [2, 3, 5, 7].iter().fold(*m, |mut m, p| {
            while m.is_multiple_of(*p) {
                m /= p;
            }
            m
        }) == 1
    };
    (least..=least + least / 4)
        .filter(smooth)
        .chain([least.next_power_of_two()])
        .filter_map(|m| {
            let radices = split(m)?;
            Some((radices.len(), !pairs(m, &radices), m * radices.iter().sum::<u32>(), m))
        })
        .min()
        .map_or(least.next_power_of_two(), |best| best.3)
}

/// Whether all stages have an even number of butterflies, and the first radix is even.
fn pairs(n: u32, radices: &[u32]) -> bool {
    radices[0].is_multiple_of(2) && radices.iter().all(|r| (n / r).is_multiple_of(2))
}

/// Fewest radices whose product is `n`, then such as go in pairs, then those of least sum; even ones first.
fn split(n: u32) -> Option<Vec<u32>> {
    let radices: Vec<u32> = (2..=LARGEST_RADIX.min(n)).rev().filter(|r| n.is_multiple_of(*r)).collect();
    // 2^32 is 16^8, and primes up to 13 come two by two below 16^2.
    (1..=16).find_map(|count| {
        let mut best = None;
        search(n, n, count, &radices, &mut Vec::new(), &mut best);
        best.map(|b: (_, Vec<u32>)| b.1)
    })
}

/// All products of `count` falling radices that are `rest`.
fn search(
    n: u32,
    rest: u32,
    count: u32,
    radices: &[u32],
    taken: &mut Vec<u32>,
    best: &mut Option<((bool, u32), Vec<u32>)>,
) {
    if count == 0 {
        if rest == 1 {
            let mut found = taken.clone();
            found.sort_by_key(|r| (r % 2, std::cmp::Reverse(*r)));
            let cost = (!pairs(n, &found), found.iter().sum());
            if best.as_ref().is_none_or(|b| cost < b.0) {
                *best = Some((cost, found));
            }
        }
        return;
    }
    for (i, r) in radices.iter().enumerate().filter(|(_, r)| rest.is_multiple_of(**r)) {
        // What is left must be reachable with radices no greater than this one.
        if u64::from(*r).checked_pow(count).is_some_and(|most| most < u64::from(rest)) {
            break;
        }
        taken.push(*r);
        search(n, rest / r, count - 1, &radices[i..], taken, best);
        taken.pop();
    }
}

/// Invocations of a workgroup that is neither too small to fill a device nor too large to have neighbours.
const CROWD: u32 = 64;

/// Pairs of columns of a workgroup at most: 128 bytes of each row.
const TILE: u32 = 8;

/// Shared memory of a workgroup of columns: two of them fit a multiprocessor of any GPU.
const TILE_BYTES: u32 = 48 << 10;

fn shared(n: u32, radices: &[u32], limits: &PlanLimits) -> Option<Shared> {
    let pair = pairs(n, radices);
    let (units, unit_bytes) = if pair { (n / 2, 16) } else { (n, 8) };
    let most = |threads: u32| CROWD / threads;
    lines(units, unit_bytes, radices, limits, most).map(|shared| Shared { pair, ..shared })
}

/// Columns two by two: as many pairs as fit, for the wider a tile, the longer what is read of a row.
fn tile(n: u32, radices: &[u32], limits: &PlanLimits) -> Option<Shared> {
    let limits = PlanLimits { shared_bytes: limits.shared_bytes.min(TILE_BYTES), ..*limits };
    let shared = lines(n, 16, radices, &limits, |_| TILE)?;
    // A power of two, so that what is read of a row is aligned.
    Some(Shared { lines: 1 << shared.lines.ilog2(), ..shared })
}

/// Lines of `units` slots each, at most so many as `most` says for the invocations of one.
fn lines(
    units: u32,
    unit_bytes: u32,
    radices: &[u32],
    limits: &PlanLimits,
    most: impl Fn(u32) -> u32,
) -> Option<Shared> {
    let slots = units + units / FREE_SLOT + 1;
    let line = slots.checked_mul(unit_bytes)?;
    let room = limits.shared_bytes.checked_sub(16)?;
    if radices.len() > STAGES || line > room {
        return None;
    }
    let all = |_: &[u32]| true;
    let threads = threads(units, radices, limits.invocations, all)?;
    let counts = counts(units, radices, threads);
    if held(&counts, radices) > 2 * LARGEST_RADIX {
        return None;
    }
    let lines = most(threads).clamp(1, (room / line).min(limits.invocations / threads));
    let radices = radices.iter().copied().map(Radix::new).collect::<Option<_>>()?;
    Some(Shared { radices, counts, pair: true, threads, lines, slots })
}

impl fmt::Display for Plan {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}:", self.n)?;
        for radix in self.radices().iter().filter(|_| !matches!(self.method, Method::Bluestein { .. })) {
            write!(f, " {}", radix.size())?;
        }
        let two_by_two = |pair: bool| if pair { ", two by two" } else { "" };
        match &self.method {
            Method::Nothing => f.write_str(" nothing to do"),
            Method::Shared(shared) => write!(
                f,
                " in shared memory{}, {} invocations a line, {} lines and {} bytes a workgroup",
                two_by_two(shared.pair),
                shared.threads,
                shared.lines,
                shared.bytes()
            ),
            Method::Passes { .. } => f.write_str(" through global memory"),
            Method::Bluestein { inner } => write!(f, " a convolution of length {inner}"),
        }
    }
}

#[cfg(test)]
#[path = "fft_plan_tests.rs"]
mod tests;
