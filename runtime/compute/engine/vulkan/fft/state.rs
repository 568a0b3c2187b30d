//! What transforms take, and what they keep: plans with their tables, and scratch.

use crate::engine::Storage;
use crate::gpu::{Block, Commands, DeviceKind, Range};
use eyebox_kernels::fft_plan::{Axis, Method, Plan, Shared};
use std::collections::HashMap;
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

/// A plan with its tables on the device.
pub(in super::super) struct Planned {
    pub(in super::super) plan: Plan,
    pub(in super::super) twiddles: Block,
    pub(super) starts: Vec<u32>,
    /// Of a convolution: chirp and filter, and what transforms its length.
    pub(super) convolution: Option<(Block, Block, Arc<Planned>)>,
}

impl Planned {
    /// How its lines go through shared memory, if they do.
    pub(in super::super) fn shared(&self) -> Option<&Shared> {
        if let Method::Shared(shared) = &self.plan.method { Some(shared) } else { None }
    }
}

/// Plans, tables and scratch of all sizes seen: made when a size is first seen, and kept.
#[derive(Default)]
pub(in super::super) struct Fft {
    pub(super) axes: HashMap<(u32, Axis), Arc<Planned>>,
    pub(super) scratch: Option<Block>,
    /// Scratch that became too small while it was in a recording.
    pub(super) outgrown: Vec<Block>,
    /// Names of the passes recorded, where they are to be timed one by one.
    pub(in super::super) marks: Option<Vec<String>>,
}

/// Frames whose lines along one axis are transformed, in place.
#[derive(Clone, Copy)]
pub(super) struct Work<'a> {
    pub(super) data: Range<'a>,
    /// As large as the data, frames packed.
    pub(super) spare: Range<'a>,
    pub(super) frames: u32,
    pub(super) axis: Axis,
    /// Lines that are transformed: the first, how many, and how many there are before they wrap.
    pub(super) first: u32,
    pub(super) count: u32,
    pub(super) wrap: u32,
    /// Columns in use, the first and how many: what rows leave or find.
    pub(super) columns: [u32; 2],
    /// Values from row to row, and from frame to frame in the data and in the spare.
    pub(super) row: u32,
    pub(super) frame: u32,
    pub(super) spare_frame: u32,
    pub(super) inverse: bool,
    pub(super) storage: Storage,
}

impl Fft {
    /// The plans of rows and columns in words, once they are prepared.
    pub(in super::super) fn plans(&self, gpu: &Commands, height: usize, width: usize) -> [String; 2] {
        [(width, Axis::Rows), (height, columns_axis(gpu, width))].map(|(n, axis)| {
            match self.axes.get(&(n as u32, axis)) {
                Some(planned) => planned.plan.to_string(),
                None => String::new(),
            }
        })
    }

    pub(super) fn mark(&mut self, gpu: &mut Commands, name: impl FnOnce() -> String) {
        if let Some(marks) = &mut self.marks {
            gpu.recorder.mark(marks.len());
            marks.push(name());
        }
    }
}

/// How columns of frames this wide are transformed here.
pub(super) fn columns_axis(gpu: &Commands, width: usize) -> Axis {
    let in_software = gpu.device.planned_as == DeviceKind::Cpu;
    if in_software || !width.is_multiple_of(2) { Axis::Columns } else { Axis::ColumnPairs }
}
