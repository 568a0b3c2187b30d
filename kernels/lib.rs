//! The compute kernels: GLSL source and, beside each, its CPU twin in Rust under the same name.
//!
//! A twin takes its arguments (plain data, `#[repr(C)]`), then its input buffers, then its outputs, in the order of
//! the bindings of its shader. Twins work on one frame or one pupil pass (a pupil pass is what one pupil needs); the engines
//! decide how many run at once. Field buffers are complex, in float32 or in halves ([`half`]); the frames axis comes first; spectra are in the
//! order of the DFT. Twins are what the shaders are compared with, and are themselves compared with float64.
//!
//! This room imports nothing from the runtime.
//!
//! | kernel | reads | writes |
//! |---|---|---|
//! | [`quantise`] | phases, levels | shown |
//! | [`modulate`] | phases, or shown | field |
//! | [`fft`] | field, window or change | the same |
//! | [`transfer`] | spans | transfer |
//! | [`taper`] | weights | transfer |
//! | [`pass_pupil`] | field, transfer, spans | window |
//! | [`intensity`] | window | image |
//! | [`photograph`] | views, taps | accumulator |
//! | [`resample`] | accumulator, tables | target |
//! | [`compare`] | image, target | factor (over the image), loss |
//! | [`exposure`] | image, target | sums |
//! | [`apply_factor`] | factor | window |
//! | [`overlap`] | spans | hits |
//! | [`return_pupil`] | window, transfer, spans | change |
//! | [`divide_by_overlap`] | hits | change |
//! | [`energy`] | field | energy |
//! | [`equalise_eyebox`] | energy, field | change |
//! | [`check_finite`] | change | found |
//! | [`project`] | change, shown | phases, velocity |
//! | [`adam`] | change, shown | phases, first and second moments |
//! | [`encode`] | phases, offsets, table | video frame |
//! | [`pixels`] | video frame | pixels of a display |

pub mod adam;
pub mod apply_factor;
pub mod check_finite;
pub mod compare;
pub mod divide_by_overlap;
pub mod encode;
pub mod energy;
pub mod equalise_eyebox;
pub mod exposure;
pub mod fft;
pub mod fft_plan;
pub mod half;
pub mod intensity;
pub mod modulate;
pub mod overlap;
pub mod pass_pupil;
pub mod photograph;
pub mod pixels;
pub mod project;
pub mod quantise;
pub mod resample;
pub mod return_pupil;
pub mod taper;
pub mod transfer;
pub mod trig;

/// A complex number in float32, as all field buffers hold it: (re, im).
pub type Complex32 = num_complex::Complex32;

/// Complex zero.
pub const ZERO: Complex32 = Complex32::new(0.0, 0.0);

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
