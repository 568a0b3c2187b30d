//! Decodes the views of an application on the device of the engines. The host sees only sums of their light.

use crate::engine::EngineError;
use crate::engine::vulkan::{NoLight, StoredViews, ViewDecoder, ViewsLight};
use crate::gpu::{self, Gpu, SharedMemory};
use crate::optics::{Color, Display, Padding};
use crate::scene::{Pyramid, ViewGrid};
use crate::session::frame_log::error::SessionError;
use crate::solve::Problem;
use eyebox_base::error::Reason;
use eyebox_kernels::decode_views;
use eyebox_live_input::{Content, DeviceIds, DeviceMemory, FrameFault, FrameInfo, Offer, Sample, Transfer, ViewTaker};
use std::os::fd::OwnedFd;
use std::sync::Arc;

/// Decodes views on a device until the device fails.
pub(crate) struct DeviceViews {
    decoder: ViewDecoder,
    /// The memory into which the connected application writes, and the bytes from one of its slots to the next.
    shared: Option<(SharedMemory, u64)>,
    /// The identity of the device, if it shares memory.
    ids: Option<DeviceIds>,
    newest: Option<(StoredViews, Vec<ViewsLight>)>,
    has_failed: bool,
}

pub(crate) struct ColorViews {
    pub pyramid: Arc<Pyramid>,
    pub light: ViewsLight,
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
        let size = offer.size.map(|n| n as usize);
        if display.mask_factor() > 1 {
            return Err("the phase mask of the display requires larger views".into());
        }
        for color in colors {
            let wavelength = display.optics(*color).map_err(|e| e.to_string())?.wavelength;
            if display.picture_share(wavelength) < 1.0 {
                return Err(format!("the far field requires smaller views in {color}"));
            }
            if display.picture.map(*color, size).is_some() {
                return Err("the display model requires warped views".into());
            }
        }
        let samples = offer.pixels() * offer.channels() * (offer.views[0] * offer.views[1]) as usize;
        let bytes = (samples * Sample::F32.bytes()) as u64;
        let decoder = ViewDecoder::new(gpu, size, offer.channels(), channels, bytes).map_err(|e| e.to_string())?;
        let gpu::DeviceIds { device, driver } = gpu.ids();
        let ids = gpu.shares_memory().then_some(DeviceIds { device, driver });
        Ok(Self { decoder, ids, shared: None, newest: None, has_failed: false })
    }

    /// Returns the views that were taken last, color by color.
    pub fn newest(&mut self) -> Result<Vec<ColorViews>, String> {
        let Some((stored, lights)) = self.newest.take() else { return Err("no views were taken".into()) };
        let decoded = match self.decoder.decode(&stored, &lights) {
            Ok(decoded) => decoded,
            Err(error) => {
                let line = error.to_string();
                self.fails(&line);
                return Err(line);
            }
        };
        Ok(decoded.into_iter().zip(lights).map(|(pyramid, light)| ColorViews { pyramid, light }).collect())
    }

    /// Measures the light of samples that are on the device. Returns `None` if the device fails.
    fn judged(&mut self, stored: &StoredViews, there: Result<(), EngineError>) -> Option<Result<(), FrameFault>> {
        match there.and_then(|()| self.decoder.measure(stored)) {
            Ok(Ok(lights)) => {
                self.newest = Some((*stored, lights));
                Some(Ok(()))
            }
            Ok(Err(NoLight { channel, index, found })) => {
                Some(Err(FrameFault::Value { channel, index, found, must: "0 to 65504" }))
            }
            Err(error) => {
                self.fails(&error.to_string());
                None
            }
        }
    }

    /// Reports a failure once, after which the host decodes.
    fn fails(&mut self, reason: &str) {
        tracing::warn!("views are decoded on the host from now on: {reason}");
        self.has_failed = true;
    }
}

impl ColorViews {
    /// Returns the problem of a color of the display, whose views are on this grid around `center` (m).
    pub fn problem(
        self,
        display: &Display,
        color: Color,
        views: ViewGrid,
        center: [f64; 2],
    ) -> Result<Problem, SessionError> {
        let outline = Problem::outline(display, color, Padding::default(), views);
        let outline = outline.map_err(|e| SessionError::Setting(Reason::of(&e)))?;
        Ok(Problem { pyramid: self.pyramid, mean: self.light.mean, center, ..outline })
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
    Some(StoredViews { grid: grid.map(|n| n as usize), sample, coded: info.transfer == Transfer::Srgb })
}

impl ViewTaker for DeviceViews {
    fn take(&mut self, samples: &[u8], info: &FrameInfo) -> Option<Result<(), FrameFault>> {
        let stored = stored(info).filter(|_| !self.has_failed)?;
        let uploaded = self.decoder.upload(samples);
        self.judged(&stored, uploaded)
    }

    fn device(&self) -> Option<DeviceIds> {
        self.ids.filter(|_| !self.has_failed && !self.decoder.gpu().is_lost())
    }

    fn share(&mut self, slots: u32, room: u64) -> Option<(DeviceMemory, OwnedFd)> {
        let ids = self.device()?;
        // No device requires a larger alignment of memory ranges than 256 bytes.
        let slot_stride = room.next_multiple_of(256);
        match SharedMemory::export(self.decoder.gpu(), slot_stride.checked_mul(slots.into())?) {
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
        let copied = self.decoder.copy(memory, stride * slot as u64, bytes.next_multiple_of(4));
        self.judged(&stored, copied).unwrap_or(Err(FrameFault::Device))
    }

    fn unshare(&mut self) {
        self.shared = None;
    }
}
