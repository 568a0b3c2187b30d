//! Transforms of frames.
//!
//! Plans are those of [`eyebox_kernels::fft_plan`]. Rows that fit shared memory are read and written once (`fft_shared`);
//! columns, and rows that are too long, take Stockham passes from the data to a scratch and back, the last of an odd
//! number in place (`fft_pass`); lengths with a prime factor above 13 are convolutions (`fft_chirp`). The inverse is the
//! forward transform with re and im swapped. Only columns in use are touched after the rows. Tables come from float64.
//! Where alignment allows, an invocation works on two neighbouring columns or butterflies and moves 16 bytes at a time:
//! on a software device an access has a price of its own, whatever its size. Fields stored as halves pass through halves
//! between passes too; registers and shared memory hold float32, and so does the scratch of a convolution, whose values
//! reach further than a half's.
//!
//! `record` plans and records, with `convolution` for large primes, from what `state` keeps; `transforms` runs transforms by
//! themselves, to compare and to measure them.

mod convolution;
mod record;
mod state;
mod transforms;

pub(super) use record::{in_use, plan_limits, row_groups, shared_constants};
pub(super) use state::{Along, Fft, Frames, Planned};
pub use transforms::{Timed, Transforms};
