//! The processor's widest instructions.

use pulp::{Arch, Scalar256b, Simd, WithSimd};

/// Runs `work` compiled for the widest SIMD that this processor has. Inner functions must be `#[inline(always)]`.
///
/// Nothing is fused or reordered by this: results are the same bits on every processor.
#[inline]
pub fn simd<R>(work: impl FnOnce() -> R) -> R {
    Arch::new().dispatch(work)
}

/// Runs vectors that the work writes out, as wide as this processor has them.
///
/// Without vector instructions of its own, the compiler gets eight values at a time, which it maps to what the target has.
#[inline]
pub(crate) fn vectors<W: WithSimd>(work: W) -> W::Output {
    match Arch::new() {
        Arch::Scalar => Scalar256b.vectorize(work),
        #[allow(unreachable_patterns, reason = "not every target has another")]
        arch => arch.dispatch(work),
    }
}

/// Name of the instruction set that [`simd`] chose.
pub fn simd_name() -> &'static str {
    match Arch::new() {
        #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
        Arch::V4(_) => "AVX-512",
        #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
        Arch::V3(_) => "AVX2",
        #[cfg(target_arch = "aarch64")]
        Arch::Neon(_) => "NEON",
        _ => "baseline SIMD",
    }
}
