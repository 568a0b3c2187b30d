//! Holds the arguments of transforms, and their kept plans, tables and scratch.

use crate::engine::Storage;
use crate::gpu::{Block, Commands, DeviceKind, Range};
use eyebox_kernels::fft_plan::{Axis, Method, Plan, Shared};
use std::collections::HashMap;
use std::sync::Arc;

/// Complex frames (count, height, width) in a block.
///
/// Frame `i` starts at byte `offset + size * stride * i`, where `size` is the size of a stored value. `offset` and
/// `size * stride` are multiples of the device's alignment. All frames together may exceed the largest range that a
/// kernel may bind, but one frame never does.
#[derive(Clone, Copy)]
pub(in super::super) struct Frames<'a> {
    pub(in super::super) block: &'a Block,
    /// Offset of the first frame in bytes.
    pub(in super::super) offset: u64,
    pub(in super::super) count: usize,
    pub(in super::super) height: usize,
    pub(in super::super) width: usize,
    /// Complex values from one frame to the next, at least `height * width`.
    pub(in super::super) stride: usize,
    /// Storage of the values, also between passes.
    pub(in super::super) storage: Storage,
}

/// The lines that are transformed.
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
    /// For a convolution its chirp and filter, and the plan for its length.
    pub(super) convolution: Option<(Block, Block, Arc<Planned>)>,
}

impl Planned {
    /// Returns the path of its lines through shared memory, if they take it.
    pub(in super::super) fn shared(&self) -> Option<&Shared> {
        if let Method::Shared(shared) = &self.plan.method { Some(shared) } else { None }
    }
}

/// Plans, tables and scratch of all sizes that occurred. They are made at first use and kept.
#[derive(Default)]
pub(in super::super) struct Fft {
    pub(super) axes: HashMap<(u32, Axis), Arc<Planned>>,
    pub(super) scratch: Option<Block>,
    /// Scratch that became too small while a recording used it.
    pub(super) outgrown: Vec<Block>,
    /// Names of the recorded passes, if they are timed one by one.
    pub(in super::super) marks: Option<Vec<String>>,
}

/// Frames whose lines along one axis are transformed, in place.
#[derive(Clone, Copy)]
pub(super) struct Work<'a> {
    pub(super) data: Range<'a>,
    /// Scratch of the size of the data, with packed frames.
    pub(super) spare: Range<'a>,
    pub(super) frames: u32,
    pub(super) axis: Axis,
    /// The first line to transform, the count of lines, and the number at which indices wrap.
    pub(super) first: u32,
    pub(super) count: u32,
    pub(super) wrap: u32,
    /// The first column in use and their count, which rows write or read.
    pub(super) columns: [u32; 2],
    /// Values from row to row, and from frame to frame in the data and in the spare.
    pub(super) row: u32,
    pub(super) frame: u32,
    pub(super) spare_frame: u32,
    pub(super) inverse: bool,
    pub(super) storage: Storage,
}

impl Fft {
    /// Returns the plans of rows and columns as text, once they are prepared.
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

/// Returns the axis kind for the columns of frames of this width on this device.
pub(super) fn columns_axis(gpu: &Commands, width: usize) -> Axis {
    let in_software = gpu.device.planned_as == DeviceKind::Cpu;
    if in_software || !width.is_multiple_of(2) { Axis::Columns } else { Axis::ColumnPairs }
}
