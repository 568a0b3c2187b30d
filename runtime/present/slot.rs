//! Holds a picture in flight to the display, with the objects of its copy.

#![allow(unsafe_code)]

use ash::vk;
use eyebox_compute::gpu::{Block, Device, EngineError, Pictures, Ready};
use gpu_allocator::MemoryLocation;
use std::sync::Arc;

/// A picture in flight.
pub(super) struct Slot {
    /// Four bytes for each pixel of the swapchain, from the host.
    pub(super) pixels: Option<Block>,
    /// A picture that was already on the device, as an alternative. It is held until it was read.
    on_device: Option<OnDevice>,
    pub(super) commands: vk::CommandBuffer,
    pub(super) acquired: vk::Semaphore,
    /// Signaled when the device no longer reads the picture.
    pub(super) done: vk::Fence,
}

struct OnDevice {
    block: Arc<Block>,
    offset: u64,
    ready: Option<Ready>,
}

/// The source of a copy, as buffer, first byte, and the semaphore to wait for.
pub(super) type Source<'a> = (vk::Buffer, u64, Option<&'a Ready>);

impl Slot {
    /// Appends `count` slots, each of which is stored as soon as it exists.
    pub(super) fn make(
        slots: &mut Vec<Self>,
        count: usize,
        device: &Device,
        pool: vk::CommandPool,
    ) -> Result<(), EngineError> {
        let raw = &device.raw;
        let error = |call| move |e| device.error(call, "making a swapchain", e);
        for _ in 0..count {
            let info = vk::CommandBufferAllocateInfo::default().command_pool(pool).command_buffer_count(1);
            // SAFETY: the device is valid, and the pool is its own.
            let commands = unsafe { raw.allocate_command_buffers(&info) }.map_err(error("vkAllocateCommandBuffers"))?;
            let (acquired, done) = (vk::Semaphore::null(), vk::Fence::null());
            slots.push(Self { pixels: None, on_device: None, commands: commands[0], acquired, done });
            let Some(slot) = slots.last_mut() else { continue };
            let signalled = vk::FenceCreateInfo::default().flags(vk::FenceCreateFlags::SIGNALED);
            // SAFETY: the device is valid, and what is made is kept at once and destroyed in `destroy`.
            unsafe {
                let acquired = raw.create_semaphore(&vk::SemaphoreCreateInfo::default(), None);
                slot.acquired = acquired.map_err(error("vkCreateSemaphore"))?;
                slot.done = raw.create_fence(&signalled, None).map_err(error("vkCreateFence"))?;
            }
        }
        Ok(())
    }

    /// Reserves room for this number of bytes from the host. The device reads nothing of the slot.
    pub(super) fn reserve(&mut self, device: &Arc<Device>, bytes: u64) -> Result<(), EngineError> {
        if !self.has_room(bytes) {
            self.pixels = None;
            self.pixels = Some(Block::new(device, bytes, MemoryLocation::CpuToGpu, "a picture")?);
        }
        Ok(())
    }

    /// True if there is room for this number of bytes from the host.
    pub(super) fn has_room(&self, bytes: u64) -> bool {
        self.pixels.as_ref().is_some_and(|p| p.size >= bytes)
    }

    /// Replaces the semaphore and the fence after a failed submission, and returns false if that fails. The device uses
    /// nothing of the slot.
    pub(super) fn renew(&mut self, device: &Device) -> bool {
        let signalled = vk::FenceCreateInfo::default().flags(vk::FenceCreateFlags::SIGNALED);
        // SAFETY: the device is valid and idle, and each handle is destroyed once, and replaced at once.
        unsafe {
            let Ok(acquired) = device.raw.create_semaphore(&vk::SemaphoreCreateInfo::default(), None) else {
                return false;
            };
            device.raw.destroy_semaphore(std::mem::replace(&mut self.acquired, acquired), None);
            let Ok(done) = device.raw.create_fence(&signalled, None) else { return false };
            device.raw.destroy_fence(std::mem::replace(&mut self.done, done), None);
        }
        true
    }

    /// Holds a picture that is on the device.
    pub(super) fn hold(&mut self, pictures: &Pictures, index: usize) {
        let (block, ready) = (Arc::clone(&pictures.block), pictures.ready.clone());
        self.on_device = Some(OnDevice { block, offset: index as u64 * pictures.step, ready });
    }

    /// Releases a picture on the device that was read.
    pub(super) fn release(&mut self, device: &Device) {
        // SAFETY: the fence is the device's.
        if self.on_device.is_some() && unsafe { device.raw.get_fence_status(self.done) } == Ok(true) {
            self.on_device = None;
        }
    }

    pub(super) fn source(&self) -> Option<Source<'_>> {
        match (&self.on_device, &self.pixels) {
            (Some(picture), _) => Some((picture.block.raw, picture.offset, picture.ready.as_ref())),
            (None, pixels) => pixels.as_ref().map(|pixels| (pixels.raw, 0, None)),
        }
    }

    /// # Safety
    /// The device no longer reads anything of the slot.
    pub(super) unsafe fn destroy(&self, device: &ash::Device) {
        // SAFETY: the caller guarantees this, and null handles are ignored.
        unsafe {
            device.destroy_semaphore(self.acquired, None);
            device.destroy_fence(self.done, None);
        }
    }
}
