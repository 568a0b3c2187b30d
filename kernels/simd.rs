//! Runs work with the processor's widest vector instructions.

use pulp::{Arch, Scalar256b, Simd, WithSimd};

/// Runs `work` compiled for the widest SIMD of this processor. Inner functions must be `#[inline(always)]`.
///
/// This fuses and reorders nothing, so results have the same bits on every processor.
#[inline]
pub fn simd<R>(work: impl FnOnce() -> R) -> R {
    Arch::new().dispatch(work)
}

/// Runs work with explicit vectors in the greatest width of this processor.
///
/// On a processor without AVX2 or NEON, a vector is eight values, and the compiler maps them to baseline instructions.
#[inline]
pub(crate) fn vectors<W: WithSimd>(work: W) -> W::Output {
    match Arch::new() {
        Arch::Scalar => Scalar256b.vectorize(work),
        #[allow(unreachable_patterns, reason = "not every target has another")]
        arch => arch.dispatch(work),
    }
}

/// Returns the name of the instruction set that [`simd`] uses.
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
