//! Decodes the views of an application, or makes them of its pictures with depths, on the device of the engines. The
//! host sees only sums of their light.

use crate::engine::EngineError;
use crate::engine::vulkan::{DeviceRelief, NoLight, StoredDepths, StoredViews};
use crate::gpu::{self, Gpu, SharedMemory};
use crate::optics::{Color, Display};
use crate::scene::Places;
use crate::session::content::decoded_views::{ColorViews, DecodedViews};
use eyebox_kernels::decode_views;
use eyebox_live_input::{Content, DeviceIds, DeviceMemory, FrameFault, FrameInfo, Offer, Sample, Transfer, ViewTaker};
use std::os::fd::OwnedFd;

/// Decodes views on a device until the device fails.
pub(crate) struct DeviceViews {
    decoded: DecodedViews,
    /// True if the device makes the views of pictures with depths, too.
    draws: bool,
    depths: Depths,
    /// The memory into which the connected application writes, and the bytes from one of its slots to the next.
    shared: Option<(SharedMemory, u64)>,
    /// The identity of the device, if it shares memory.
    ids: Option<DeviceIds>,
}

/// The newest picture with depths of an application.
struct Depths {
    relief: DeviceRelief,
    /// Samples of the colors of a picture.
    samples: u64,
    /// Pixels by which content at one dioptre moves per millimeter of the pupil plane.
    per_dioptre: f64,
}

/// A frame as an application stored it.
enum Given {
    Views(StoredViews),
    Depths(StoredDepths),
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
        let samples = u64::from(offer.size[0]) * u64::from(offer.size[1]) * offer.channels() as u64;
        // The conversion from dioptres to depth follows OPTICS 8.
        let per_dioptre = display.focal_length / display.picture_pixel() * 1e-3;
        let depths = Depths { relief: DeviceRelief::default(), samples, per_dioptre };
        Ok(Self { decoded, draws: gpu.draws_views(), depths, ids, shared: None })
    }

    /// Returns the views that were taken last, color by color.
    pub fn newest(&mut self) -> Result<Vec<ColorViews>, String> {
        self.decoded.newest()
    }

    /// Draws views of the newest picture with depths from these places, on a grid of `views` rows and columns. They become
    /// the newest views.
    ///
    /// # Errors
    /// The reason in words, if the depths displace content too far or the device fails.
    pub fn draw(&mut self, from: &Places<'_>, views: usize) -> Result<(), String> {
        let relief = &mut self.depths.relief;
        // Disparities are per millimeter of the pupil plane.
        from.check(relief.ends().iter().flatten().map(|end| f64::from(*end) * 1e3 / from.per_metre))
            .map_err(|reason| reason.to_string())?;
        let places: Vec<[f32; 2]> = from.places.iter().map(|place| place.map(|v| (v * 1e3) as f32)).collect();
        let reach = (from.reach() * 1e3) as f32;
        let drawn = self.decoded.decoder.draw_depths(relief, (&places, reach), [views; 2]);
        match self.decoded.measured(drawn) {
            Some(Ok(())) => Ok(()),
            Some(Err(no_light)) => Err(format!("a pixel of a view has the value {}", no_light.found)),
            None => Err("the device failed".into()),
        }
    }

    /// Returns the storage format of a frame, or `None` if the device does not take its kind.
    fn given(&self, info: &FrameInfo) -> Option<Given> {
        let (sample, bytes) = match info.sample {
            Sample::U8 => (decode_views::U8, 1),
            Sample::U16 => (decode_views::U16, 2),
            Sample::F16 => (decode_views::F16, 2),
            Sample::F32 => (decode_views::F32, 4),
        };
        let coded = info.transfer == Transfer::Srgb;
        match info.content {
            Content::Views { grid, .. } => {
                Some(Given::Views(StoredViews { grid: grid.map(|n| n as usize), sample, coded, planar: false }))
            }
            Content::ColorAndDepth => Some(Given::Depths(StoredDepths {
                sample,
                coded,
                // The format of live input has the depths at the next multiple of 64 bytes.
                depths: (self.depths.samples * bytes).next_multiple_of(64),
                per_dioptre: self.depths.per_dioptre as f32,
            })),
            Content::Layers(_) => None,
        }
    }

    /// Returns true if the device makes the views of a frame, or has them.
    fn takes(&self, given: &Given) -> bool {
        self.draws || matches!(given, Given::Views(_))
    }

    /// Checks a frame whose samples are on the device. Returns `None` if the device fails.
    fn judged(&mut self, there: Result<Given, EngineError>) -> Option<Result<(), FrameFault>> {
        let light = match there {
            Ok(Given::Views(stored)) => self.decoded.measured(Ok(stored))?,
            Ok(Given::Depths(stored)) => match self.decoded.decoder.read_depths(&mut self.depths.relief, &stored) {
                Ok(read) => read.map(drop),
                Err(error) => self.decoded.measured(Err(error))?,
            },
            Err(error) => self.decoded.measured(Err(error))?,
        };
        let colors = self.decoded.decoder.stored_colors();
        Some(light.map_err(|NoLight { channel, index, found }| {
            let must = if channel < colors { "0 to 65504" } else { "-100 to 100 dioptres" };
            FrameFault::Value { channel, index, found, must }
        }))
    }
}

impl ViewTaker for DeviceViews {
    fn take(&mut self, samples: &[u8], info: &FrameInfo) -> Option<Result<(), FrameFault>> {
        let given = self.given(info).filter(|given| !self.decoded.has_failed && self.takes(given))?;
        let decoder = &mut self.decoded.decoder;
        let uploaded = match given {
            Given::Views(_) => decoder.upload(samples),
            Given::Depths(_) => decoder.upload_depths(&mut self.depths.relief, samples),
        };
        self.judged(uploaded.map(|()| given))
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

    fn take_shared(&mut self, slot: usize, samples: &mut [u8], info: &FrameInfo) -> Result<bool, FrameFault> {
        let (Some(given), Some((memory, stride))) = (self.given(info), &self.shared) else {
            return Err(FrameFault::Device);
        };
        // The last word may extend beyond the samples, but not beyond the slot.
        let (at, bytes) = (stride * slot as u64, samples.len() as u64);
        let takes = self.takes(&given);
        let decoder = &mut self.decoded.decoder;
        let copied = match given {
            Given::Views(_) => decoder.copy(memory, at, bytes),
            Given::Depths(_) => decoder.copy_depths(&mut self.depths.relief, memory, at, bytes),
        };
        if takes {
            return self.judged(copied.map(|()| given)).unwrap_or(Err(FrameFault::Device)).map(|()| true);
        }
        match copied.and_then(|()| decoder.fetch_depths(&self.depths.relief, samples)) {
            Ok(()) => Ok(false),
            Err(error) => {
                self.decoded.fails(&error.to_string());
                Err(FrameFault::Device)
            }
        }
    }

    fn unshare(&mut self) {
        self.shared = None;
    }
}
