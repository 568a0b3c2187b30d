//! Implements the kernels of a step as GLSL shaders, with a CPU twin of the same name for each, in Rust.
//!
//! A CPU twin is the implementation of a kernel on the CPU, and the reference for its shader. Tests compare each twin
//! with float64. A twin takes its arguments (plain data, `#[repr(C)]`), then its input buffers, then its outputs, in
//! the order of the bindings of its shader. Twins work on one frame or one pupil pass. A pupil pass is the work of one
//! step for one pupil. The engines decide how many of them run at once. Field buffers are complex, in float32 or in
//! halves ([`half`]). The axis of the frames comes first. Spectra are in the order of the DFT.
//!
//! This crate imports nothing from the runtime. The macro [`kernels!`] lists the kernels of a step. [`encode`] and
//! [`pixels`] are not in the list, because they belong to a display. Neither are [`decode_views`] and [`halve_views`],
//! which work on the views that an application gives. [`pupil_light`] and [`table_start`] run once, at the beginning of
//! a solve.
//!
//! Views of splats have three kernels. These are [`project_splats`], [`mark_splats`] and [`draw_splats`]. Module
//! [`relief`] lists the kernels of views of pictures with depths.
//!
//! The frames of OpenXR applications have two kernels, [`compose_layer`] and [`finish_layers`]. Their twin is
//! in `tools/openxr`, which composes frames in the process of the application.

pub mod adam;
pub mod apply_factor;
pub mod binary_angle;
pub mod check_finite;
pub mod compare;
pub mod compose_layer;
pub mod crosstalk;
pub mod decode_views;
pub mod divide_by_overlap;
pub mod draw_splats;
pub mod drive;
pub mod drive_adjoint;
pub mod encode;
mod encode_levels;
pub mod energy;
pub mod equalise_eyebox;
pub mod exposure;
pub mod eye;
pub mod fft;
mod fft_columns;
pub mod fft_plan;
pub mod finish_layers;
pub mod half;
pub mod halve_views;
pub mod intensity;
pub mod lag;
pub mod layers;
pub mod machine;
pub mod mark_splats;
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
pub mod project_splats;
pub mod pupil_adjoint;
pub mod pupil_light;
pub mod quantise;
pub mod regression;
pub mod relay;
pub mod relief;
pub mod relief_close;
pub mod relief_decode;
pub mod relief_draw;
pub mod relief_fill;
pub mod relief_jump;
pub mod relief_levels;
pub mod relief_sharpen;
pub mod relief_soften;
pub mod relief_surfaces;
pub mod relief_unmix;
pub mod resample;
pub mod scattered;
pub mod shared;
mod simd;
pub mod splat_colors;
pub mod subpixels;
mod table;
pub mod table_start;
pub mod taper;
pub mod transfer;
pub mod trig;

pub use simd::{simd, simd_name};

/// Columns or pixels of a workgroup, for all shaders that do not compute sums.
pub const WIDTH: u32 = 64;
/// Maximum number of pupils in one dispatch of a shader that takes several.
pub const BATCH: usize = 16;
/// Rows, and columns, of the square of pixels that one workgroup of a shader over tiles computes.
pub const TILE: u32 = 32;
/// Invocations of a workgroup of a shader over tiles.
pub const TILE_THREADS: u32 = 128;
/// Invocations of a workgroup of a shader that computes sums.
pub const SUM_WIDTH: u32 = 128;

/// A complex number in float32, stored as (re, im) in all field buffers.
pub type Complex32 = num_complex::Complex32;

/// A complex number in float64, for values that are computed once.
pub type Complex64 = num_complex::Complex64;

/// The complex number 0.
pub const ZERO: Complex32 = Complex32::new(0.0, 0.0);
