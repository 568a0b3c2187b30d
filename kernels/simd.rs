//! The processor's widest instructions.

/// Runs `work` compiled for the widest SIMD that this processor has. Inner functions must be `#[inline(always)]`.
///
/// Nothing is fused or reordered by this: results are the same bits on every processor.
#[inline]
pub fn simd<R>(work: impl FnOnce() -> R) -> R {
    pulp::Arch::new().dispatch(work)
}

/// Name of the instruction set that [`simd`] chose.
pub fn simd_name() -> &'static str {
    #[cfg(target_arch = "x86_64")]
    if std::arch::is_x86_feature_detected!("avx2") && std::arch::is_x86_feature_detected!("fma") {
        return "AVX2";
    }
    "baseline SIMD"
}
