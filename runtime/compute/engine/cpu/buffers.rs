//! Holds the buffers of the CPU engine.

use crate::engine::{Buffer, EngineError, Kernel, PupilPass, Resource, Shape, Storage, misfit};
use eyebox_kernels::{Complex32, binary_angle, fft::Store, half};

/// Smallest number of values of all windows that is worth splitting over threads.
pub(super) const SPLIT: usize = 1 << 15;

/// Buffers of one pupil, which grow to the largest pupil that they held. Complex values are pairs of numbers.
#[derive(Default)]
pub(super) struct Slot {
    pub(super) transfer: Vec<f32>,
    pub(super) window: Vec<f32>,
    pub(super) image: Vec<f32>,
    pub(super) target: Vec<f32>,
    pub(super) accumulator: Vec<f32>,
    pub(super) sums: Vec<f32>,
    pub(super) scratch: Vec<f32>,
    pub(super) loss: f64,
}

/// All buffers. Complex values are pairs of numbers.
#[derive(Default)]
pub(super) struct Buffers {
    pub(super) phases: Vec<f32>,
    pub(super) shown: Vec<f32>,
    pub(super) levels: Vec<f32>,
    pub(super) momentum: Vec<f32>,
    pub(super) second: Vec<f32>,
    pub(super) field: Vec<f32>,
    pub(super) change: Vec<f32>,
    pub(super) hits: Vec<f32>,
    pub(super) energy: Vec<f32>,
    pub(super) wave: Vec<f32>,
    pub(super) blurred: Vec<f32>,
    pub(super) subpixels: Vec<f32>,
    pub(super) pixels: Vec<f32>,
    pub(super) crosstalk: Vec<f32>,
    pub(super) offsets: Vec<f32>,
    pub(super) relay: Vec<f32>,
    pub(super) mask: Vec<f32>,
    pub(super) mask_transfer: Vec<f32>,
    pub(super) slots: Vec<Slot>,
    /// Kept phases, empty if there are none.
    pub(super) kept: Vec<f32>,
}

/// The tables of a display's model that kernels over sub-frames read.
#[derive(Clone, Copy)]
pub(super) struct ModelView<'a> {
    /// Table of the pixels.
    pub(super) pixels: &'a [f32],
    /// Weights of crosstalk, along y and along x.
    pub(super) weights: [&'a [f32]; 2],
    /// Offsets of the sub-pixels, along y and along x.
    pub(super) offsets: [&'a [Complex32]; 2],
    /// The static mask, and the propagation to it.
    pub(super) mask: [&'a [Complex32]; 2],
}

impl<'a> ModelView<'a> {
    /// Makes a view of buffers of this shape.
    pub(super) fn new(
        shape: &Shape,
        pixels: &'a [f32],
        weights: &'a [f32],
        offsets: &'a [f32],
        mask: [&'a [f32]; 2],
    ) -> Self {
        let weights = if weights.is_empty() { [weights; 2] } else { shape.crosstalk().weights(weights) };
        let offsets = complex(offsets);
        let along_y = if offsets.is_empty() { 0 } else { shape.subpixels() * shape.place.grid_height as usize };
        Self { pixels, weights, offsets: offsets.split_at(along_y).into(), mask: mask.map(complex) }
    }
}

impl Slot {
    /// Makes room for the buffers that a kernel reads and writes here.
    pub(super) fn fit(&mut self, kernel: Kernel, pass: &PupilPass, shape: &Shape) {
        for (_, resource) in kernel.binds().iter().filter(|(_, resource)| Resource::OF_SLOT.contains(resource)) {
            if let Some(values) = self.values(*resource) {
                grow(values, pass.extent(*resource, shape).floats());
            }
        }
    }

    /// Makes room for all buffers of a pupil pass here, and keeps their content.
    pub(super) fn reserve(&mut self, pass: &PupilPass, shape: &Shape) {
        for resource in Resource::OF_SLOT.into_iter().filter(|resource| *resource != Resource::Sums) {
            if let Some(values) = self.values(resource) {
                values.reserve_exact(pass.extent(resource, shape).floats().saturating_sub(values.len()));
            }
        }
    }

    fn values(&mut self, resource: Resource) -> Option<&mut Vec<f32>> {
        Some(match resource {
            Resource::Transfer => &mut self.transfer,
            Resource::Window => &mut self.window,
            Resource::Image => &mut self.image,
            Resource::Target => &mut self.target,
            Resource::Accumulator => &mut self.accumulator,
            Resource::Sums => &mut self.sums,
            _ => return None,
        })
    }
}

impl Buffers {
    /// Makes the buffers of this shape, all zero.
    pub(super) fn load(&mut self, shape: &Shape) -> Result<(), EngineError> {
        self.slots.clear();
        self.kept = Vec::new();
        for resource in Resource::OF_SHAPE {
            if let Some(values) = self.values(resource, None) {
                renew(values, shape.extent(resource).floats(), resource)?;
            }
        }
        Ok(())
    }

    /// Fills a buffer with values, rounded as the shape stores them.
    pub(super) fn write(&mut self, buffer: Buffer, data: &[f32], shape: &Shape) -> Result<(), EngineError> {
        let (resource, slot) = buffer.resource();
        if let Some(slot) = slot.filter(|slot| *slot >= self.slots.len()) {
            self.slots.resize_with(slot + 1, Slot::default);
        }
        let to = self.values(resource, slot).ok_or_else(|| never_written(buffer))?;
        if (slot.is_none() && to.len() != data.len()) || (resource.is_complex() && !data.len().is_multiple_of(2)) {
            return Err(misfit(buffer, to.len(), data.len()));
        }
        // The memory is reused, so that writing a large buffer repeatedly touches no new memory.
        to.clear();
        to.extend_from_slice(data);
        match resource {
            _ if resource.is_complex() => storing(resource.stored(shape.storage))(complex_mut(to)),
            Resource::Phases if shape.binary_angles => binary_angle::round(to),
            _ if shape.stores_half(resource) => half::round_drives(to),
            _ => {}
        }
        Ok(())
    }

    /// Returns the content of a buffer.
    pub(super) fn read(&mut self, buffer: Buffer) -> Result<&[f32], EngineError> {
        let (resource, slot) = buffer.resource();
        self.values(resource, slot).map(|values| &values[..]).ok_or_else(|| never_written(buffer))
    }

    fn values(&mut self, resource: Resource, slot: Option<usize>) -> Option<&mut Vec<f32>> {
        Some(match resource {
            Resource::Phases => &mut self.phases,
            Resource::Shown => &mut self.shown,
            Resource::Levels => &mut self.levels,
            Resource::Momentum => &mut self.momentum,
            Resource::Second => &mut self.second,
            Resource::Field => &mut self.field,
            Resource::Change => &mut self.change,
            Resource::Hits => &mut self.hits,
            Resource::Energy => &mut self.energy,
            Resource::Wave => &mut self.wave,
            Resource::Blurred => &mut self.blurred,
            Resource::Subpixels => &mut self.subpixels,
            Resource::Pixels => &mut self.pixels,
            Resource::Crosstalk => &mut self.crosstalk,
            Resource::Offsets => &mut self.offsets,
            Resource::Relay => &mut self.relay,
            Resource::Mask => &mut self.mask,
            Resource::MaskTransfer => &mut self.mask_transfer,
            _ => return self.slots.get_mut(slot?)?.values(resource),
        })
    }
}

fn never_written(buffer: Buffer) -> EngineError {
    EngineError::mismatch(format!("{buffer:?} was never written"))
}

/// Views numbers as complex values.
pub(super) fn complex(numbers: &[f32]) -> &[Complex32] {
    bytemuck::cast_slice(numbers)
}

/// Views numbers as mutable complex values.
pub(super) fn complex_mut(numbers: &mut [f32]) -> &mut [Complex32] {
    bytemuck::cast_slice_mut(numbers)
}

/// Returns the rounding of complex values in this storage.
pub(super) fn storing(storage: Storage) -> Store {
    match storage {
        Storage::F32 => |_| {},
        Storage::F16 => half::round,
    }
}

/// Returns the rounding of drives in this storage.
pub(super) fn storing_drives(storage: Storage) -> fn(&mut [f32]) {
    match storage {
        Storage::F32 => |_| {},
        Storage::F16 => half::round_drives,
    }
}

/// Makes room for `length` values. The content is lost if the buffer has to grow. The old memory is released first,
/// so that pupils of growing size leave no trail of blocks.
fn grow(buffer: &mut Vec<f32>, length: usize) {
    if length > buffer.capacity() {
        *buffer = Vec::new();
        buffer.reserve_exact(length);
    }
    buffer.resize(length, 0.0);
}

fn renew(buffer: &mut Vec<f32>, length: usize, what: Resource) -> Result<(), EngineError> {
    buffer.clear();
    buffer.shrink_to(length);
    buffer.try_reserve_exact(length).map_err(|_| EngineError::OutOfMemory {
        device: "host".into(),
        what: what.name(),
        wanted: Some((length as u64).saturating_mul(4)),
    })?;
    buffer.resize(length, 0.0);
    Ok(())
}
