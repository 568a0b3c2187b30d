//! Decodes the views of an application on the device of the engines. The host sees only sums of their light.

use crate::engine::EngineError;
use crate::engine::vulkan::{NoLight, StoredViews};
use crate::gpu::{self, Gpu, SharedMemory};
use crate::optics::{Color, Display};
use crate::session::content::decoded_views::{ColorViews, DecodedViews};
use eyebox_kernels::decode_views;
use eyebox_live_input::{Content, DeviceIds, DeviceMemory, FrameFault, FrameInfo, Offer, Sample, Transfer, ViewTaker};
use std::os::fd::OwnedFd;

/// Decodes views on a device until the device fails.
pub(crate) struct DeviceViews {
    decoded: DecodedViews,
    /// The memory into which the connected application writes, and the bytes from one of its slots to the next.
    shared: Option<(SharedMemory, u64)>,
    /// The identity of the device, if it shares memory.
    ids: Option<DeviceIds>,
}

impl DeviceViews {
    /// Creates a decoder for the offer of a display. `channels` holds the channels of the display's colors in a frame.
    /// Returns the reason in words if views of this display have to pass through the host.
    pub fn new(
        gpu: &Gpu,
        offer: &Offer,
        display: &Display,
        colors: &[Color],
        channels: &[usize],
    ) -> Result<Self, String> {
        let views = (offer.views[0] * offer.views[1]) as usize;
        let decoded = DecodedViews::new(gpu, display, colors, (offer.channels(), channels), views)?;
        let gpu::DeviceIds { device, driver } = gpu.ids();
        let ids = gpu.shares_memory().then_some(DeviceIds { device, driver });
        Ok(Self { decoded, ids, shared: None })
    }

    /// Returns the views that were taken last, color by color.
    pub fn newest(&mut self) -> Result<Vec<ColorViews>, String> {
        self.decoded.newest()
    }

    /// Measures the light of samples that are on the device. Returns `None` if the device fails.
    fn judged(&mut self, there: Result<StoredViews, EngineError>) -> Option<Result<(), FrameFault>> {
        let light = self.decoded.measured(there)?;
        Some(light.map_err(|NoLight { channel, index, found }| FrameFault::Value {
            channel,
            index,
            found,
            must: "0 to 65504",
        }))
    }
}

/// Returns the storage format of the views of a frame, or `None` if it holds no views.
fn stored(info: &FrameInfo) -> Option<StoredViews> {
    let Content::Views { grid, .. } = info.content else { return None };
    let sample = match info.sample {
        Sample::U8 => decode_views::U8,
        Sample::U16 => decode_views::U16,
        Sample::F16 => decode_views::F16,
        Sample::F32 => decode_views::F32,
    };
    Some(StoredViews { grid: grid.map(|n| n as usize), sample, coded: info.transfer == Transfer::Srgb, planar: false })
}

impl ViewTaker for DeviceViews {
    fn take(&mut self, samples: &[u8], info: &FrameInfo) -> Option<Result<(), FrameFault>> {
        let stored = stored(info).filter(|_| !self.decoded.has_failed)?;
        let uploaded = self.decoded.decoder.upload(samples);
        self.judged(uploaded.map(|()| stored))
    }

    fn device(&self) -> Option<DeviceIds> {
        self.ids.filter(|_| !self.decoded.has_failed && !self.decoded.decoder.gpu().is_lost())
    }

    fn share(&mut self, slots: u32, room: u64) -> Option<(DeviceMemory, OwnedFd)> {
        let ids = self.device()?;
        // No device requires a larger alignment of memory ranges than 256 bytes.
        let slot_stride = room.next_multiple_of(256);
        match SharedMemory::export(self.decoded.decoder.gpu(), slot_stride.checked_mul(slots.into())?) {
            Ok((memory, fd)) => {
                let gpu::SharedLayout { memory_bytes, buffer_bytes, memory_type, usage } = memory.layout();
                self.shared = Some((memory, slot_stride));
                Some((DeviceMemory { ids, memory_bytes, buffer_bytes, slot_stride, memory_type, usage }, fd))
            }
            Err(error) => {
                tracing::warn!("the application's views come through the host's memory: {error}");
                None
            }
        }
    }

    fn take_shared(&mut self, slot: usize, bytes: u64, info: &FrameInfo) -> Result<(), FrameFault> {
        let (Some(stored), Some((memory, stride))) = (stored(info), &self.shared) else {
            return Err(FrameFault::Device);
        };
        // The last word may extend beyond the samples, but not beyond the slot.
        let copied = self.decoded.decoder.copy(memory, stride * slot as u64, bytes.next_multiple_of(4));
        self.judged(copied.map(|()| stored)).unwrap_or(Err(FrameFault::Device))
    }

    fn unshare(&mut self) {
        self.shared = None;
    }
}
