//! Views that never come to the host's memory: whoever takes them in its place, and memory of a device that a display shares.

use crate::layout::{halves, pair};
use crate::{FrameFault, FrameInfo};
use std::os::fd::OwnedFd;

/// Which device and which driver has the memory: `deviceUUID` and `driverUUID` of Vulkan. An application on another device, or
/// behind another driver, goes on with the region.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct DeviceIds {
    /// Of the device.
    pub device: [u8; 16],
    /// Of its driver.
    pub driver: [u8; 16],
}

/// Memory of a device in slots, as many as the region has: exported by Vulkan as an opaque file descriptor
/// (`VK_EXTERNAL_MEMORY_HANDLE_TYPE_OPAQUE_FD_BIT`), with one buffer at its beginning. Lengths are bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct DeviceMemory {
    /// Which device's.
    pub ids: DeviceIds,
    /// Of the memory: `allocationSize`.
    pub memory_bytes: u64,
    /// Of the buffer.
    pub buffer_bytes: u64,
    /// From one slot to the next.
    pub slot_stride: u64,
    /// `memoryTypeIndex`.
    pub memory_type: u32,
    /// `VkBufferUsageFlags` of the buffer.
    pub usage: u32,
}

/// Words of it in the region.
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

    /// What these words say, if `slots` slots of `room` bytes lie in it.
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

/// Decodes views elsewhere than in the host's memory, as on a device.
pub trait ViewTaker {
    /// Takes the samples of views, which were copied and are filled to a multiple of 4 bytes; their values are judged here, and
    /// `info` was. None where it does not take them after all: the host decodes them.
    fn take(&mut self, samples: &[u8], info: &FrameInfo) -> Option<Result<(), FrameFault>>;

    /// The device whose memory an application may write into, if there is one. Where there is none any more, an application that
    /// has such memory is hung up on.
    fn device(&self) -> Option<DeviceIds> {
        None
    }

    /// Memory of that device for the application that is there: so many slots with room for so many bytes each. None where there is
    /// too little of it.
    fn share(&mut self, _slots: u32, _room: u64) -> Option<(DeviceMemory, OwnedFd)> {
        None
    }

    /// Takes the samples of views that are in this slot of the device's memory: copied when this returns. Their values are judged
    /// here, and `info` was; `bytes` is how many they are.
    ///
    /// # Errors
    /// What is no light; a device that failed.
    fn take_shared(&mut self, _slot: usize, _bytes: u64, _info: &FrameInfo) -> Result<(), FrameFault> {
        Err(FrameFault::Device)
    }

    /// The application is gone: nobody writes into what it was given.
    fn unshare(&mut self) {}
}

/// Takes nothing.
pub(crate) struct Nobody;

impl ViewTaker for Nobody {
    fn take(&mut self, _samples: &[u8], _info: &FrameInfo) -> Option<Result<(), FrameFault>> {
        None
    }
}

/// Whether nobody can cut what a descriptor gives: a device's own memory cannot be cut at all, and memory of the host, which
/// devices in software share, is sealed here.
pub(crate) fn is_fixed(fd: &OwnedFd) -> bool {
    use rustix::fs::SealFlags;
    let fixed = SealFlags::SHRINK;
    let sealed = || rustix::fs::fcntl_get_seals(fd).map(|seals| seals.contains(fixed));
    let Ok(is_sealed) = sealed() else { return true };
    is_sealed || (rustix::fs::fcntl_add_seals(fd, fixed | SealFlags::GROW).is_ok() && sealed() == Ok(true))
}
