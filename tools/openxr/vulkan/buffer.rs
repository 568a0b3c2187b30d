//! Memory of the host that receives copies, and finished copies.

use super::device::Device;
use super::part::Part;
use ash::vk;
use std::sync::Arc;
use std::time::Duration;

/// Memory of the host with the commands that fill it.
pub struct Buffer {
    pub(super) device: Arc<Device>,
    pub(super) raw: vk::Buffer,
    memory: vk::DeviceMemory,
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
    /// Allocates a buffer of this many bytes.
    pub(super) fn new(device: &Arc<Device>, bytes: u64) -> Result<Self, vk::Result> {
        let raw = &device.raw;
        let info = vk::BufferCreateInfo::default().size(bytes).usage(vk::BufferUsageFlags::TRANSFER_DST);
        // SAFETY: the device is valid, and `Drop` destroys the buffer.
        let buffer = unsafe { raw.create_buffer(&info, None) }?;
        let mut made = Self {
            device: device.clone(),
            raw: buffer,
            memory: vk::DeviceMemory::null(),
            mapped: std::ptr::null(),
            bytes,
            is_coherent: true,
            pool: vk::CommandPool::null(),
            commands: vk::CommandBuffer::null(),
            fence: vk::Fence::null(),
        };
        // SAFETY: the buffer was made just now.
        let needs = unsafe { raw.get_buffer_memory_requirements(buffer) };
        let (index, flags) = memory_type(&device.memory, needs.memory_type_bits).ok_or(vk::Result::ERROR_UNKNOWN)?;
        made.is_coherent = flags.contains(vk::MemoryPropertyFlags::HOST_COHERENT);
        // The range that the host reads ends at a multiple of the atom.
        let size = needs.size.next_multiple_of(device.atom);
        let info = vk::MemoryAllocateInfo::default().allocation_size(size).memory_type_index(index);
        // SAFETY: the type is one of the device, and `Drop` frees the memory.
        made.memory = unsafe { raw.allocate_memory(&info, None) }?;
        // SAFETY: the memory fits the buffer's requirements, and neither was bound before.
        unsafe { raw.bind_buffer_memory(buffer, made.memory, 0) }?;
        // SAFETY: the memory is visible to the host, and is mapped once.
        let mapped = unsafe { raw.map_memory(made.memory, 0, vk::WHOLE_SIZE, vk::MemoryMapFlags::empty()) }?;
        made.mapped = mapped.cast();
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

/// Selects memory that the host reads fast, which is cached.
fn memory_type(all: &vk::PhysicalDeviceMemoryProperties, fits: u32) -> Option<(u32, vk::MemoryPropertyFlags)> {
    let visible = vk::MemoryPropertyFlags::HOST_VISIBLE;
    let types = || {
        (0..all.memory_type_count)
            .filter(|i| fits >> i & 1 == 1)
            .map(|i| (i, all.memory_types[i as usize].property_flags))
            .filter(|(_, flags)| flags.contains(visible))
    };
    types().find(|(_, flags)| flags.contains(vk::MemoryPropertyFlags::HOST_CACHED)).or_else(|| types().next())
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
        if self.buffer.is_coherent {
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

    /// Returns the bytes from the first texel of a part, and the bytes from one row to the next. Call it after
    /// [`wait`](Self::wait).
    pub fn bytes(&self, wanted: &Part, texel: usize) -> Option<(&[u8], usize)> {
        let (part, offset) = self.parts.iter().find(|(part, _)| part.contains(wanted))?;
        let stride = part.width as usize * texel;
        let (down, right) = ((wanted.y - part.y) as usize, (wanted.x - part.x) as usize);
        let begin = *offset as usize + down * stride + right * texel;
        // SAFETY: the mapping has the bytes of the buffer, and lives as long as the buffer. The device does not write
        // there, because this copy is done and the next one waits for `self` to be dropped.
        let all = unsafe { std::slice::from_raw_parts(self.buffer.mapped, self.buffer.bytes as usize) };
        Some((all.get(begin..)?, stride))
    }
}
