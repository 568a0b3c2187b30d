//! The device of a display, whose memory an application may write into.

// Calls of Vulkan are `unsafe`. Each has its reason.
#![allow(unsafe_code)]

use super::Picture;
use ash::vk;
use eyebox_live_input::{DeviceIds, DeviceMemory, FrameFault, FrameInfo, Offer, ViewTaker};
use std::os::fd::{FromRawFd, OwnedFd};

const OPAQUE: vk::ExternalMemoryHandleTypeFlags = vk::ExternalMemoryHandleTypeFlags::OPAQUE_FD;

/// The memory that a display shares.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Shares {
    /// It has no device.
    Nothing,
    Memory,
    /// The device is another one than the application's.
    Elsewhere,
    /// It has no memory left when the application requests it.
    TooLittle,
    /// The memory has a type that the device does not have.
    OddMemory,
}

/// A device of Vulkan.
struct Gpu {
    _entry: ash::Entry,
    instance: ash::Instance,
    physical: vk::PhysicalDevice,
    raw: ash::Device,
}

impl Gpu {
    fn open() -> Self {
        // SAFETY: the library is Vulkan's loader.
        let entry = unsafe { ash::Entry::load() }.unwrap();
        let about = vk::ApplicationInfo::default().api_version(vk::API_VERSION_1_2);
        let info = vk::InstanceCreateInfo::default().application_info(&about);
        let queues = [vk::DeviceQueueCreateInfo::default().queue_priorities(&[1.0])];
        let extensions = [ash::khr::external_memory_fd::NAME.as_ptr()];
        let of_device =
            vk::DeviceCreateInfo::default().queue_create_infos(&queues).enabled_extension_names(&extensions);
        // SAFETY: the structures live as long as the calls, and `Drop` destroys the device and the instance.
        unsafe {
            let instance = entry.create_instance(&info, None).unwrap();
            let physical = instance.enumerate_physical_devices().unwrap()[0];
            let raw = instance.create_device(physical, &of_device, None).unwrap();
            Self { _entry: entry, instance, physical, raw }
        }
    }

    fn ids(&self) -> DeviceIds {
        let mut ids = vk::PhysicalDeviceIDProperties::default();
        let mut all = vk::PhysicalDeviceProperties2::default().push_next(&mut ids);
        // SAFETY: the device is of the instance.
        unsafe { self.instance.get_physical_device_properties2(self.physical, &mut all) };
        DeviceIds { device: ids.device_uuid, driver: ids.driver_uuid }
    }

    /// Allocates shared memory that the host reads, too.
    fn export(&self, slots: u32, slot_stride: u64) -> (vk::DeviceMemory, *const u8, DeviceMemory, OwnedFd) {
        let usage = vk::BufferUsageFlags::TRANSFER_SRC
            | vk::BufferUsageFlags::TRANSFER_DST
            | vk::BufferUsageFlags::STORAGE_BUFFER;
        let mut external = vk::ExternalMemoryBufferCreateInfo::default().handle_types(OPAQUE);
        let bytes = slot_stride * u64::from(slots);
        let info = vk::BufferCreateInfo::default().size(bytes).usage(usage).push_next(&mut external);
        let mut exported = vk::ExportMemoryAllocateInfo::default().handle_types(OPAQUE);
        let wanted = vk::MemoryPropertyFlags::HOST_VISIBLE | vk::MemoryPropertyFlags::HOST_COHERENT;
        // SAFETY: the structures live as long as the calls. The buffer states the needs, and the mapped memory lives
        // until the end of the connection.
        unsafe {
            let buffer = self.raw.create_buffer(&info, None).unwrap();
            let needs = self.raw.get_buffer_memory_requirements(buffer);
            self.raw.destroy_buffer(buffer, None);
            let all = self.instance.get_physical_device_memory_properties(self.physical);
            let fits = |i: &u32| {
                needs.memory_type_bits >> i & 1 == 1 && all.memory_types[*i as usize].property_flags.contains(wanted)
            };
            let memory_type = (0..all.memory_type_count).find(fits).expect("memory that the host reads");
            let info = vk::MemoryAllocateInfo::default()
                .allocation_size(needs.size)
                .memory_type_index(memory_type)
                .push_next(&mut exported);
            let memory = self.raw.allocate_memory(&info, None).unwrap();
            let mapped = self.raw.map_memory(memory, 0, vk::WHOLE_SIZE, vk::MemoryMapFlags::empty()).unwrap();
            let get = ash::khr::external_memory_fd::Device::new(&self.instance, &self.raw);
            let info = vk::MemoryGetFdInfoKHR::default().memory(memory).handle_type(OPAQUE);
            let fd = OwnedFd::from_raw_fd(get.get_memory_fd(&info).unwrap());
            let (ids, memory_bytes, buffer_bytes) = (self.ids(), needs.size, bytes);
            let usage = usage.as_raw();
            (
                memory,
                mapped.cast(),
                DeviceMemory { ids, memory_bytes, buffer_bytes, slot_stride, memory_type, usage },
                fd,
            )
        }
    }
}

impl Drop for Gpu {
    fn drop(&mut self) {
        // SAFETY: the memory was freed before.
        unsafe {
            self.raw.destroy_device(None);
            self.instance.destroy_instance(None);
        }
    }
}

/// Takes frames from the memory of a device.
pub struct Taker {
    gpu: Option<Gpu>,
    shares: Shares,
    offer: Offer,
    /// The memory with its bytes and the bytes from one slot to the next, while an application has it.
    shared: Option<(vk::DeviceMemory, *const u8, u64)>,
    /// The frame that was taken last.
    pub taken: Option<Picture>,
}

impl Taker {
    pub fn new(shares: Shares, offer: Offer) -> Self {
        let gpu = (shares != Shares::Nothing).then(Gpu::open);
        Self { gpu, shares, offer, shared: None, taken: None }
    }
}

impl ViewTaker for Taker {
    fn take(&mut self, _samples: &[u8], _info: &FrameInfo) -> Option<Result<(), FrameFault>> {
        None
    }

    fn device(&self) -> Option<DeviceIds> {
        let ids = self.gpu.as_ref()?.ids();
        Some(if self.shares == Shares::Elsewhere { DeviceIds { device: *b"another device..", ..ids } } else { ids })
    }

    fn share(&mut self, slots: u32, room: u64) -> Option<(DeviceMemory, OwnedFd)> {
        let gpu = self.gpu.as_ref().filter(|_| self.shares != Shares::TooLittle)?;
        // Slots need not begin at the unit of the device's bindings.
        let stride = room + 4;
        let (memory, mapped, mut layout, fd) = gpu.export(slots, stride);
        self.shared = Some((memory, mapped, stride));
        if self.shares == Shares::OddMemory {
            layout.memory_type = 31;
        }
        Some((layout, fd))
    }

    fn take_shared(&mut self, slot: usize, samples: &mut [u8], info: &FrameInfo) -> Result<bool, FrameFault> {
        let (_, mapped, stride) = self.shared.expect("shared memory");
        let pixels = self.offer.pixels();
        let channels = self.offer.channels();
        let depth = (4 * pixels * channels).next_multiple_of(64);
        assert_eq!(samples.len(), depth + 4 * pixels);
        // SAFETY: the memory has these bytes, and the application does not write the held slot.
        let all = unsafe { std::slice::from_raw_parts(mapped.add(slot * stride as usize), samples.len()) };
        let value = |at: usize| f32::from_le_bytes(std::array::from_fn(|i| all[4 * at + i]));
        let light: Vec<Vec<f32>> =
            (0..channels).map(|channel| (0..pixels).map(|pixel| value(pixel * channels + channel)).collect()).collect();
        let dioptres: Vec<f32> = (0..pixels).map(|pixel| value(depth / 4 + pixel)).collect();
        assert!(light.iter().flatten().all(|v| (0.0..=65_504.0).contains(v)), "light of slot {slot}");
        assert!(dioptres.iter().all(|v| (-100.0..=100.0).contains(v)), "dioptres of slot {slot}");
        self.taken = Some(Picture { info: *info, channels: light, dioptres });
        Ok(true)
    }

    fn unshare(&mut self) {
        if let (Some(gpu), Some((memory, ..))) = (&self.gpu, self.shared.take()) {
            // SAFETY: the application is gone.
            unsafe { gpu.raw.free_memory(memory, None) };
        }
    }
}

impl Drop for Taker {
    fn drop(&mut self) {
        self.unshare();
    }
}
