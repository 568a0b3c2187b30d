//! The seam behind which transforms are recorded.

use super::state::Planned;
use crate::engine::{EngineError, Storage};
use crate::gpu::{Block, Commands};
use eyebox_kernels::fft::{Columns, Direction};
use eyebox_kernels::fft_plan::Axis;
use std::sync::Arc;

/// Complex frames (count, height, width) in a block: frame `i` starts at byte `offset + size * stride * i`, where `size`
/// is that of a stored value.
///
/// `offset` and `size * stride` are multiples of the device's alignment; all frames together may exceed the largest range
/// that a kernel may see, one frame never does.
#[derive(Clone, Copy)]
pub(in super::super) struct Frames<'a> {
    pub(in super::super) block: &'a Block,
    /// Bytes.
    pub(in super::super) offset: u64,
    pub(in super::super) count: usize,
    pub(in super::super) height: usize,
    pub(in super::super) width: usize,
    /// Complex values from one frame to the next, at least `height * width`.
    pub(in super::super) stride: usize,
    /// How the values are stored; what passes leave to each other is stored in the same way.
    pub(in super::super) storage: Storage,
}

/// Which lines are transformed.
#[derive(Clone, Copy, PartialEq)]
pub(in super::super) enum Along {
    Both,
    Rows,
    Columns,
}

/// Records transforms: plans, tables and pipelines are made when a size is first seen, and kept.
pub(in super::super) trait Transform {
    /// Makes what `record` needs for frames of this (height, width), if it is not there yet (this may upload, so nothing is being recorded).
    fn prepare(&mut self, gpu: &mut Commands, size: [usize; 2], storage: Storage) -> Result<(), EngineError>;

    /// The plan of a length that was prepared, with its tables.
    fn planned(&self, n: usize, axis: Axis) -> Option<Arc<Planned>>;

    /// Records the pruned transform of `kernels::fft`, in place. No barrier is needed before or after: the engine sets
    /// them; those between passes are set here.
    fn record(
        &mut self,
        gpu: &mut Commands,
        frames: Frames<'_>,
        direction: Direction,
        columns: Columns,
        along: Along,
    ) -> Result<(), EngineError>;
}
