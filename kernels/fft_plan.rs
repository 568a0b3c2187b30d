//! Plans the transform of a length for the shaders, with a method, radices and the kind of memory.
//!
//! Plans are pure data, chosen without a device. Rows that fit the shared memory of a workgroup are read once and
//! written once (`fft_shared.comp`). So are columns, if that is worth it ([`Axis::ColumnPairs`]). Other columns, and
//! rows that do not fit, take one Stockham pass through global memory per radix (`fft_pass.comp`, Govindaraju et al.
//! 2008). Lengths with a prime factor above 13 are convolutions with a chirp (`fft_chirp.comp`, Bluestein 1970).
//!
//! Each pass costs one trip through memory. A plan therefore has as few passes as the largest radix allows, with
//! radices as equal as possible. Radices above 16 were measured and are slower, because they need more strides than a
//! cache has ways, and more values than registers. Tables are computed here, in float64.

use crate::fft::{Direction, transform_f64};
use num_complex::Complex64;
use std::f64::consts::{PI, TAU};
use std::fmt;

/// The limits of a device for a plan.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PlanLimits {
    /// Bytes of shared memory per workgroup.
    pub shared_bytes: u32,
    /// Number of invocations per workgroup.
    pub invocations: u32,
}

/// Longest line that can be planned. With it, the squared indices of the longest chirp stay far within u64, and its
/// grid within limits.
pub const LONGEST: u32 = 1 << 15;

/// Largest radix, which is the number of values that an invocation transforms in registers.
pub(crate) const LARGEST_RADIX: u32 = 16;

/// One slot of shared memory stays free after this number of slots. Invocations that write a radix apart then use
/// different banks.
pub(crate) const FREE_SLOT: u32 = 16;

/// Invocations of a workgroup of `fft_chirp.comp`, along memory and across it.
pub const CHIRP_WORKGROUP: [u32; 2] = [16, 4];
/// The mode of `fft_chirp.comp` that computes work = data chirp, padded with zeros.
pub const CHIRP_BEGIN: u32 = 0;
/// The mode of `fft_chirp.comp` that computes work = work filter.
pub const CHIRP_FILTER: u32 = 1;
/// The mode of `fft_chirp.comp` that computes data = work chirp.
pub const CHIRP_END: u32 = 2;

/// Maximum number of stages of `fft_shared.comp`.
const STAGES: usize = 5;

/// The number of values that an invocation transforms at once, `a b`, as transforms of `b` after transforms of `a`.
/// Each factor is 1, 2, 4, 8 or an odd prime up to 13.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Radix {
    /// First of the two factors.
    pub a: u32,
    /// Second factor, which is 1 if the radix has its own butterfly.
    pub b: u32,
}

impl Radix {
    /// Returns the butterflies that make up `size`, or `None` if there are none.
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

    /// Returns the number of values, `a b`.
    pub fn size(self) -> u32 {
        self.a * self.b
    }

    /// Returns the power of `w` that tables hold in addition to `w`. The other powers are products of the two.
    pub(crate) fn table_power(self) -> u32 {
        if self.size() <= 4 { 2 } else { 4 }
    }
}

/// A plan for rows, or for pairs of columns, through shared memory.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Shared {
    /// Radices, first to last.
    pub radices: Vec<Radix>,
    /// Butterflies (or pairs of them) per invocation, for each stage.
    pub counts: Vec<u32>,
    /// True if invocations compute neighboring butterflies of a row in pairs, 16 bytes at a time. For columns it is
    /// always true, and a pair then belongs to two columns.
    pub pair: bool,
    /// Invocations per row, or per pair of columns.
    pub threads: u32,
    /// Rows, or pairs of columns, per workgroup.
    pub lines: u32,
    /// Slots per line, of 16 bytes (pairs) or 8 bytes. One slot in `FREE_SLOT` + 1 stays free.
    pub slots: u32,
}

/// A plan for rows of several sub-frames in one workgroup (`compare_rows.comp`).
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Together {
    /// The plan of the rows. Its `lines` is the number of rows that are transformed at once.
    pub shared: Shared,
    /// Number of rows that fit in shared memory.
    pub kept: u32,
    /// True if these are all rows.
    pub whole: bool,
}

/// Maximum number of invocations of a workgroup for rows of several sub-frames.
const TOGETHER: u32 = 512;

/// Maximum number of value pairs that one invocation of such a workgroup holds at once. The second limit is for all
/// stages together. At most one stage may have several butterflies. Larger limits took more than 128 registers of RADV.
const HELD: u32 = 16;
const HELD_IN_ALL: u32 = 40;

/// Returns, per stage, the butterflies (or pairs of them) of each invocation, if `threads` invocations share a line of
/// `units` slots.
fn counts(units: u32, radices: &[u32], threads: u32) -> Vec<u32> {
    radices.iter().map(|r| (units / r).div_ceil(threads)).collect()
}

/// Returns the largest number of values that an invocation holds in a stage.
fn held(counts: &[u32], radices: &[u32]) -> u32 {
    counts.iter().zip(radices).map(|(c, r)| c * r).max().unwrap_or(0)
}

/// Returns a number of invocations per line. Candidates are the numbers of butterflies of the stages, as far as
/// `allowed` accepts the work of one invocation. The candidate with the fewest idle invocations wins. At least eight
/// invocations run in step.
fn threads(units: u32, radices: &[u32], most: u32, allowed: impl Fn(&[u32]) -> bool) -> Option<u32> {
    let work = |threads: u32| -> u32 {
        let counts = counts(units, radices, threads);
        counts.iter().zip(radices).map(|(c, r)| c * r).sum::<u32>() * threads.next_multiple_of(8)
    };
    let some = radices.iter().map(|r| units / r).filter(|t| *t > 0 && *t <= most);
    some.filter(|t| allowed(&counts(units, radices, *t))).min_by_key(|t| work(*t))
}

impl Shared {
    /// Returns a plan of the same rows of `n` values with more invocations per row, if one would hold more than the
    /// limits.
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

    /// Returns a plan for the same row of `frames` sub-frames, with a sum over the sub-frames for each of the `n`
    /// pixels. The sum is over all sub-frames at once if shared memory holds them, otherwise over as many as fit.
    pub fn together(&self, n: u32, frames: u32, limits: &PlanLimits) -> Option<Together> {
        let room = limits.shared_bytes.min(TILE_BYTES);
        let row = self.spread(n, limits);
        let area = row.slots * if row.pair { 16 } else { 8 };
        let most = (TOGETHER.min(limits.invocations) / row.threads).clamp(1, frames.max(1));
        // Sums, shares of the loss, and the unused array.
        let beside = |lines: u32| 4 * (n + lines * row.threads) + 16;
        let fits = |kept: u32, lines: u32| kept.saturating_mul(area).saturating_add(beside(lines)) <= room;
        // The rounds are equal, so that few invocations wait in the last one.
        let even = |lines: u32| frames.max(1).div_ceil(frames.max(1).div_ceil(lines));
        let kept = |lines: u32| lines * frames.max(1).div_ceil(lines);
        let lines = even(most);
        if fits(kept(lines), lines) {
            return Some(Together { shared: Self { lines, ..row.clone() }, kept: kept(lines), whole: true });
        }
        let lines = even((1..=most).rev().find(|lines| fits(*lines, *lines))?);
        Some(Together { shared: Self { lines, ..row.clone() }, kept: lines, whole: false })
    }

    /// Returns the bytes of shared memory per workgroup.
    pub fn bytes(&self) -> u32 {
        // The unused array has one slot.
        self.lines * self.slots * if self.pair { 16 } else { 8 } + if self.pair { 8 } else { 16 }
    }
}

/// The method that transforms a length.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Method {
    /// No transform, for a length of 1.
    Nothing,
    /// Whole lines through shared memory.
    Shared(Shared),
    /// One pass through global memory per radix.
    Passes {
        /// Radices of the passes, first to last.
        radices: Vec<Radix>,
        /// True if neighboring butterflies of a row can be computed in pairs. For columns, whose neighbors are other
        /// columns, an even width suffices.
        pair: bool,
    },
    /// A convolution with a chirp (Bluestein).
    Bluestein {
        /// The plan for the length of the convolution.
        inner: Box<Plan>,
    },
}

/// A length and the method of its transform.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Plan {
    /// Number of points per line.
    pub n: u32,
    /// Method of the transform.
    pub method: Method,
}

/// The direction of the lines in memory.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Axis {
    /// Elements of a line are neighbors in memory.
    Rows,
    /// Elements of a line are one row apart. Neighboring invocations take neighboring columns.
    Columns,
    /// Columns of frames of even width, through shared memory if a pair of columns fits. This is for GPUs. The shared
    /// memory of a software device is ordinary memory, and there this takes five times as long as the passes.
    ColumnPairs,
}

impl Plan {
    /// Plans lines of `n` points. Returns `None` for 0 points, and for more than [`LONGEST`].
    pub fn new(n: u32, axis: Axis, limits: &PlanLimits) -> Option<Self> {
        if n == 0 || n > LONGEST {
            return None;
        }
        Some(Self::with_convolution(n, axis, limits))
    }

    /// Plans lengths of convolutions too, which are twice as long.
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

    /// Returns the radices of the method, first to last. For a convolution they are the radices of its length.
    pub fn radices(&self) -> &[Radix] {
        match &self.method {
            Method::Nothing => &[],
            Method::Shared(shared) => &shared.radices,
            Method::Passes { radices, .. } => radices,
            Method::Bluestein { inner } => inner.radices(),
        }
    }

    /// Returns the table of twiddle factors, and the start of each radix's part in it. For each radix `R` but the
    /// first, with `s` the product of the radices before, the table has the powers 1 and `Radix::table_power` of
    /// `exp(-i 2 pi j / (s R))`, for all `j < s`.
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

    /// Returns the chirp and the filter of a convolution, or `None` for other methods. The chirp is `exp(-i pi k^2 /
    /// n)`, `k < n`. The filter is the transform of its inverse over the inner length, divided by that length.
    pub fn chirp(&self) -> Option<[Vec<[f32; 2]>; 2]> {
        let Method::Bluestein { inner } = &self.method else { return None };
        let (n, m) = (self.n as usize, inner.n as usize);
        // Integer arithmetic keeps k^2 modulo 2 n exact.
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

/// Returns the root of unity `exp(-i 2 pi k / n)` as (re, im).
fn root(k: u32, n: u32) -> [f32; 2] {
    let (sin, cos) = (TAU * f64::from(k) / f64::from(n)).sin_cos();
    [cos as f32, -sin as f32]
}

/// Returns the length of the convolution. Candidates are smooth lengths from `2 n - 1` to a quarter more, and the next
/// power of two. The one with the fewest radices wins, then the one with the least work.
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

/// Returns true if all stages have an even number of butterflies, and the first radix is even.
fn pairs(n: u32, radices: &[u32]) -> bool {
    radices[0].is_multiple_of(2) && radices.iter().all(|r| (n / r).is_multiple_of(2))
}

/// Returns the fewest radices whose product is `n`. Radices that allow pairs come before others, then the least sum
/// decides. Even radices come first in the result.
fn split(n: u32) -> Option<Vec<u32>> {
    let radices: Vec<u32> = (2..=LARGEST_RADIX.min(n)).rev().filter(|r| n.is_multiple_of(*r)).collect();
    // 2^32 is 16^8, and primes up to 13 fit two by two below 16^2.
    (1..=16).find_map(|count| {
        let mut best = None;
        search(n, n, count, &radices, &mut Vec::new(), &mut best);
        best.map(|b: (_, Vec<u32>)| b.1)
    })
}

/// Tries all products of `count` falling radices that equal `rest`.
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
        // The rest must be reachable with radices no larger than this one.
        if u64::from(*r).checked_pow(count).is_some_and(|most| most < u64::from(rest)) {
            break;
        }
        taken.push(*r);
        search(n, rest / r, count - 1, &radices[i..], taken, best);
        taken.pop();
    }
}

/// Invocations of a workgroup that is large enough to fill a device, and small enough to leave room for others next to
/// it.
const CROWD: u32 = 64;

/// Maximum number of pairs of columns per workgroup, which is 128 bytes of each row.
const TILE: u32 = 8;

/// Shared memory of a workgroup of columns. Two such workgroups fit a multiprocessor of any GPU.
const TILE_BYTES: u32 = 48 << 10;

fn shared(n: u32, radices: &[u32], limits: &PlanLimits) -> Option<Shared> {
    let pair = pairs(n, radices);
    let (units, unit_bytes) = if pair { (n / 2, 16) } else { (n, 8) };
    let most = |threads: u32| CROWD / threads;
    lines(units, unit_bytes, radices, limits, most).map(|shared| Shared { pair, ..shared })
}

/// Plans pairs of columns, as many as fit. A wider tile reads longer pieces of a row.
fn tile(n: u32, radices: &[u32], limits: &PlanLimits) -> Option<Shared> {
    let limits = PlanLimits { shared_bytes: limits.shared_bytes.min(TILE_BYTES), ..*limits };
    let shared = lines(n, 16, radices, &limits, |_| TILE)?;
    // A power of two keeps the pieces of a row aligned.
    Some(Shared { lines: 1 << shared.lines.ilog2(), ..shared })
}

/// Plans lines of `units` slots each. `most` returns the maximum number of lines for the invocations of one line.
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
