//! Allocates memory of a device as buffers, which are freed when they are dropped.

use super::device::Device;
use super::error::EngineError;
use crate::plan::Move;
use ash::vk::{self, Handle};
use gpu_allocator::vulkan::{Allocation, AllocationCreateDesc, AllocationScheme};
use gpu_allocator::{AllocationError, MemoryLocation};
use std::sync::Arc;

/// A buffer with its memory, freed when dropped.
pub struct Block {
    /// Vulkan's handle of the buffer.
    pub raw: vk::Buffer,
    /// Size of the buffer in bytes.
    pub size: u64,
    allocation: Option<Allocation>,
    /// Memory that another process shares, instead of an allocation.
    shared: Option<vk::DeviceMemory>,
    device: Arc<Device>,
}

/// A range of a block, in bytes, as a kernel binds it. `offset` is a multiple of the device's alignment.
#[derive(Clone, Copy)]
pub struct Range<'a> {
    pub(crate) block: &'a Block,
    pub(crate) offset: u64,
    pub(crate) size: u64,
}

impl Range<'_> {
    /// Returns a read of `bytes` bytes of the range, or after its start.
    pub(crate) fn reads(&self, bytes: u64) -> Move {
        Move { place: (self.block.raw.as_raw(), self.offset), bytes, write: false }
    }

    /// Returns a write of `bytes` bytes of the range, or after its start.
    pub(crate) fn writes(&self, bytes: u64) -> Move {
        Move { write: true, ..self.reads(bytes) }
    }

    /// Returns a read and a write of the range, without empty ones.
    pub(crate) fn moves(&self, read: u64, written: u64) -> impl Iterator<Item = Move> {
        [self.reads(read), self.writes(written)].into_iter().filter(|m| m.bytes > 0)
    }
}

/// Blocks from this size on have dedicated memory.
const DEDICATED: u64 = 4 << 20;

impl Block {
    /// Allocates `size` bytes. `what` is their name in errors.
    pub fn new(device: &Arc<Device>, size: u64, location: MemoryLocation, what: &str) -> Result<Self, EngineError> {
        let size = size.max(256);
        let out = |what: String| {
            let device = device.report.name.clone();
            EngineError::OutOfMemory { device, what, wanted: Some(size) }
        };
        // A card with more free memory refuses this as well, so the error has the limit.
        let limit = device.report.limits.allocation;
        if size > limit {
            return Err(out(format!("{what} (one allocation has at most {} MiB)", limit >> 20)));
        }
        let out = || out(what.into());
        use vk::BufferUsageFlags as Usage;
        let usage = Usage::STORAGE_BUFFER | Usage::INDIRECT_BUFFER | Usage::TRANSFER_SRC | Usage::TRANSFER_DST;
        let families = device.families();
        let mut info = vk::BufferCreateInfo::default().size(size).usage(usage);
        if let [_, _] = families {
            // Pictures are presented from these blocks on a queue of another family.
            info = info.sharing_mode(vk::SharingMode::CONCURRENT).queue_family_indices(families);
        }
        // SAFETY: the device is valid.
        let raw = unsafe { device.raw.create_buffer(&info, None) };
        let refused = |call| {
            move |e| match e {
                vk::Result::ERROR_OUT_OF_DEVICE_MEMORY | vk::Result::ERROR_OUT_OF_HOST_MEMORY => out(),
                e => device.error(call, what, e),
            }
        };
        let raw = raw.map_err(refused("vkCreateBuffer"))?;
        device.count(|counts| counts.blocks += 1);
        let mut block = Self { raw, size, allocation: None, shared: None, device: Arc::clone(device) };
        // SAFETY: the buffer was made just now.
        let requirements = unsafe { device.raw.get_buffer_memory_requirements(raw) };
        let scheme = if size >= DEDICATED {
            AllocationScheme::DedicatedBuffer(raw)
        } else {
            AllocationScheme::GpuAllocatorManaged
        };
        let wanted =
            AllocationCreateDesc { name: what, requirements, location, linear: true, allocation_scheme: scheme };
        let allocation = device.allocator().allocate(&wanted).map_err(|e| match e {
            AllocationError::OutOfMemory => out(),
            e => EngineError::Vulkan { device: device.report.name.clone(), call: "allocate", result: e.to_string() },
        })?;
        // SAFETY: the memory fits the buffer's requirements, and neither was bound before.
        let bound = unsafe { device.raw.bind_buffer_memory(raw, allocation.memory(), allocation.offset()) };
        block.allocation = Some(allocation);
        bound.map_err(refused("vkBindBufferMemory"))?;
        Ok(block)
    }

    /// Makes a block of a buffer and of memory that another process shares. Both were made for each other, and are
    /// freed with the block.
    #[cfg(target_os = "linux")]
    pub(super) fn shared(device: &Arc<Device>, raw: vk::Buffer, memory: vk::DeviceMemory, size: u64) -> Self {
        Self { raw, size, allocation: None, shared: Some(memory), device: Arc::clone(device) }
    }

    /// Returns the range of the whole block.
    pub(crate) fn all(&self) -> Range<'_> {
        self.range(0, self.size)
    }

    /// Returns a part of the block, in bytes.
    pub(crate) fn range(&self, offset: u64, size: u64) -> Range<'_> {
        debug_assert!(offset + size <= self.size);
        Range { block: self, offset, size }
    }

    /// Returns true if it is memory of this device.
    pub fn is_on(&self, device: &Arc<Device>) -> bool {
        Arc::ptr_eq(&self.device, device)
    }

    /// Returns true if the host reads and writes the block's memory directly and cached, as on software and
    /// integrated devices.
    pub(crate) fn is_the_hosts_too(&self) -> bool {
        use vk::MemoryPropertyFlags as Memory;
        let wanted = Memory::HOST_VISIBLE | Memory::HOST_COHERENT | Memory::HOST_CACHED;
        let allocation = self.allocation.as_ref();
        allocation.is_some_and(|a| a.memory_properties().contains(wanted) && a.mapped_slice().is_some())
    }

    /// Returns the bytes of a block that the host can read.
    pub(crate) fn bytes(&self) -> &[u8] {
        let mapped = self.allocation.as_ref().and_then(Allocation::mapped_slice);
        mapped.unwrap_or_default()
    }

    /// Returns the mutable bytes of a block that the host can write.
    pub fn bytes_mut(&mut self) -> &mut [u8] {
        let mapped = self.allocation.as_mut().and_then(Allocation::mapped_slice_mut);
        mapped.unwrap_or_default()
    }
}

impl Drop for Block {
    fn drop(&mut self) {
        if self.device.is_stuck() {
            return;
        }
        // SAFETY: recordings that use the block are waited for before anything that they use is dropped.
        unsafe { self.device.raw.destroy_buffer(self.raw, None) };
        if let Some(memory) = self.shared.take() {
            // SAFETY: as above. The memory was this block's alone in this process, and its buffer is gone.
            unsafe { self.device.raw.free_memory(memory, None) };
        }
        if let Some(allocation) = self.allocation.take() {
            // The allocator always takes back its own allocations.
            let _ = self.device.allocator().free(allocation);
        }
    }
}
