//! Buffers of the layer's own device.

use super::device::Own;
use super::fault::{Fault, of};
use crate::vulkan::sharing::{OPAQUE, USAGE};
use ash::vk;
use std::os::fd::{FromRawFd, IntoRawFd, OwnedFd};
use std::sync::Arc;

/// The layout of shared memory, which its importer repeats.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Layout {
    /// Bytes of the memory.
    pub memory_bytes: u64,
    /// Bytes of the buffer at its beginning.
    pub buffer_bytes: u64,
    /// The index of the memory's type.
    pub memory_type: u32,
    /// The `VkBufferUsageFlags` of the buffer.
    pub usage: u32,
}

/// The side that uses a buffer besides the device.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Use {
    /// Only the device uses it.
    Device,
    /// The host writes it.
    Upload,
    /// The host reads it.
    Readback,
}

/// A buffer with its memory.
pub struct Memory {
    own: Arc<Own>,
    pub(super) raw: vk::Buffer,
    memory: vk::DeviceMemory,
    mapped: *mut u8,
    /// Bytes of the buffer.
    pub(super) bytes: u64,
}

// SAFETY: the handles are not bound to a thread, and the mapped memory is accessed through exclusive references, or
// read.
unsafe impl Send for Memory {}
// SAFETY: as above.
unsafe impl Sync for Memory {}

impl Memory {
    /// Allocates a buffer of this many bytes, filled with anything.
    pub(super) fn new(own: &Arc<Own>, bytes: u64, wanted: Use) -> Result<Self, Fault> {
        let usage = vk::BufferUsageFlags::STORAGE_BUFFER | vk::BufferUsageFlags::TRANSFER_DST;
        let info = vk::BufferCreateInfo::default().size(bytes).usage(usage);
        let mut made = Self::empty(own, &info)?;
        // SAFETY: the buffer was made just now.
        let needs = unsafe { own.raw.get_buffer_memory_requirements(made.raw) };
        let mut result = vk::Result::ERROR_OUT_OF_DEVICE_MEMORY;
        // Memory that both sides reach fast may be scarce, so that the next kind is tried.
        for index in types(&own.memory, needs.memory_type_bits, wanted) {
            let info = vk::MemoryAllocateInfo::default().allocation_size(needs.size).memory_type_index(index);
            // SAFETY: the type is one of the device, and `Drop` frees the memory.
            match unsafe { own.raw.allocate_memory(&info, None) } {
                Ok(memory) => {
                    made.memory = memory;
                    break;
                }
                Err(error) => result = error,
            }
        }
        if made.memory == vk::DeviceMemory::null() {
            return Err(of("vkAllocateMemory")(result));
        }
        made.bind()?;
        if wanted != Use::Device {
            let whole = vk::WHOLE_SIZE;
            // SAFETY: the memory is visible to the host, and is mapped once.
            let mapped = unsafe { own.raw.map_memory(made.memory, 0, whole, vk::MemoryMapFlags::empty()) };
            made.mapped = mapped.map_err(of("vkMapMemory"))?.cast();
        }
        Ok(made)
    }

    /// Imports memory of the same device.
    ///
    /// # Errors
    /// Returns [`Fault::Memory`] if the layout does not fit the device, and the driver's errors.
    pub fn import(own: &Arc<Own>, fd: OwnedFd, layout: &Layout) -> Result<Self, Fault> {
        let Layout { memory_bytes, buffer_bytes, memory_type, usage } = *layout;
        let mut external = vk::ExternalMemoryBufferCreateInfo::default().handle_types(OPAQUE);
        let info = vk::BufferCreateInfo::default().size(buffer_bytes.max(1)).usage(USAGE).push_next(&mut external);
        let mut made = Self::empty(own, &info)?;
        // SAFETY: the buffer was made just now.
        let needs = unsafe { own.raw.get_buffer_memory_requirements(made.raw) };
        let has_type = memory_type < own.memory.memory_type_count && needs.memory_type_bits >> memory_type & 1 == 1;
        if !has_type || memory_bytes < needs.size || buffer_bytes == 0 || usage != USAGE.as_raw() {
            return Err(Fault::Memory { bytes: memory_bytes, kind: memory_type });
        }
        let given = fd.into_raw_fd();
        let mut imported = vk::ImportMemoryFdInfoKHR::default().handle_type(OPAQUE).fd(given);
        let info = vk::MemoryAllocateInfo::default()
            .allocation_size(memory_bytes)
            .memory_type_index(memory_type)
            .push_next(&mut imported);
        // SAFETY: the descriptor is of memory of this device and driver, whose layout is repeated.
        made.memory = unsafe { own.raw.allocate_memory(&info, None) }.map_err(|error| {
            // SAFETY: the driver owns the descriptor only after a call that succeeds, so it is still ours.
            drop(unsafe { OwnedFd::from_raw_fd(given) });
            of("vkAllocateMemory")(error)
        })?;
        made.bind()?;
        Ok(made)
    }

    fn empty(own: &Arc<Own>, info: &vk::BufferCreateInfo<'_>) -> Result<Self, Fault> {
        // SAFETY: the device is valid, and `Drop` destroys the buffer.
        let raw = unsafe { own.raw.create_buffer(info, None) }.map_err(of("vkCreateBuffer"))?;
        let memory = vk::DeviceMemory::null();
        Ok(Self { own: own.clone(), raw, memory, mapped: std::ptr::null_mut(), bytes: info.size })
    }

    fn bind(&self) -> Result<(), Fault> {
        // SAFETY: the memory fits the buffer's requirements, and neither was bound before.
        unsafe { self.own.raw.bind_buffer_memory(self.raw, self.memory, 0) }.map_err(of("vkBindBufferMemory"))
    }

    /// Writes words from the beginning. The buffer has room for them, and no work uses it.
    pub(super) fn write(&mut self, words: &[u32]) {
        let bytes: &[u8] = bytemuck::cast_slice(words);
        if !self.mapped.is_null() && bytes.len() as u64 <= self.bytes {
            // SAFETY: the mapping has the bytes of the buffer, and nothing else accesses it.
            unsafe { std::ptr::copy_nonoverlapping(bytes.as_ptr(), self.mapped, bytes.len()) };
        }
    }

    /// Returns the words of the buffer. It was made to be read, and no work uses it.
    pub(super) fn words(&self) -> &[u32] {
        if self.mapped.is_null() {
            return &[];
        }
        // SAFETY: the mapping has the bytes of the buffer, begins at a multiple of 64, and lives as long as `self`. The
        // device does not write meanwhile, because a composer needs an exclusive reference for that.
        unsafe { std::slice::from_raw_parts(self.mapped.cast(), self.bytes as usize / 4) }
    }
}

impl Drop for Memory {
    fn drop(&mut self) {
        // SAFETY: no work uses the handles, because each composer waits for its work. Each may be null.
        unsafe {
            self.own.raw.destroy_buffer(self.raw, None);
            self.own.raw.free_memory(self.memory, None);
        }
    }
}

/// Lists the types of memory for a use, with the best first.
fn types(all: &vk::PhysicalDeviceMemoryProperties, fits: u32, wanted: Use) -> Vec<u32> {
    use vk::MemoryPropertyFlags as Flags;
    let host = Flags::HOST_VISIBLE | Flags::HOST_COHERENT;
    let (must, better) = match wanted {
        Use::Device => (Flags::empty(), Flags::DEVICE_LOCAL),
        Use::Upload => (host, Flags::DEVICE_LOCAL),
        Use::Readback => (host, Flags::HOST_CACHED),
    };
    let flags = |i: &u32| all.memory_types[*i as usize].property_flags;
    let mut found: Vec<u32> =
        (0..all.memory_type_count).filter(|i| fits >> i & 1 == 1 && flags(i).contains(must)).collect();
    found.sort_by_key(|i| !flags(i).contains(better));
    found
}
