//! The logical device: one queue, an allocator, and answers of Vulkan's turned into errors.

use super::super::EngineError;
use super::devices::{Candidate, DeviceReport, candidates, choose};
use super::instance::{Instance, Messages};
use ash::{khr, vk};
use gpu_allocator::vulkan::{Allocation, AllocationCreateDesc, AllocationScheme, Allocator, AllocatorCreateDesc};
use gpu_allocator::{AllocationError, AllocationSizes, MemoryLocation};
use std::sync::{Arc, Mutex, PoisonError};

/// Shared by everything that lives on the device, so that it goes last.
pub(super) struct Device {
    pub(super) raw: ash::Device,
    pub(super) queue: vk::Queue,
    pub(super) family: u32,
    pub(super) synchronization2: Option<khr::synchronization2::Device>,
    pub(super) report: DeviceReport,
    pub(super) properties: vk::PhysicalDeviceProperties,
    allocator: Mutex<Option<Allocator>>,
    instance: Instance,
}

impl Device {
    /// Opens the device that `wanted` names, or the best one.
    pub(super) fn open(wanted: Option<&str>, allow_cpu: bool, validation: bool) -> Result<Arc<Self>, EngineError> {
        let instance = Instance::new(validation)?;
        let chosen = choose(candidates(&instance)?, wanted, allow_cpu)?;
        let Candidate { raw: physical, report, family, synchronization2, portability_subset } = chosen;
        let refused =
            |call, e: vk::Result| EngineError::Vulkan { device: report.name.clone(), call, result: format!("{e:?}") };
        let priorities = [1.0];
        let queues = [vk::DeviceQueueCreateInfo::default().queue_family_index(family).queue_priorities(&priorities)];
        let mut extensions = Vec::new();
        if synchronization2 {
            extensions.push(khr::synchronization2::NAME.as_ptr());
        }
        if portability_subset {
            extensions.push(khr::portability_subset::NAME.as_ptr());
        }
        let mut timeline = vk::PhysicalDeviceTimelineSemaphoreFeatures::default().timeline_semaphore(true);
        let mut synchronization = vk::PhysicalDeviceSynchronization2Features::default().synchronization2(true);
        let mut info = vk::DeviceCreateInfo::default()
            .queue_create_infos(&queues)
            .enabled_extension_names(&extensions)
            .push_next(&mut timeline);
        if synchronization2 {
            info = info.push_next(&mut synchronization);
        }
        // SAFETY: the device is of this instance, and has the queue family, extensions and features asked for.
        let (raw, properties) = unsafe {
            let raw = instance.raw.create_device(physical, &info, None).map_err(|e| refused("vkCreateDevice", e))?;
            (raw, instance.raw.get_physical_device_properties(physical))
        };
        let allocator = Allocator::new(&AllocatorCreateDesc {
            instance: instance.raw.clone(),
            device: raw.clone(),
            physical_device: physical,
            debug_settings: Default::default(),
            buffer_device_address: false,
            // Large buffers have memory of their own; these blocks hold the small ones.
            allocation_sizes: AllocationSizes::new(16 << 20, 8 << 20),
        });
        let allocator = match allocator {
            Ok(allocator) => allocator,
            Err(e) => {
                // SAFETY: nothing was made from the device yet.
                unsafe { raw.destroy_device(None) };
                return Err(EngineError::Vulkan { device: report.name, call: "allocator", result: e.to_string() });
            }
        };
        // SAFETY: the family was asked for with one queue.
        let queue = unsafe { raw.get_device_queue(family, 0) };
        let synchronization2 = synchronization2.then(|| khr::synchronization2::Device::new(&instance.raw, &raw));
        let allocator = Mutex::new(Some(allocator));
        Ok(Arc::new(Self { raw, queue, family, synchronization2, report, properties, allocator, instance }))
    }

    /// Number of allocations alive.
    #[cfg(test)]
    pub(super) fn allocations(&self) -> usize {
        let allocator = self.allocator.lock().unwrap_or_else(PoisonError::into_inner);
        allocator.as_ref().map_or(0, |a| a.generate_report().allocations.len())
    }

    /// What the validation layer said so far.
    pub(super) fn messages(&self) -> Messages {
        Arc::clone(&self.instance.messages)
    }

    /// An answer of Vulkan's as an error: `call` names the call, `during` the kernel, the transfer or the buffer.
    pub(super) fn error(&self, call: &'static str, during: &str, result: vk::Result) -> EngineError {
        let device = self.report.name.clone();
        match result {
            vk::Result::ERROR_DEVICE_LOST => EngineError::DeviceLost { device, during: during.into() },
            vk::Result::ERROR_OUT_OF_DEVICE_MEMORY => {
                EngineError::OutOfMemory { device, what: during.into(), wanted: None }
            }
            vk::Result::ERROR_OUT_OF_HOST_MEMORY => {
                EngineError::OutOfMemory { device: "host".into(), what: during.into(), wanted: None }
            }
            other => EngineError::Vulkan { device, call, result: format!("{other:?}") },
        }
    }
}

impl Drop for Device {
    fn drop(&mut self) {
        // SAFETY: whatever lives on the device holds it, so all of that is gone; it is idle, and destroyed once.
        unsafe {
            let _ = self.raw.device_wait_idle();
            drop(self.allocator.get_mut().unwrap_or_else(PoisonError::into_inner).take());
            self.raw.destroy_device(None);
        }
    }
}

/// A buffer with its memory, given back when dropped.
pub(super) struct Block {
    pub(super) raw: vk::Buffer,
    /// Bytes.
    pub(super) size: u64,
    allocation: Option<Allocation>,
    device: Arc<Device>,
}

/// Blocks from this size on have memory of their own.
const DEDICATED: u64 = 4 << 20;

impl Block {
    /// `size` bytes; `what` is what an error calls it.
    pub(super) fn new(
        device: &Arc<Device>,
        size: u64,
        location: MemoryLocation,
        what: &str,
    ) -> Result<Self, EngineError> {
        let size = size.max(256);
        let out =
            || EngineError::OutOfMemory { device: device.report.name.clone(), what: what.into(), wanted: Some(size) };
        let limits = &device.report.limits;
        if size > limits.allocation {
            return Err(out());
        }
        use vk::BufferUsageFlags as Usage;
        let usage = Usage::STORAGE_BUFFER | Usage::TRANSFER_SRC | Usage::TRANSFER_DST;
        let info = vk::BufferCreateInfo::default().size(size).usage(usage);
        // SAFETY: the device is valid.
        let raw = unsafe { device.raw.create_buffer(&info, None) };
        let refused = |call| {
            move |e| match e {
                vk::Result::ERROR_OUT_OF_DEVICE_MEMORY | vk::Result::ERROR_OUT_OF_HOST_MEMORY => out(),
                e => device.error(call, what, e),
            }
        };
        let raw = raw.map_err(refused("vkCreateBuffer"))?;
        let mut block = Self { raw, size, allocation: None, device: Arc::clone(device) };
        // SAFETY: the buffer was made just now.
        let requirements = unsafe { device.raw.get_buffer_memory_requirements(raw) };
        let scheme = if size >= DEDICATED {
            AllocationScheme::DedicatedBuffer(raw)
        } else {
            AllocationScheme::GpuAllocatorManaged
        };
        let wanted =
            AllocationCreateDesc { name: what, requirements, location, linear: true, allocation_scheme: scheme };
        let mut allocator = device.allocator.lock().unwrap_or_else(PoisonError::into_inner);
        let Some(allocator) = allocator.as_mut() else { return Err(out()) };
        let allocation = allocator.allocate(&wanted).map_err(|e| match e {
            AllocationError::OutOfMemory => out(),
            e => EngineError::Vulkan { device: device.report.name.clone(), call: "allocate", result: e.to_string() },
        })?;
        // SAFETY: the memory fits the buffer's requirements, and neither was bound before.
        let bound = unsafe { device.raw.bind_buffer_memory(raw, allocation.memory(), allocation.offset()) };
        block.allocation = Some(allocation);
        bound.map_err(refused("vkBindBufferMemory"))?;
        Ok(block)
    }

    /// Whether the host sees the block's memory, through its cache and at once, as on software and integrated devices.
    pub(super) fn is_the_hosts_too(&self) -> bool {
        use vk::MemoryPropertyFlags as Memory;
        let wanted = Memory::HOST_VISIBLE | Memory::HOST_COHERENT | Memory::HOST_CACHED;
        let allocation = self.allocation.as_ref();
        allocation.is_some_and(|a| a.memory_properties().contains(wanted) && a.mapped_slice().is_some())
    }

    /// The bytes, of a block that the host sees.
    pub(super) fn bytes(&self) -> &[u8] {
        let mapped = self.allocation.as_ref().and_then(Allocation::mapped_slice);
        mapped.unwrap_or_default()
    }

    /// The bytes, of a block that the host sees.
    pub(super) fn bytes_mut(&mut self) -> &mut [u8] {
        let mapped = self.allocation.as_mut().and_then(Allocation::mapped_slice_mut);
        mapped.unwrap_or_default()
    }
}

impl Drop for Block {
    fn drop(&mut self) {
        // SAFETY: recordings that use the block are waited for before anything that they use is dropped.
        unsafe { self.device.raw.destroy_buffer(self.raw, None) };
        if let Some(allocation) = self.allocation.take() {
            let mut allocator = self.device.allocator.lock().unwrap_or_else(PoisonError::into_inner);
            if let Some(allocator) = allocator.as_mut() {
                // An allocation of this allocator can always be given back.
                let _ = allocator.free(allocation);
            }
        }
    }
}
