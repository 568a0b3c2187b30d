//! Holds the buffers of the CPU engine.

use super::floats::Floats;
use crate::engine::{Buffer, EngineError, Kernel, PupilPass, Resource, Shape, Storage, misfit};
use eyebox_kernels::{Complex32, binary_angle, fft::Store, half};

/// Smallest number of values of all windows that is worth splitting over threads.
pub(super) const SPLIT: usize = 1 << 15;

/// Buffers of one pupil, which grow to the largest pupil that they held. Complex values are pairs of numbers.
#[derive(Default)]
pub(super) struct Slot {
    pub(super) transfer: Floats,
    pub(super) window: Floats,
    pub(super) image: Floats,
    pub(super) target: Floats,
    pub(super) accumulator: Floats,
    pub(super) sums: Floats,
    pub(super) scratch: Vec<f32>,
    pub(super) loss: f64,
}

/// All buffers. Complex values are pairs of numbers.
#[derive(Default)]
pub(super) struct Buffers {
    pub(super) phases: Floats,
    pub(super) shown: Floats,
    pub(super) levels: Floats,
    pub(super) momentum: Floats,
    pub(super) second: Floats,
    pub(super) field: Floats,
    pub(super) change: Floats,
    pub(super) hits: Floats,
    pub(super) energy: Floats,
    pub(super) wave: Floats,
    pub(super) blurred: Floats,
    pub(super) subpixels: Floats,
    pub(super) pixels: Floats,
    pub(super) crosstalk: Floats,
    pub(super) offsets: Floats,
    pub(super) relay: Floats,
    pub(super) mask: Floats,
    pub(super) mask_transfer: Floats,
    pub(super) slots: Vec<Slot>,
    /// Kept phases, empty if there are none.
    pub(super) kept: Floats,
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
                values.grow(pass.extent(*resource, shape).floats());
            }
        }
    }

    /// Makes room for all buffers of a pupil pass here, and keeps their content.
    pub(super) fn reserve(&mut self, pass: &PupilPass, shape: &Shape) {
        for resource in Resource::OF_SLOT.into_iter().filter(|resource| *resource != Resource::Sums) {
            if let Some(values) = self.values(resource) {
                values.reserve(pass.extent(resource, shape).floats());
            }
        }
    }

    fn values(&mut self, resource: Resource) -> Option<&mut Floats> {
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
        self.kept = Floats::default();
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
        to.set(data);
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

    fn values(&mut self, resource: Resource, slot: Option<usize>) -> Option<&mut Floats> {
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

fn renew(buffer: &mut Floats, length: usize, what: Resource) -> Result<(), EngineError> {
    buffer.renew(length).map_err(|_| EngineError::OutOfMemory {
        device: "host".into(),
        what: what.name(),
        wanted: Some((length as u64).saturating_mul(4)),
    })
}
