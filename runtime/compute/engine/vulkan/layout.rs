//! Places frames at a stride inside a block, and the buffers of pupil passes inside arenas.

use super::super::{Buffer, EngineError, PupilPass, Resource, Shape, Step, Storage};
use crate::gpu::{Block, Commands, Piece, Range};
use crate::plan::BufferSize;
use eyebox_kernels::{binary_angle, half};
use std::ops::Range as PupilPasses;

/// Frames start at multiples of this number of bytes, the largest alignment that a device may require, and of 64
/// values.
const ALIGNMENT: usize = 256;

/// Frames of one size in a block.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Layout {
    /// Offset in bytes, a multiple of 256.
    pub(super) offset: u64,
    pub(super) frames: usize,
    /// Number of values in a frame.
    pub(super) values: usize,
    pub(super) value: Value,
}

/// The type of a value.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Value {
    /// A number stored as float32.
    Real,
    /// A phase, as a binary angle.
    Angle,
    /// A number stored as a half.
    Half,
    /// A complex number in this storage.
    Complex(Storage),
}

impl Value {
    /// Returns the size in bytes.
    pub(super) fn size(self) -> usize {
        match self {
            Self::Real => 4,
            Self::Angle | Self::Half => 2,
            Self::Complex(storage) => storage.bytes(),
        }
    }
}

impl Layout {
    /// Returns the number of values from one frame to the next.
    pub(super) fn stride(&self) -> usize {
        self.values.next_multiple_of((ALIGNMENT / self.value.size()).max(64))
    }

    /// Returns the bytes from one frame to the next.
    pub(super) fn step(&self) -> u64 {
        (self.stride() * self.value.size()) as u64
    }

    /// Returns the bytes of all frames, including the rest of the last stride.
    pub(super) fn bytes(&self) -> u64 {
        self.step() * self.frames as u64
    }

    /// Returns the number of float32 values for the host.
    pub(super) fn floats(&self) -> usize {
        self.frames * self.values * if matches!(self.value, Value::Complex(_)) { 2 } else { 1 }
    }

    /// Returns the bytes of a frame without the rest of its stride.
    pub(super) fn frame_bytes(&self) -> usize {
        // Copies have a granularity of four bytes.
        (self.values * self.value.size()).next_multiple_of(4)
    }

    /// Returns true if a frame of 16-bit numbers is copied with one more.
    fn is_padded(&self) -> bool {
        self.values * self.value.size() != self.frame_bytes()
    }

    /// Pads frames of 16-bit values for the copy.
    fn padded(&self, values: Vec<u16>) -> Vec<u16> {
        if !self.is_padded() {
            return values;
        }
        values.chunks(self.values).flat_map(|frame| frame.iter().copied().chain([0])).collect()
    }

    /// Removes the padding from frames of 16-bit values.
    fn unpadded(&self, values: Vec<u16>) -> Vec<u16> {
        if !self.is_padded() {
            return values;
        }
        values.chunks(self.values + 1).flat_map(|frame| &frame[..self.values]).copied().collect()
    }

    /// Returns the range of frames `first .. first + count`.
    pub(super) fn range<'a>(&self, block: &'a Block, first: usize, count: usize) -> Range<'a> {
        block.range(self.offset + first as u64 * self.step(), count as u64 * self.step())
    }

    /// Returns the number of frames that a kernel may bind at once.
    pub(super) fn at_once(&self, largest: u64) -> usize {
        (largest / self.step().max(1)) as usize
    }

    /// Returns the number of frames in `bytes` bytes.
    pub(super) fn frames_in(&self, bytes: u64) -> usize {
        (bytes / self.step().max(1)) as usize
    }

    /// Returns the pieces to copy from the packed data to the block.
    pub(super) fn pieces(&self) -> impl Iterator<Item = Piece> + use<> {
        let (layout, bytes) = (*self, self.frame_bytes() as u64);
        (0..layout.frames as u64).map(move |f| (f * bytes, layout.offset + f * layout.step(), bytes))
    }

    /// Returns the pieces to copy from the block to the packed data.
    pub(super) fn pieces_back(&self) -> impl Iterator<Item = Piece> + use<> {
        self.pieces().map(|(host, device, bytes)| (device, host, bytes))
    }

    /// Fills the frames with packed data.
    pub(super) fn write(&self, gpu: &mut Commands, block: &Block, data: &[f32]) -> Result<(), EngineError> {
        let bits = match self.value {
            Value::Angle => binary_angle::pack(data),
            Value::Half | Value::Complex(Storage::F16) => half::pack(data),
            Value::Real | Value::Complex(Storage::F32) => {
                return gpu.upload(block, bytemuck::cast_slice(data), self.pieces());
            }
        };
        gpu.upload(block, bytemuck::cast_slice(&self.padded(bits)), self.pieces())
    }

    /// Reads the frames as packed data.
    pub(super) fn read(&self, gpu: &mut Commands, block: &Block) -> Result<Vec<f32>, EngineError> {
        if matches!(self.value, Value::Real | Value::Complex(Storage::F32)) {
            let mut data = vec![0.0f32; self.floats()];
            gpu.download(block, bytemuck::cast_slice_mut(&mut data), self.pieces_back())?;
            return Ok(data);
        }
        let mut bits = vec![0u16; self.frames * self.frame_bytes() / 2];
        gpu.download(block, bytemuck::cast_slice_mut(&mut bits), self.pieces_back())?;
        let bits = self.unpadded(bits);
        Ok(if self.value == Value::Angle { binary_angle::unpack(&bits) } else { half::unpack(&bits) })
    }
}

/// The kinds of pupil pass buffers, each with its arena.
const KINDS: usize = Resource::OF_SLOT.len();

/// Returns the index of a pupil pass buffer in a [`Slot`], if it is one.
pub(super) fn slot_layout(resource: Resource) -> Option<usize> {
    Resource::OF_SLOT.iter().position(|r| *r == resource)
}

/// Returns the index in a slot, and the slot, of a pupil pass buffer.
pub(super) fn pupil_pass_buffer(buffer: Buffer) -> Option<(Resource, usize, usize)> {
    let (resource, slot) = buffer.resource();
    Some((resource, slot_layout(resource)?, slot?))
}

/// Places of the buffers of one pupil pass, by kind.
pub(super) type Slot = [Layout; KINDS];

/// Returns the order of pupil passes in memory. They are sorted by the rows of their windows or by the columns first,
/// whichever gives more neighbors with equal sizes.
fn order(pupil_passes: &[PupilPass]) -> Vec<usize> {
    let size = |at: usize| [pupil_passes[at].window.rows, pupil_passes[at].window.columns];
    let mut orders = [0, 1].map(|first| {
        let mut order: Vec<usize> = (0..pupil_passes.len()).collect();
        order.sort_by_key(|at| (size(*at)[first], size(*at)[1 - first]));
        order
    });
    let alike = |order: &[usize]| {
        let alike = |pair: &[usize]| (0..2).filter(|axis| size(pair[0])[*axis] == size(pair[1])[*axis]).count();
        order.windows(2).map(alike).sum::<usize>()
    };
    let by_columns = alike(&orders[1]) > alike(&orders[0]);
    std::mem::take(&mut orders[usize::from(by_columns)])
}

/// Returns the slots of neighboring pupil passes, one after the other in each arena, in their [`order`]. The same
/// pupil passes always have the same places.
pub(super) fn slots(pupil_passes: &[PupilPass], shape: &Shape) -> Vec<Slot> {
    let mut ends = [0u64; KINDS];
    let mut slots = vec![[Layout { offset: 0, frames: 0, values: 0, value: Value::Real }; KINDS]; pupil_passes.len()];
    for at in order(pupil_passes) {
        for ((layout, end), resource) in slots[at].iter_mut().zip(&mut ends).zip(Resource::OF_SLOT) {
            let BufferSize { frames, values, complex } = pupil_passes[at].extent(resource, shape);
            let value = if complex { Value::Complex(resource.stored(shape.storage)) } else { Value::Real };
            *layout = Layout { offset: *end, frames, values, value };
            *end += layout.bytes();
        }
    }
    slots
}

/// Returns the slots of all pupil passes of a step, group by group, and their order in memory.
pub(super) fn all_slots(step: &Step, shape: &Shape) -> (Vec<Slot>, Vec<usize>) {
    let mut all = Vec::with_capacity(step.pupil_passes.len());
    let mut in_order = Vec::with_capacity(step.pupil_passes.len());
    for group in step.list.iter().map(|d| d.pupil_passes.clone()) {
        if group.start == all.len() {
            in_order.extend(order(&step.pupil_passes[group.clone()]).into_iter().map(|at| group.start + at));
            all.extend(slots(&step.pupil_passes[group], shape));
        }
    }
    (all, in_order)
}

/// The blocks with the buffers of pupil passes. They only grow.
#[derive(Default)]
pub(super) struct Arenas {
    blocks: [Option<Block>; KINDS],
}

impl Arenas {
    /// Makes room for the largest group of pupil passes of the whole step. The content of a block is lost when it
    /// grows.
    pub(super) fn fit(&mut self, gpu: &mut Commands, step: &Step, shape: &Shape) -> Result<(), EngineError> {
        let mut needs = [0u64; KINDS];
        let mut groups: Vec<PupilPasses<usize>> =
            step.list.iter().map(|d| d.pupil_passes.clone()).filter(|l| !l.is_empty()).collect();
        groups.dedup();
        for group in groups {
            for slot in slots(&step.pupil_passes[group], shape) {
                for (need, layout) in needs.iter_mut().zip(&slot) {
                    *need = (*need).max(layout.offset + layout.bytes());
                }
            }
        }
        self.grow(gpu, needs)
    }

    /// Makes room for `at_once` of any of these pupil passes.
    pub(super) fn fit_any(
        &mut self,
        gpu: &mut Commands,
        pupil_passes: &[PupilPass],
        at_once: usize,
        shape: &Shape,
    ) -> Result<(), EngineError> {
        let mut needs = [0u64; KINDS];
        for slot in pupil_passes.iter().flat_map(|pass| slots(std::slice::from_ref(pass), shape)) {
            for (need, layout) in needs.iter_mut().zip(&slot) {
                *need = (*need).max(at_once as u64 * layout.bytes());
            }
        }
        self.grow(gpu, needs)
    }

    fn grow(&mut self, gpu: &mut Commands, needs: [u64; KINDS]) -> Result<(), EngineError> {
        for ((need, block), resource) in needs.into_iter().zip(&mut self.blocks).zip(Resource::OF_SLOT) {
            if need > block.as_ref().map_or(0, |b| b.size) {
                // The old block is freed first, because both may not fit.
                gpu.recorder.idle()?;
                *block = None;
                *block = Some(gpu.block(need, &resource.name())?);
            }
        }
        Ok(())
    }

    pub(super) fn block(&self, resource: Resource) -> Option<&Block> {
        slot_layout(resource).and_then(|at| self.blocks[at].as_ref())
    }
}
