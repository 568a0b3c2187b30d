//! Transforms frames on the device.
//!
//! Plans are from [`eyebox_kernels::fft_plan`]. Rows that fit shared memory are read and written once (`fft_shared`).
//! Columns, and rows that are too long, take Stockham passes from the data to a scratch and back (`fft_pass`). If the
//! number of passes is odd, the last one is in place. Lengths with a prime factor above 13 are convolutions
//! (`fft_chirp`). The inverse is the forward transform with re and im swapped. After the rows, only columns in use
//! are touched. Tables are computed in float64.
//!
//! Where alignment allows, an invocation works on two neighboring columns or butterflies and moves 16 bytes at a
//! time, because on a software device an access has a fixed cost. Fields stored as halves are also halves between
//! passes. Registers and shared memory hold float32, and so does the scratch of a convolution, whose values exceed
//! the range of a half.
//!
//! Module `record` plans and records, with `convolution` for large primes, and `state` keeps the plans and scratch.
//! Module `transforms` runs single transforms, for comparison and measurement.

mod convolution;
mod record;
mod state;
mod transforms;

pub(super) use record::{in_use, plan_limits, row_groups, shared_constants};
pub(super) use state::{Along, Fft, Frames, Planned};
pub use transforms::{Timed, Transforms};
