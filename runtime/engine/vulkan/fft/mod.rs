//! Transforms of frames: the seam behind which they are recorded, and what is behind it.
//!
//! Plans are those of [`eyebox_kernels::fft_plan`]. Rows that fit shared memory are read and written once (`fft_rows`);
//! columns, and rows that are too long, take Stockham passes from the data to a scratch and back, the last of an odd
//! number in place (`fft_pass`); lengths with a prime factor above 13 are convolutions (`fft_chirp`). The inverse is the
//! forward transform with re and im swapped. Only columns in use are touched after the rows. Tables come from float64.
//! Where alignment allows, an invocation works on two neighbouring columns or butterflies and moves 16 bytes at a time:
//! on a software device an access has a price of its own, whatever its size. Fields stored as halves pass through halves
//! between passes too; registers and shared memory hold float32, and so does the scratch of a convolution, whose values
//! reach further than a half's.
//!
//! `record` plans and records, with `convolution` for large primes; `transforms` runs transforms by themselves, to
//! compare and to measure them.

mod convolution;
mod record;
mod transforms;

use crate::gpu::{Block, Commands};
use record::Fft;
pub use transforms::{Timed, Transforms};

use super::super::{EngineError, Storage};
use eyebox_kernels::fft::{Columns, Direction};

/// Complex frames (count, height, width) in a block: frame `i` starts at byte `offset + size * stride * i`, where `size`
/// is that of a stored value.
///
/// `offset` and `size * stride` are multiples of the device's alignment; all frames together may exceed the largest range
/// that a kernel may see, one frame never does.
#[derive(Clone, Copy)]
pub(super) struct Frames<'a> {
    pub(super) block: &'a Block,
    /// Bytes.
    pub(super) offset: u64,
    pub(super) count: usize,
    pub(super) height: usize,
    pub(super) width: usize,
    /// Complex values from one frame to the next, at least `height * width`.
    pub(super) stride: usize,
    /// How the values are stored; what passes leave to each other is stored in the same way.
    pub(super) storage: Storage,
}

/// Records transforms: plans, tables and pipelines are made when a size is first seen, and kept.
pub(super) trait Transform {
    /// Makes what `record` needs for frames of this (height, width), if it is not there yet (this may upload, so nothing is being recorded).
    fn prepare(&mut self, gpu: &mut Commands, size: [usize; 2], storage: Storage) -> Result<(), EngineError>;

    /// Records the pruned transform of `kernels::fft`, in place. No barrier is needed before or after: the engine sets
    /// them; those between passes are set here.
    fn record(
        &mut self,
        gpu: &mut Commands,
        frames: Frames<'_>,
        direction: Direction,
        columns: Columns,
    ) -> Result<(), EngineError>;
}

/// The transforms of this engine.
pub(super) fn transforms() -> Box<dyn Transform + Send> {
    Box::new(Fft::new())
}
