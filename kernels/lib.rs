//! The compute kernels: GLSL source and, beside each, its CPU twin in Rust under the same name.
//!
//! A twin takes its arguments (plain data, `#[repr(C)]`), then its input buffers, then its outputs, in the order of
//! the bindings of its shader. Twins work on one frame or one pupil pass (a pupil pass is what one pupil needs); the engines
//! decide how many run at once. Field buffers are complex, in float32 or in halves ([`half`]); the frames axis comes first; spectra are in the
//! order of the DFT. Twins are what the shaders are compared with, and are themselves compared with float64.
//!
//! This room imports nothing from the runtime.
//! [`kernels!`] lists them. [`encode`] and [`pixels`], which belong to a display and not to a step, stand beside the list, and so do
//! [`decode_views`] and [`halve_views`], which belong to what an application gives, and [`pupil_light`] and [`table_start`], which belong
//! to what a solve begins with.

pub mod adam;
pub mod apply_factor;
pub mod binary_angle;
pub mod check_finite;
pub mod compare;
pub mod crosstalk;
pub mod decode_views;
pub mod divide_by_overlap;
pub mod drive;
pub mod drive_adjoint;
pub mod encode;
pub mod energy;
pub mod equalise_eyebox;
pub mod exposure;
pub mod eye;
pub mod fft;
pub mod fft_plan;
pub mod half;
pub mod halve_views;
pub mod intensity;
pub mod lag;
pub mod layers;
pub mod modulate;
pub mod modulate_mask;
pub mod modulate_wave;
pub mod motion;
pub mod multiply;
pub mod overlap;
pub mod pass_pupil;
pub mod phase_gradient;
pub mod phase_gradient_mask;
pub mod photograph;
pub mod pixels;
pub mod project;
pub mod pupil_adjoint;
pub mod pupil_light;
pub mod quantise;
pub mod regression;
pub mod relay;
pub mod resample;
pub mod scattered;
pub mod shared;
mod simd;
pub mod subpixels;
mod table;
pub mod table_start;
pub mod taper;
pub mod transfer;
pub mod trig;

pub use simd::{simd, simd_name};

/// Columns or pixels of a workgroup, as all shaders but those that sum have it.
pub const WIDTH: u32 = 64;
/// Pupils of a dispatch at most, of shaders that take several.
pub const BATCH: usize = 16;
/// Rows and columns of pixels that a workgroup of shaders over tiles takes,
pub const TILE: u32 = 32;
/// and its invocations.
pub const TILE_THREADS: u32 = 128;
/// Invocations of a workgroup of shaders that sum.
pub const SUM_WIDTH: u32 = 128;

/// A complex number in float32, as all field buffers hold it: (re, im).
pub type Complex32 = num_complex::Complex32;

/// The same in float64, for what is made once.
pub type Complex64 = num_complex::Complex64;

/// Complex zero.
pub const ZERO: Complex32 = Complex32::new(0.0, 0.0);
