//! How the shaders transform a length: which passes, which radices. Pure data, chosen without a device.
//!
//! A line that fits a workgroup's shared memory is read once and written once, its stages exchanging values in
//! between; any other takes one Stockham pass through global memory per stage. A stage transforms `a b c` values in
//! the registers of one invocation. Primes that are too large for that are summed by the definition.
//! Fewer stages mean less memory traffic, so a plan has as few as the largest radix allows, of radices that are as
//! equal as can be.

use std::fmt;

/// What a plan must fit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PlanLimits {
    /// Bytes of memory that a workgroup shares.
    pub shared_bytes: u32,
    /// Invocations in a workgroup.
    pub invocations: u32,
    /// Complex values that an invocation should hold in registers, at most 64; primes up to 31 are held all the same.
    pub radix: u32,
}

/// The transforms that the shaders have in straight lines of code, besides other odd primes.
const LINES: [u32; 13] = [2, 3, 4, 5, 7, 8, 11, 13, 17, 19, 23, 29, 31];

/// Values that an invocation transforms at once: `a b c` of them, as three transforms within each other.
/// Each is 1, 2, 4, 8 or an odd prime up to 31; ones come last.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Radix {
    /// Outermost.
    pub a: u32,
    /// Within it.
    pub b: u32,
    /// Innermost.
    pub c: u32,
}

impl Radix {
    /// Copies: what a pass of radix 1 does.
    pub const ONE: Self = Self { a: 1, b: 1, c: 1 };

    /// Splits `size`, with few factors and small ones.
    pub fn new(size: u32) -> Option<Self> {
        let held = |n: u32| n == 1 || LINES.contains(&n);
        let mut best = (size == 1).then_some(Self::ONE);
        for a in LINES.into_iter().filter(|a| size.is_multiple_of(*a)) {
            for b in (1..=a).filter(|b| held(*b) && (size / a).is_multiple_of(*b)) {
                let c = size / a / b;
                let split = Self { a, b, c };
                // Few factors, then small ones.
                let weight = |r: Self| (u32::from(r.b > 1) + u32::from(r.c > 1), r.a + r.b + r.c);
                if c <= b && held(c) && best.is_none_or(|best| weight(split) < weight(best)) {
                    best = Some(split);
                }
            }
        }
        best
    }

    /// `a b c`.
    pub fn size(self) -> u32 {
        self.a * self.b * self.c
    }
}

/// One pass through global memory.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Pass {
    /// A register butterfly per invocation.
    Butterfly(Radix),
    /// One output per invocation, summed by the definition: a prime without a butterfly.
    Direct(u32),
}

impl Pass {
    /// What the pass divides the length by.
    pub fn radix(self) -> u32 {
        match self {
            Self::Butterfly(radix) => radix.size(),
            Self::Direct(radix) => radix,
        }
    }
}

/// How a length is transformed.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Method {
    /// Whole lines through shared memory.
    Shared {
        /// Their radices, first to last.
        stages: Vec<Radix>,
        /// Invocations per line.
        threads: u32,
        /// Lines per workgroup.
        lines: u32,
        /// Bytes of shared memory per workgroup.
        shared_bytes: u32,
    },
    /// Passes through global memory, first to last; none for a length of 1. The last one reads and writes the same
    /// places if their number is odd, so it is no direct one then.
    Passes(Vec<Pass>),
}

/// A length and its method.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Plan {
    /// Points.
    pub n: u32,
    /// How.
    pub method: Method,
}

/// Plans columns, which lie across memory: neighbouring invocations take neighbouring columns.
pub fn columns(n: u32, limits: &PlanLimits) -> Plan {
    Plan { n, method: Method::Passes(passes(n, limits)) }
}

/// Plans rows, which lie along memory.
pub fn rows(n: u32, limits: &PlanLimits) -> Plan {
    let method = shared(n, limits).unwrap_or_else(|| Method::Passes(passes(n, limits)));
    Plan { n, method }
}

/// Invocations of a workgroup that is neither too small to fill a device nor too large to have neighbours.
const CROWD: u32 = 128;

fn shared(n: u32, limits: &PlanLimits) -> Option<Method> {
    let line = n.checked_mul(8).filter(|bytes| n > 1 && *bytes <= limits.shared_bytes)?;
    let stages: Vec<Radix> = split(n, limits.radix)?.into_iter().map(Radix::new).collect::<Option<_>>()?;
    let threads = n / stages.iter().map(|s| s.size()).min()?;
    if stages.len() > 3 || threads > limits.invocations {
        return None;
    }
    let most = (limits.shared_bytes / line).min(limits.invocations / threads);
    let lines = (CROWD / threads).clamp(1, most);
    Some(Method::Shared { stages, threads, lines, shared_bytes: lines * line })
}

fn passes(n: u32, limits: &PlanLimits) -> Vec<Pass> {
    // Large primes first, so that a butterfly comes last.
    let (mut passes, mut rest) = (Vec::new(), n);
    let mut factor = 2;
    while factor <= rest / factor.max(1) || (factor <= rest && rest > 1) {
        if factor > rest / factor {
            factor = rest;
        }
        if rest.is_multiple_of(factor) {
            rest /= factor;
            if Radix::new(factor).is_none() {
                passes.push(Pass::Direct(factor));
            }
        } else {
            factor += 1;
        }
    }
    let smooth = passes.iter().fold(n, |n, p| n / p.radix());
    let split = split(smooth, limits.radix).unwrap_or_default();
    passes.extend(split.into_iter().filter_map(Radix::new).map(Pass::Butterfly));
    if passes.len() % 2 == 1 && matches!(passes.last(), Some(Pass::Direct(_))) {
        passes.push(Pass::Butterfly(Radix::ONE));
    }
    passes
}

/// Fewest radices up to `largest` whose product is `n`, the greatest of them as small as can be, greatest first.
fn split(n: u32, largest: u32) -> Option<Vec<u32>> {
    if n == 1 {
        return Some(Vec::new());
    }
    let radices: Vec<u32> =
        (2..=largest.max(31).min(n)).rev().filter(|r| n.is_multiple_of(*r) && held(*r, largest)).collect();
    (1..=32).find_map(|count| {
        let mut best = None;
        search(n, count, &radices, &mut Vec::new(), &mut best);
        best
    })
}

/// Whether a radix may be used: up to `largest`, or a prime, which can be had no other way.
fn held(size: u32, largest: u32) -> bool {
    Radix::new(size).is_some_and(|r| size <= largest || r.b == 1 && size > 8)
}

/// All products of `count` falling radices; keeps the one with the least sum.
fn search(n: u32, count: usize, radices: &[u32], taken: &mut Vec<u32>, best: &mut Option<Vec<u32>>) {
    if count == 0 {
        let sum = |list: &[u32]| list.iter().sum::<u32>();
        if n == 1 && best.as_ref().is_none_or(|b| sum(taken) < sum(b)) {
            *best = Some(taken.clone());
        }
        return;
    }
    for (i, r) in radices.iter().enumerate().filter(|(_, r)| n.is_multiple_of(**r)) {
        // The rest must be reachable with radices no greater than this one.
        if u64::from(*r).checked_pow(count as u32).is_some_and(|most| most < u64::from(n)) {
            break;
        }
        taken.push(*r);
        search(n / r, count - 1, &radices[i..], taken, best);
        taken.pop();
    }
}

impl fmt::Display for Radix {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.size())?;
        match (self.b, self.c) {
            (1, _) => Ok(()),
            (b, 1) => write!(f, " ({} x {b})", self.a),
            (b, c) => write!(f, " ({} x {b} x {c})", self.a),
        }
    }
}

impl fmt::Display for Plan {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}:", self.n)?;
        match &self.method {
            Method::Shared { stages, threads, lines, shared_bytes } => {
                for stage in stages {
                    write!(f, " {stage}")?;
                }
                write!(f, " in shared memory, {threads} threads a line, {lines} lines, {shared_bytes} bytes")
            }
            Method::Passes(passes) if passes.is_empty() => f.write_str(" nothing to do"),
            Method::Passes(passes) => {
                for pass in passes {
                    match pass {
                        Pass::Butterfly(radix) => write!(f, " {radix}")?,
                        Pass::Direct(radix) => write!(f, " {radix} by definition")?,
                    }
                }
                f.write_str(" in global memory")
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SOFTWARE: PlanLimits = PlanLimits { shared_bytes: 32768, invocations: 1024, radix: 36 };
    const SMALL: PlanLimits = PlanLimits { shared_bytes: 16384, invocations: 128, radix: 16 };

    fn check(plan: &Plan, limits: &PlanLimits) {
        match &plan.method {
            Method::Shared { stages, threads, lines, shared_bytes } => {
                assert_eq!(stages.iter().map(|s| s.size()).product::<u32>(), plan.n, "{plan}");
                assert!(stages.iter().all(|s| held(s.size(), limits.radix) && plan.n / s.size() <= *threads), "{plan}");
                assert!(*lines > 0 && threads * lines <= limits.invocations, "{plan}");
                assert!(*shared_bytes <= limits.shared_bytes && *shared_bytes >= 8 * plan.n * lines, "{plan}");
            }
            Method::Passes(passes) => {
                assert_eq!(passes.iter().map(|p| p.radix()).product::<u32>(), plan.n, "{plan}");
                for pass in passes {
                    if let Pass::Butterfly(r) = pass {
                        assert!(
                            (*r == Radix::ONE || held(r.size(), limits.radix)) && Radix::new(r.size()) == Some(*r),
                            "{plan}"
                        );
                    }
                }
                let in_place = passes.len() % 2 == 1;
                assert!(!in_place || matches!(passes.last(), Some(Pass::Butterfly(_))), "{plan}");
            }
        }
    }

    #[test]
    fn plans_make_up_their_length_within_the_limits() {
        for limits in [SOFTWARE, SMALL] {
            for n in (1..5000).chain([8192, 10_007, 16_384, 65_521, 1 << 20]) {
                check(&rows(n, &limits), &limits);
                check(&columns(n, &limits), &limits);
            }
        }
    }

    #[test]
    fn plans_have_the_fewest_stages() {
        for (n, radix, stages) in
            [(512, 36, 2), (1080, 36, 2), (1024, 32, 2), (2048, 36, 3), (256, 16, 2), (4096, 16, 3)]
        {
            let limits = PlanLimits { radix, ..SOFTWARE };
            let Method::Passes(passes) = columns(n, &limits).method else { panic!("{n}") };
            assert_eq!(passes.len(), stages, "{n}: {passes:?}");
            let Method::Shared { stages: shared, .. } = rows(n, &limits).method else { panic!("{n}") };
            assert_eq!(shared.len(), stages, "{n}: {shared:?}");
        }
    }

    #[test]
    fn what_does_not_fit_shared_memory_takes_passes() {
        assert!(matches!(rows(4096, &SOFTWARE).method, Method::Shared { .. }));
        for n in [1, 4097, 8192, 97 * 8] {
            assert!(matches!(rows(n, &SOFTWARE).method, Method::Passes(_)), "{n}");
        }
        // 2048 / 2 invocations a line are too many here.
        assert!(matches!(rows(2048, &PlanLimits { radix: 2, ..SMALL }).method, Method::Passes(_)));
    }

    #[test]
    fn plans_can_be_read() {
        let text = |plan: Plan| plan.to_string();
        assert_eq!(text(columns(1, &SMALL)), "1: nothing to do");
        assert_eq!(text(columns(97 * 6, &SMALL)), "582: 97 by definition 6 (3 x 2) in global memory");
        assert_eq!(text(columns(97, &SMALL)), "97: 97 by definition 1 in global memory");
        assert_eq!(
            text(rows(256, &SMALL)),
            "256: 16 (4 x 4) 16 (4 x 4) in shared memory, 16 threads a line, 8 lines, 16384 bytes"
        );
    }
}
