//! Memory that receives copies, and finished copies.

use super::device::Device;
use super::own::{Bytes, Fault, Layout, Memory, Own};
use super::part::Part;
use super::sharing::{OPAQUE, USAGE};
use ash::vk;
use std::os::fd::{FromRawFd, OwnedFd};
use std::sync::{Arc, OnceLock};
use std::time::Duration;

/// The memory of copies.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Room {
    /// Memory of the host.
    Host,
    /// Memory of the device, which the layer's own device imports.
    Device,
}

/// Memory of the host or of the device with the commands that fill it.
pub struct Buffer {
    pub(super) device: Arc<Device>,
    pub(super) room: Room,
    pub(super) raw: vk::Buffer,
    memory: vk::DeviceMemory,
    /// The layout of the memory for an importer.
    layout: Layout,
    /// The same memory on the layer's own device, after its first use there.
    imported: OnceLock<Memory>,
    /// The memory, or null if it is on the device.
    mapped: *const u8,
    /// Bytes of the buffer.
    pub(super) bytes: u64,
    is_coherent: bool,
    pool: vk::CommandPool,
    pub(super) commands: vk::CommandBuffer,
    /// Signaled while no copy is in progress.
    pub(super) fence: vk::Fence,
}

// SAFETY: the handles are not bound to a thread. One thread records and submits (`Copier` is exclusive), and the mapped
// memory is only read while no copy is in progress.
unsafe impl Send for Buffer {}
// SAFETY: as above.
unsafe impl Sync for Buffer {}

impl Buffer {
    /// Allocates a buffer of this many bytes. Memory of the device is for devices that export it.
    pub(super) fn new(device: &Arc<Device>, bytes: u64, room: Room) -> Result<Self, vk::Result> {
        let raw = &device.raw;
        let mut external = vk::ExternalMemoryBufferCreateInfo::default().handle_types(OPAQUE);
        let mut info = vk::BufferCreateInfo::default().size(bytes).usage(vk::BufferUsageFlags::TRANSFER_DST);
        if room == Room::Device {
            info = info.usage(USAGE).push_next(&mut external);
        }
        // SAFETY: the device is valid, and `Drop` destroys the buffer.
        let buffer = unsafe { raw.create_buffer(&info, None) }?;
        let mut made = Self {
            device: device.clone(),
            room,
            raw: buffer,
            memory: vk::DeviceMemory::null(),
            layout: Layout { memory_bytes: 0, buffer_bytes: bytes, memory_type: 0, usage: USAGE.as_raw() },
            imported: OnceLock::new(),
            mapped: std::ptr::null(),
            bytes,
            is_coherent: true,
            pool: vk::CommandPool::null(),
            commands: vk::CommandBuffer::null(),
            fence: vk::Fence::null(),
        };
        made.allocate()?;
        let flags = vk::CommandPoolCreateFlags::TRANSIENT;
        let info = vk::CommandPoolCreateInfo::default().queue_family_index(device.family).flags(flags);
        // SAFETY: the family is the one of the application's queue.
        made.pool = unsafe { raw.create_command_pool(&info, None) }?;
        let info = vk::CommandBufferAllocateInfo::default().command_pool(made.pool).command_buffer_count(1);
        // SAFETY: the pool was made just now, and frees its commands.
        made.commands = unsafe { raw.allocate_command_buffers(&info) }?[0];
        let info = vk::FenceCreateInfo::default().flags(vk::FenceCreateFlags::SIGNALED);
        // SAFETY: the device is valid, and `Drop` destroys the fence.
        made.fence = unsafe { raw.create_fence(&info, None) }?;
        Ok(made)
    }

    /// Allocates the memory of the buffer, and maps memory of the host.
    fn allocate(&mut self) -> Result<(), vk::Result> {
        let Device { raw, memory: all, atom, .. } = &*self.device;
        // SAFETY: the buffer was made just now.
        let needs = unsafe { raw.get_buffer_memory_requirements(self.raw) };
        let (index, flags) = memory_type(all, needs.memory_type_bits, self.room).ok_or(vk::Result::ERROR_UNKNOWN)?;
        self.is_coherent = flags.contains(vk::MemoryPropertyFlags::HOST_COHERENT);
        let (mut exported, size) = match self.room {
            // The range that the host reads ends at a multiple of the atom.
            Room::Host => (None, needs.size.next_multiple_of(*atom)),
            Room::Device => (Some(vk::ExportMemoryAllocateInfo::default().handle_types(OPAQUE)), needs.size),
        };
        (self.layout.memory_bytes, self.layout.memory_type) = (size, index);
        let mut info = vk::MemoryAllocateInfo::default().allocation_size(size).memory_type_index(index);
        if let Some(exported) = &mut exported {
            info = info.push_next(exported);
        }
        // SAFETY: the type is one of the device, and `Drop` frees the memory.
        self.memory = unsafe { raw.allocate_memory(&info, None) }?;
        // SAFETY: the memory fits the buffer's requirements, and neither was bound before.
        unsafe { raw.bind_buffer_memory(self.raw, self.memory, 0) }?;
        if self.room == Room::Host {
            // SAFETY: the memory is visible to the host, and is mapped once.
            let mapped = unsafe { raw.map_memory(self.memory, 0, vk::WHOLE_SIZE, vk::MemoryMapFlags::empty()) }?;
            self.mapped = mapped.cast();
        }
        Ok(())
    }

    /// Returns the memory on the layer's own device, which is imported at its first use.
    fn on(&self, own: &Arc<Own>) -> Result<&Memory, Fault> {
        if self.imported.get().is_none() {
            let (_, exports) = self.device.exports.as_ref().ok_or(Fault::Sharing)?;
            let info = vk::MemoryGetFdInfoKHR::default().memory(self.memory).handle_type(OPAQUE);
            // SAFETY: the extension is enabled, and the memory was made to be exported as this.
            let fd = unsafe { exports.get_memory_fd(&info) };
            let fd = fd.map_err(|result| Fault::Vulkan { call: "vkGetMemoryFdKHR", result })?;
            // SAFETY: the descriptor was made just now, and has no other owner.
            let memory = Memory::import(own, unsafe { OwnedFd::from_raw_fd(fd) }, &self.layout)?;
            let _ = self.imported.set(memory);
        }
        self.imported.get().ok_or(Fault::Sharing)
    }

    /// Returns true if no copy is in progress.
    pub(super) fn is_done(&self) -> bool {
        // SAFETY: the fence is valid.
        let signaled = unsafe { self.device.raw.get_fence_status(self.fence) };
        signaled == Ok(true)
    }

    /// Empties the commands, so that they can be recorded again.
    pub(super) fn reset(&self) -> Result<(), vk::Result> {
        // SAFETY: the commands are not in use, because no copy is in progress.
        unsafe { self.device.raw.reset_command_pool(self.pool, vk::CommandPoolResetFlags::empty()) }
    }

    /// Waits until the copy in progress is done. Returns false if it is not done in time or the device is lost.
    pub(super) fn wait(&self, patience: Duration) -> bool {
        let ns = u64::try_from(patience.as_nanos()).unwrap_or(u64::MAX);
        // SAFETY: the fence is valid.
        unsafe { self.device.raw.wait_for_fences(&[self.fence], true, ns) }.is_ok()
    }
}

impl Drop for Buffer {
    fn drop(&mut self) {
        let raw = &self.device.raw;
        // A lost device has no copy in progress.
        if self.fence != vk::Fence::null() {
            self.wait(Duration::from_secs(10));
        }
        // SAFETY: nothing uses the handles, because no copy is in progress. Each may be null.
        unsafe {
            raw.destroy_fence(self.fence, None);
            raw.destroy_command_pool(self.pool, None);
            raw.destroy_buffer(self.raw, None);
            raw.free_memory(self.memory, None);
        }
    }
}

/// Selects memory that the host reads fast, which is cached, or memory of the device.
fn memory_type(
    all: &vk::PhysicalDeviceMemoryProperties,
    fits: u32,
    room: Room,
) -> Option<(u32, vk::MemoryPropertyFlags)> {
    use vk::MemoryPropertyFlags as Flags;
    let (must, better) = match room {
        Room::Host => (Flags::HOST_VISIBLE, Flags::HOST_CACHED),
        Room::Device => (Flags::empty(), Flags::DEVICE_LOCAL),
    };
    let types = || {
        (0..all.memory_type_count)
            .filter(|i| fits >> i & 1 == 1)
            .map(|i| (i, all.memory_types[i as usize].property_flags))
            .filter(|(_, flags)| flags.contains(must))
    };
    types().find(|(_, flags)| flags.contains(better)).or_else(|| types().next())
}

/// A copy of parts of an image. It stays as it is, because its memory is used again only after it is dropped.
pub struct Captured {
    pub(super) buffer: Arc<Buffer>,
    /// The parts of the image, with their offsets in the buffer.
    pub(super) parts: Vec<(Part, u64)>,
}

impl Captured {
    /// Waits until the copy is done. Returns false if it is not done in time or the device is lost.
    pub fn wait(&self, patience: Duration) -> bool {
        if !self.buffer.wait(patience) {
            return false;
        }
        if self.buffer.is_coherent || self.buffer.room == Room::Device {
            return true;
        }
        let whole = vk::MappedMemoryRange::default().memory(self.buffer.memory).size(vk::WHOLE_SIZE);
        // SAFETY: the memory is mapped.
        unsafe { self.buffer.device.raw.invalidate_mapped_memory_ranges(&[whole]) }.is_ok()
    }

    /// Returns true if the copy contains this part.
    pub fn has(&self, wanted: &Part) -> bool {
        self.parts.iter().any(|(part, _)| part.contains(wanted))
    }

    /// Returns the first byte of a part in the buffer, and the bytes from one row to the next.
    fn place(&self, wanted: &Part, texel: usize) -> Option<(usize, usize)> {
        let (part, offset) = self.parts.iter().find(|(part, _)| part.contains(wanted))?;
        let stride = part.width as usize * texel;
        let (down, right) = ((wanted.y - part.y) as usize, (wanted.x - part.x) as usize);
        Some((*offset as usize + down * stride + right * texel, stride))
    }

    /// Returns the bytes from the first texel of a part, and the bytes from one row to the next. Returns none if the
    /// copy is on the device. Call it after [`wait`](Self::wait).
    pub fn bytes(&self, wanted: &Part, texel: usize) -> Option<(&[u8], usize)> {
        let (begin, stride) = self.place(wanted, texel)?;
        if self.buffer.mapped.is_null() {
            return None;
        }
        // SAFETY: the mapping has the bytes of the buffer, and lives as long as the buffer. The device does not write
        // there, because this copy is done and the next one waits for `self` to be dropped.
        let all = unsafe { std::slice::from_raw_parts(self.buffer.mapped, self.buffer.bytes as usize) };
        Some((all.get(begin..)?, stride))
    }

    /// Returns the texels of a part for the layer's own device, and the bytes from one row to the next. Returns none if
    /// the copy does not contain the part. Call it after [`wait`](Self::wait).
    ///
    /// # Errors
    /// Returns [`Fault`] if the memory cannot be imported.
    pub fn texels(&self, own: &Arc<Own>, wanted: &Part, texel: usize) -> Result<Option<(Bytes<'_>, usize)>, Fault> {
        if let Some((bytes, stride)) = self.bytes(wanted, texel) {
            return Ok(Some((Bytes::Host(bytes), stride)));
        }
        let Some((begin, stride)) = self.place(wanted, texel) else { return Ok(None) };
        Ok(Some((Bytes::Device(self.buffer.on(own)?, begin as u64), stride)))
    }
}
