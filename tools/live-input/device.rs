//! Defines the interface for views, and color and depth, that bypass the host's memory, and the device memory that a
//! display shares.

use crate::layout::{halves, pair};
use crate::{FrameFault, FrameInfo};
use std::os::fd::OwnedFd;

/// The device and the driver that have the memory, as `deviceUUID` and `driverUUID` of Vulkan. An application on
/// another device, or with another driver, uses the region instead.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct DeviceIds {
    /// The UUID of the device.
    pub device: [u8; 16],
    /// The UUID of its driver.
    pub driver: [u8; 16],
}

/// Memory of a device with as many slots as the region. Vulkan exports it as an opaque file descriptor
/// (`VK_EXTERNAL_MEMORY_HANDLE_TYPE_OPAQUE_FD_BIT`), with one buffer at its beginning. Lengths are in bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct DeviceMemory {
    /// The device that has the memory.
    pub ids: DeviceIds,
    /// The length of the memory, as `allocationSize`.
    pub memory_bytes: u64,
    /// The length of the buffer.
    pub buffer_bytes: u64,
    /// The distance from one slot to the next.
    pub slot_stride: u64,
    /// The `memoryTypeIndex` of the memory.
    pub memory_type: u32,
    /// The `VkBufferUsageFlags` of the buffer.
    pub usage: u32,
}

/// The number of its words in the region.
pub(crate) const WORDS: usize = 8;

impl DeviceIds {
    pub(crate) fn words(&self) -> [u64; 4] {
        let [device, driver] = [self.device, self.driver].map(u128::from_le_bytes);
        [device as u64, (device >> 64) as u64, driver as u64, (driver >> 64) as u64]
    }

    pub(crate) fn of(words: &[u64; WORDS]) -> Self {
        let bytes = |at: usize| (u128::from(words[at]) | u128::from(words[at + 1]) << 64).to_le_bytes();
        Self { device: bytes(0), driver: bytes(2) }
    }
}

impl DeviceMemory {
    pub(crate) fn words(&self) -> [u64; WORDS] {
        let [a, b, c, d] = self.ids.words();
        [a, b, c, d, self.memory_bytes, self.buffer_bytes, self.slot_stride, pair(self.memory_type, self.usage)]
    }

    /// Reads the memory from these words, if it holds `slots` slots of `room` bytes.
    pub(crate) fn of(words: &[u64; WORDS], slots: u32, room: u64) -> Option<Self> {
        let [memory_type, usage] = halves(words[7]);
        let [memory_bytes, buffer_bytes, slot_stride] = [words[4], words[5], words[6]];
        let ends =
            slot_stride.checked_mul(slots.into()).filter(|_| slot_stride >= room && slot_stride.is_multiple_of(4));
        let fits = ends.is_some_and(|ends| ends <= buffer_bytes && buffer_bytes <= memory_bytes);
        let ids = DeviceIds::of(words);
        fits.then_some(Self { ids, memory_bytes, buffer_bytes, slot_stride, memory_type, usage })
    }
}

/// Decodes views, or color and depth, outside the host's memory, such as on a device.
pub trait ViewTaker {
    /// Takes the samples of views, or of color and depth, which were copied and are padded to a multiple of 4 bytes.
    /// Depth follows the colors at the next multiple of 64 bytes. The implementation checks their values, and `info` is
    /// checked already. Returns `None` if it does not take them. Then the host decodes them.
    fn take(&mut self, samples: &[u8], info: &FrameInfo) -> Option<Result<(), FrameFault>>;

    /// Returns the device whose memory an application may write into, if there is one. If the device disappears, an
    /// application that has such memory is disconnected.
    fn device(&self) -> Option<DeviceIds> {
        None
    }

    /// Returns memory of that device for the connected application, with this number of slots and this room in bytes
    /// for each. Returns `None` if there is too little memory.
    fn share(&mut self, _slots: u32, _room: u64) -> Option<(DeviceMemory, OwnedFd)> {
        None
    }

    /// Takes the samples of views, or of color and depth, in this slot of the device's memory, and copies them before
    /// it returns. Their layout is the same as in the region. The implementation checks their values, and `info` is
    /// checked already. Returns false if the host has to decode them. Then it copied them to `samples`, which has their
    /// length, padded to a multiple of 4 bytes.
    ///
    /// # Errors
    /// Returns [`FrameFault`] if a value is no light or the device failed.
    fn take_shared(&mut self, _slot: usize, _samples: &mut [u8], _info: &FrameInfo) -> Result<bool, FrameFault> {
        Err(FrameFault::Device)
    }

    /// Is called when the application is gone and no longer writes into its memory.
    fn unshare(&mut self) {}
}

/// A taker that accepts no frames.
pub(crate) struct Nobody;

impl ViewTaker for Nobody {
    fn take(&mut self, _samples: &[u8], _info: &FrameInfo) -> Option<Result<(), FrameFault>> {
        None
    }
}

/// Returns true if no process can shrink the memory of a descriptor. A device's own memory cannot shrink. Memory of the
/// host, which software devices share, is sealed here.
pub(crate) fn is_fixed(fd: &OwnedFd) -> bool {
    use rustix::fs::SealFlags;
    let fixed = SealFlags::SHRINK;
    let sealed = || rustix::fs::fcntl_get_seals(fd).map(|seals| seals.contains(fixed));
    let Ok(is_sealed) = sealed() else { return true };
    is_sealed || (rustix::fs::fcntl_add_seals(fd, fixed | SealFlags::GROW).is_ok() && sealed() == Ok(true))
}
