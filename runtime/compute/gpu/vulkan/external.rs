//! Shares memory of a device with another process (`VK_KHR_external_memory_fd`, opaque).
//!
//! One process exports it as a file descriptor, and the other imports it into its own device. Both must be the same
//! device with the same driver, as identified by their UUIDs.

use super::block::Block;
use super::commands::Commands;
use super::device::Device;
use super::devices::candidates;
use super::error::EngineError;
use super::instance::Instance;
use super::open::Gpu;
use super::report::Options;
use super::sharing::{DeviceIds, OPAQUE, USAGE, ids};
use ash::{khr, vk};
use std::os::fd::{FromRawFd, IntoRawFd, OwnedFd};
use std::sync::Arc;

/// The layout of shared memory, which its importer must repeat.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SharedLayout {
    /// Bytes of the memory.
    pub memory_bytes: u64,
    /// Bytes of the buffer at its beginning.
    pub buffer_bytes: u64,
    /// Index of the device's memory type.
    pub memory_type: u32,
    /// `VkBufferUsageFlags` of the buffer.
    pub usage: u32,
}

/// Memory of a device that is shared with another process.
pub struct SharedMemory {
    pub(crate) block: Block,
    layout: SharedLayout,
}

impl Gpu {
    /// Returns the identity of the device.
    pub fn ids(&self) -> DeviceIds {
        ids(&self.device.instance, self.device.physical)
    }

    /// Returns true if the device shares memory with other processes.
    pub fn shares_memory(&self) -> bool {
        self.device.has(khr::external_memory_fd::NAME)
    }

    /// Opens the device with these UUIDs, whichever one `options` name. It may be a software device.
    ///
    /// # Errors
    /// [`EngineError::NoDevice`] if no device has them, and the errors of [`open`](Self::open).
    pub fn open_same(wanted: DeviceIds, options: &Options) -> Result<Self, EngineError> {
        let instance = Arc::new(Instance::open(options.validation, options.present)?);
        let usable = candidates(&instance, options.present)?.into_iter().filter(|c| c.report.usable.is_ok());
        let same = usable.into_iter().find(|candidate| ids(&instance, candidate.raw) == wanted);
        let reason = || "no device has the UUIDs of the device and driver that share their memory".into();
        Self::on(&instance, same.ok_or_else(|| EngineError::NoDevice { reason: reason() })?, options)
    }
}

impl SharedMemory {
    /// Exports `bytes` bytes of memory, with a file descriptor. Each holder of the descriptor can read and write the
    /// memory.
    ///
    /// # Errors
    /// [`EngineError::Unsuitable`] if the device shares no memory, and lack of memory.
    pub fn export(gpu: &Gpu, bytes: u64) -> Result<(Self, OwnedFd), EngineError> {
        let device = &gpu.device;
        check(device, bytes)?;
        let (raw, needs) = buffer(device, bytes)?;
        // SAFETY: the device is of its instance.
        let all = unsafe { device.instance.raw.get_physical_device_memory_properties(device.physical) };
        let local = vk::MemoryPropertyFlags::DEVICE_LOCAL;
        let fits = |i: &u32| needs.memory_type_bits >> i & 1 == 1;
        let types = || (0..all.memory_type_count).filter(fits);
        let is_local = |i: &u32| all.memory_types[*i as usize].property_flags.contains(local);
        let memory_type = types().find(is_local).or_else(|| types().next()).unwrap_or(0);
        let mut exported = vk::ExportMemoryAllocateInfo::default().handle_types(OPAQUE);
        let info = vk::MemoryAllocateInfo::default()
            .allocation_size(needs.size)
            .memory_type_index(memory_type)
            .push_next(&mut exported);
        let layout = SharedLayout { memory_bytes: needs.size, buffer_bytes: bytes, memory_type, usage: USAGE.as_raw() };
        let memory = allocated(device, raw, &info)?;
        let block = bound(device, raw, memory, bytes)?;
        let get = khr::external_memory_fd::Device::new(&device.instance.raw, &device.raw);
        let info = vk::MemoryGetFdInfoKHR::default().memory(memory).handle_type(OPAQUE);
        // SAFETY: the extension is on, and the memory was made to be exported as this.
        let fd = unsafe { get.get_memory_fd(&info) }.map_err(|e| device.error("vkGetMemoryFdKHR", WHAT, e))?;
        // SAFETY: the descriptor was made just now, and has no other owner.
        let fd = unsafe { OwnedFd::from_raw_fd(fd) };
        Ok((Self { block, layout }, fd))
    }

    /// Imports memory that another process exported from the same device with this layout.
    ///
    /// # Errors
    /// [`EngineError::Unsuitable`] if the device shares no memory, [`EngineError::Mismatch`] if it does not have the
    /// layout, and the driver's errors about the descriptor.
    pub fn import(gpu: &Gpu, fd: OwnedFd, layout: &SharedLayout) -> Result<Self, EngineError> {
        let device = &gpu.device;
        check(device, layout.buffer_bytes)?;
        let (raw, needs) = buffer(device, layout.buffer_bytes)?;
        let SharedLayout { memory_bytes, memory_type, usage, .. } = *layout;
        let has_type = memory_type < 32 && needs.memory_type_bits >> memory_type & 1 == 1;
        if !has_type || memory_bytes < needs.size || usage != USAGE.as_raw() {
            // SAFETY: it was made just now, and nothing uses it.
            unsafe { device.raw.destroy_buffer(raw, None) };
            return Err(EngineError::mismatch(format!(
                "shared memory of {memory_bytes} bytes, type {memory_type}, does not fit this device"
            )));
        }
        let given = fd.into_raw_fd();
        let mut imported = vk::ImportMemoryFdInfoKHR::default().handle_type(OPAQUE).fd(given);
        let info = vk::MemoryAllocateInfo::default()
            .allocation_size(memory_bytes)
            .memory_type_index(memory_type)
            .push_next(&mut imported);
        let memory = allocated(device, raw, &info).inspect_err(|_| {
            // SAFETY: the driver owns the descriptor only after a call that succeeds, so it is still ours.
            drop(unsafe { OwnedFd::from_raw_fd(given) });
        })?;
        Ok(Self { block: bound(device, raw, memory, layout.buffer_bytes)?, layout: *layout })
    }

    /// Returns the layout for an importer.
    pub fn layout(&self) -> SharedLayout {
        self.layout
    }
}

/// The name of the memory in errors.
const WHAT: &str = "memory that is shared with another process";

fn check(device: &Device, bytes: u64) -> Result<(), EngineError> {
    let limit = device.report.limits.allocation;
    let reason = match device.has(khr::external_memory_fd::NAME) {
        false => "it shares no memory with other processes (VK_KHR_external_memory_fd)".into(),
        true if bytes > limit || bytes == 0 => {
            format!("{bytes} bytes of shared memory, but it allocates at most {limit} at once")
        }
        true => return Ok(()),
    };
    Err(EngineError::Unsuitable { device: device.report.name.clone(), reason })
}

fn buffer(device: &Device, bytes: u64) -> Result<(vk::Buffer, vk::MemoryRequirements), EngineError> {
    let mut external = vk::ExternalMemoryBufferCreateInfo::default().handle_types(OPAQUE);
    let info = vk::BufferCreateInfo::default().size(bytes).usage(USAGE).push_next(&mut external);
    // SAFETY: the device is valid, and the receiver of the buffer destroys it.
    let raw = unsafe { device.raw.create_buffer(&info, None) }.map_err(|e| device.error("vkCreateBuffer", WHAT, e))?;
    // SAFETY: the buffer was made just now.
    Ok((raw, unsafe { device.raw.get_buffer_memory_requirements(raw) }))
}

/// Allocates memory for a buffer, and destroys the buffer if that fails.
fn allocated(
    device: &Device,
    raw: vk::Buffer,
    info: &vk::MemoryAllocateInfo<'_>,
) -> Result<vk::DeviceMemory, EngineError> {
    // SAFETY: `info` is valid for the call.
    unsafe { device.raw.allocate_memory(info, None) }.map_err(|error| {
        // SAFETY: nothing uses it.
        unsafe { device.raw.destroy_buffer(raw, None) };
        device.error("vkAllocateMemory", WHAT, error)
    })
}

fn bound(device: &Arc<Device>, raw: vk::Buffer, memory: vk::DeviceMemory, bytes: u64) -> Result<Block, EngineError> {
    let block = Block::shared(device, raw, memory, bytes);
    // SAFETY: the memory fits the buffer's requirements, and neither was bound before.
    unsafe { device.raw.bind_buffer_memory(raw, memory, 0) }
        .map_err(|e| device.error("vkBindBufferMemory", WHAT, e))?;
    Ok(block)
}

/// The application's side of shared memory. It keeps frames on the device and copies them into slots of that memory.
pub struct SlotWriter {
    memory: SharedMemory,
    /// Bytes from one slot to the next.
    stride: u64,
    /// Kept frames, with their bytes.
    frames: Vec<(Block, u64)>,
    gpu: Commands,
}

impl SlotWriter {
    /// Makes a writer for memory that another process exported, in slots `stride` bytes apart.
    ///
    /// # Errors
    /// The errors of [`SharedMemory::import`].
    pub fn new(gpu: &Gpu, fd: OwnedFd, layout: &SharedLayout, stride: u64) -> Result<Self, EngineError> {
        let memory = SharedMemory::import(gpu, fd, layout)?;
        Ok(Self { memory, stride, frames: Vec::new(), gpu: Commands::new(gpu)? })
    }

    /// Keeps a frame on the device and returns its number for [`write`](Self::write). It replaces the frame `number`,
    /// if any.
    ///
    /// # Errors
    /// [`EngineError`] if memory runs out or the device is lost.
    pub fn keep(&mut self, number: Option<usize>, samples: &[u8]) -> Result<usize, EngineError> {
        let mut words = samples.to_vec();
        words.resize(samples.len().next_multiple_of(4), 0);
        let bytes = words.len() as u64;
        match number.and_then(|i| self.frames.get_mut(i).map(|frame| (i, frame))) {
            Some((i, (block, kept))) if bytes <= block.size => {
                *kept = bytes;
                self.gpu.put(block, &words, [(0, 0, bytes)])?;
                Ok(i)
            }
            _ => {
                self.frames.push((self.gpu.filled(&words, "a frame")?, bytes));
                Ok(self.frames.len() - 1)
            }
        }
    }

    /// Copies a frame into a slot. The copy is complete on return.
    ///
    /// # Errors
    /// [`EngineError::Mismatch`] if the slot or the frame does not exist, and a lost device.
    pub fn write(&mut self, slot: usize, frame: usize) -> Result<(), EngineError> {
        let at = self.stride.saturating_mul(slot as u64);
        let room = self.memory.block.size.saturating_sub(at).min(self.stride);
        let Some((block, bytes)) = self.frames.get(frame).filter(|(_, bytes)| *bytes <= room) else {
            return Err(EngineError::mismatch(format!("frame {frame} does not fit slot {slot}")));
        };
        self.gpu.recorder.begin(0)?;
        self.gpu.recorder.take_over(&self.memory.block);
        self.gpu.recorder.copy(block, &self.memory.block, [(0, at, *bytes)]);
        self.gpu.recorder.hand_back(&self.memory.block);
        self.gpu.recorder.submit("a frame for the display")
    }
}
