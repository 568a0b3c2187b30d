//! The CPU engine's buffers.

use crate::engine::{
    Buffer, EngineError, Kernel, LookUp, PupilPass, Resource, Shape, Storage, misfit, not_kept, nothing_kept,
};
use eyebox_kernels::{Complex32, binary_angle, fft::Store, half};

/// Windows with fewer values in all than this are not worth splitting over threads.
pub(super) const SPLIT: usize = 1 << 15;

/// Buffers of one pupil, grown to the largest that it has held.
#[derive(Default)]
pub(super) struct Slot {
    pub(super) transfer: Vec<Complex32>,
    pub(super) window: Vec<Complex32>,
    pub(super) image: Vec<f32>,
    pub(super) target: Vec<f32>,
    pub(super) accumulator: Vec<f32>,
    pub(super) sums: Vec<f32>,
    pub(super) scratch: Vec<f32>,
    pub(super) loss: f64,
}

/// All buffers.
#[derive(Default)]
pub(super) struct Buffers {
    pub(super) phases: Vec<f32>,
    pub(super) shown: Vec<f32>,
    pub(super) levels: Vec<f32>,
    pub(super) momentum: Vec<f32>,
    pub(super) second: Vec<f32>,
    pub(super) field: Vec<Complex32>,
    pub(super) change: Vec<Complex32>,
    pub(super) hits: Vec<f32>,
    pub(super) energy: Vec<f32>,
    pub(super) wave: Vec<f32>,
    pub(super) blurred: Vec<f32>,
    pub(super) subpixels: Vec<Complex32>,
    pub(super) pixels: Vec<f32>,
    pub(super) crosstalk: Vec<f32>,
    pub(super) offsets: Vec<f32>,
    pub(super) relay: Vec<f32>,
    pub(super) mask: Vec<f32>,
    pub(super) mask_transfer: Vec<f32>,
    pub(super) slots: Vec<Slot>,
    /// Phases that are kept; none if it is empty.
    kept: Vec<f32>,
}

/// A display's model, as the tables that these kernels read.
#[derive(Clone, Copy)]
pub(super) struct ModelView<'a> {
    /// Of the pixels.
    pub(super) pixels: &'a [f32],
    /// Of crosstalk, along y and along x.
    pub(super) weights: [&'a [f32]; 2],
    /// Of the sub-pixels, along y and along x.
    pub(super) offsets: [&'a [Complex32]; 2],
    /// The static mask, and propagation to it.
    pub(super) mask: [&'a [Complex32]; 2],
}

impl<'a> ModelView<'a> {
    /// Of buffers of this shape.
    pub(super) fn new(
        shape: &Shape,
        pixels: &'a [f32],
        weights: &'a [f32],
        offsets: &'a [f32],
        mask: [&'a [f32]; 2],
    ) -> Self {
        let weights = if weights.is_empty() { [weights; 2] } else { shape.crosstalk().weights(weights) };
        let offsets: &[Complex32] = bytemuck::cast_slice(offsets);
        let along_y = if offsets.is_empty() { 0 } else { shape.subpixels() * shape.place.grid_height as usize };
        Self { pixels, weights, offsets: offsets.split_at(along_y).into(), mask: mask.map(bytemuck::cast_slice) }
    }
}

/// Contents of a buffer.
enum Values<'a> {
    Real(&'a mut Vec<f32>),
    Complex(&'a mut Vec<Complex32>),
}

impl Values<'_> {
    fn floats(&self) -> &[f32] {
        match self {
            Self::Real(values) => values,
            Self::Complex(values) => bytemuck::cast_slice(values),
        }
    }
}

impl Slot {
    /// Makes room for what a kernel reads and writes here.
    pub(super) fn fit(&mut self, kernel: Kernel, pass: &PupilPass, shape: &Shape) {
        for (_, resource) in kernel.binds().iter().filter(|(_, resource)| Resource::OF_SLOT.contains(resource)) {
            let extent = pass.extent(*resource, shape);
            match self.values(*resource) {
                Some(Values::Real(values)) => grow(values, extent.frames * extent.values),
                Some(Values::Complex(values)) => grow(values, extent.frames * extent.values),
                None => {}
            }
        }
    }

    /// Makes room for all that a pupil pass has here, and keeps what is there.
    pub(super) fn reserve(&mut self, pass: &PupilPass, shape: &Shape) {
        for resource in Resource::OF_SLOT.into_iter().filter(|resource| *resource != Resource::Sums) {
            let extent = pass.extent(resource, shape);
            let length = extent.frames * extent.values;
            match self.values(resource) {
                Some(Values::Real(values)) => values.reserve_exact(length.saturating_sub(values.len())),
                Some(Values::Complex(values)) => values.reserve_exact(length.saturating_sub(values.len())),
                None => {}
            }
        }
    }

    fn values(&mut self, resource: Resource) -> Option<Values<'_>> {
        Some(match resource {
            Resource::Transfer => Values::Complex(&mut self.transfer),
            Resource::Window => Values::Complex(&mut self.window),
            Resource::Image => Values::Real(&mut self.image),
            Resource::Target => Values::Real(&mut self.target),
            Resource::Accumulator => Values::Real(&mut self.accumulator),
            Resource::Sums => Values::Real(&mut self.sums),
            _ => return None,
        })
    }
}

impl Buffers {
    /// Makes those of this shape, all zero.
    pub(super) fn load(&mut self, shape: &Shape) -> Result<(), EngineError> {
        self.slots.clear();
        self.kept = Vec::new();
        for resource in Resource::OF_SHAPE {
            let extent = shape.extent(resource);
            let count = extent.frames * extent.values;
            match self.values(resource, None) {
                Some(Values::Real(values)) => renew(values, count, resource)?,
                Some(Values::Complex(values)) => renew(values, count, resource)?,
                None => {}
            }
        }
        Ok(())
    }

    /// Fills a buffer with values, which become what the shape stores of them.
    pub(super) fn write(&mut self, buffer: Buffer, data: &[f32], shape: &Shape) -> Result<(), EngineError> {
        let (resource, slot) = buffer.resource();
        if let Some(slot) = slot.filter(|slot| *slot >= self.slots.len()) {
            self.slots.resize_with(slot + 1, Slot::default);
        }
        let Some(values) = self.values(resource, slot) else { return Err(never_written(buffer)) };
        let has = values.floats().len();
        if slot.is_none() && has != data.len() {
            return Err(misfit(buffer, has, data.len()));
        }
        // In place: writing a large buffer again and again touches no new memory.
        match values {
            Values::Real(to) => {
                to.clear();
                to.extend_from_slice(data);
                match resource {
                    Resource::Phases if shape.binary_angles => binary_angle::round(to),
                    _ if shape.stores_half(resource) => half::round_drives(to),
                    _ => {}
                }
            }
            Values::Complex(to) => {
                let Ok(data) = bytemuck::try_cast_slice(data) else { return Err(misfit(buffer, has, data.len())) };
                to.clear();
                to.extend_from_slice(data);
                storing(resource.stored(shape.storage))(to);
            }
        }
        Ok(())
    }

    /// Fills the phases by a table. They are whole binary angles, which every shape stores as they are.
    pub(super) fn look_up(&mut self, of: &LookUp) -> Result<(), EngineError> {
        if self.phases.len() != of.count() {
            return Err(misfit(Buffer::Phases, self.phases.len(), of.count()));
        }
        of.phases_into(&mut self.phases)
    }

    pub(super) fn keep(&mut self, buffer: Buffer) -> Result<(), EngineError> {
        let from = match buffer {
            Buffer::Phases => &self.phases,
            Buffer::Shown => &self.shown,
            _ => return Err(not_kept(buffer)),
        };
        self.kept.clone_from(from);
        Ok(())
    }

    pub(super) fn kept(&self) -> Result<&[f32], EngineError> {
        if self.kept.is_empty() { Err(nothing_kept()) } else { Ok(&self.kept) }
    }

    pub(super) fn restore(&mut self) -> Result<(), EngineError> {
        if self.kept.is_empty() {
            return Err(nothing_kept());
        }
        self.phases.copy_from_slice(&self.kept);
        Ok(())
    }

    /// What a buffer holds.
    pub(super) fn read(&mut self, buffer: Buffer) -> Result<&[f32], EngineError> {
        let (resource, slot) = buffer.resource();
        match self.values(resource, slot) {
            Some(Values::Real(values)) => Ok(values),
            Some(Values::Complex(values)) => Ok(bytemuck::cast_slice(values)),
            None => Err(never_written(buffer)),
        }
    }

    fn values(&mut self, resource: Resource, slot: Option<usize>) -> Option<Values<'_>> {
        Some(match resource {
            Resource::Phases => Values::Real(&mut self.phases),
            Resource::Shown => Values::Real(&mut self.shown),
            Resource::Levels => Values::Real(&mut self.levels),
            Resource::Momentum => Values::Real(&mut self.momentum),
            Resource::Second => Values::Real(&mut self.second),
            Resource::Field => Values::Complex(&mut self.field),
            Resource::Change => Values::Complex(&mut self.change),
            Resource::Hits => Values::Real(&mut self.hits),
            Resource::Energy => Values::Real(&mut self.energy),
            Resource::Wave => Values::Real(&mut self.wave),
            Resource::Blurred => Values::Real(&mut self.blurred),
            Resource::Subpixels => Values::Complex(&mut self.subpixels),
            Resource::Pixels => Values::Real(&mut self.pixels),
            Resource::Crosstalk => Values::Real(&mut self.crosstalk),
            Resource::Offsets => Values::Real(&mut self.offsets),
            Resource::Relay => Values::Real(&mut self.relay),
            Resource::Mask => Values::Real(&mut self.mask),
            Resource::MaskTransfer => Values::Real(&mut self.mask_transfer),
            _ => return self.slots.get_mut(slot?)?.values(resource),
        })
    }
}

fn never_written(buffer: Buffer) -> EngineError {
    EngineError::Mismatch { reason: format!("{buffer:?} was never written") }
}

/// What happens to complex values when they are stored.
pub(super) fn storing(storage: Storage) -> Store {
    match storage {
        Storage::F32 => |_| {},
        Storage::F16 => half::round,
    }
}

/// And to drives.
pub(super) fn storing_drives(storage: Storage) -> fn(&mut [f32]) {
    match storage {
        Storage::F32 => |_| {},
        Storage::F16 => half::round_drives,
    }
}

/// Makes room for `length` values. What was there is gone where it has to grow: the old room is given back first, so that
/// pupils of growing size leave no trail of blocks behind.
fn grow<T: Clone + bytemuck::Zeroable>(buffer: &mut Vec<T>, length: usize) {
    if length > buffer.capacity() {
        *buffer = Vec::new();
        buffer.reserve_exact(length);
    }
    buffer.resize(length, T::zeroed());
}

fn renew<T: Clone + bytemuck::Zeroable>(buffer: &mut Vec<T>, length: usize, what: Resource) -> Result<(), EngineError> {
    buffer.clear();
    buffer.shrink_to(length);
    buffer.try_reserve_exact(length).map_err(|_| EngineError::OutOfMemory {
        device: "host".into(),
        what: what.name(),
        wanted: Some((length as u64).saturating_mul(size_of::<T>() as u64)),
    })?;
    buffer.resize(length, T::zeroed());
    Ok(())
}
