//! Records a content frame of splats without drawing it, and estimates its time on known devices.

use crate::engine::EngineError;
use crate::gpu::Gpu;
use crate::optics::{Color, Display};
use crate::plan::{DeviceModel, Estimate, Recording};
use crate::scene::MovingSplats;
use crate::session::content::device_splats::SplatsOnDevice;
use crate::session::content::near_eye::{NearViews, TRACKED_VIEWS};
use eyebox_kernels::draw_splats::SIDE;
use eyebox_kernels::mark_splats;
use std::time::{Duration, Instant};

/// The operations of the kernels, counted in their shaders. They are for a splat at a pixel, for a bin and a splat, for
/// a word of marks in a tile, and for a splat that is projected.
const AT_PIXEL: f64 = 40.0;
const OF_BIN: f64 = 6.0;
const OF_WORD: f64 = 12.0;
const PROJECTED: f64 = 400.0;
/// Share of the float32 rate of a data sheet that these kernels are taken to reach. It was not measured.
const REACHED: f64 = 0.1;
/// Number of orders of which the median time is taken.
const ORDERS: usize = 9;

/// The work of a content frame, for which a camera in front of splats has moved.
#[derive(Debug, Clone)]
pub struct SplatsDryRun {
    /// Number of views around the tracked pupil.
    pub views: usize,
    /// Number of splats in front of the camera.
    pub splats: usize,
    /// Number of pairs of a splat and a tile that it touches, in all views.
    pub entries: u64,
    /// The commands for the device.
    pub recording: Recording,
    /// Time in which the host of this run orders the splats.
    pub host: Duration,
    operations: f64,
}

impl SplatsDryRun {
    /// Records a content frame for a tracked pupil, on a device that
    /// [only records](crate::gpu::Options::record_only). It is `None` with the reason in words if the views of the
    /// display pass through the host.
    ///
    /// # Errors
    /// [`EngineError`] if memory runs out.
    pub fn of(
        splats: &MovingSplats,
        display: &Display,
        colors: &[Color],
        gpu: &Gpu,
    ) -> Result<Result<Self, String>, EngineError> {
        let pitch = display.eyebox_min() / f64::from(TRACKED_VIEWS);
        let near = NearViews { views: TRACKED_VIEWS, pitch, center: [0.0; 2] };
        let (camera, places) = (splats.camera(), near.pairs());
        let mut device = match SplatsOnDevice::new(gpu, display, colors, places.len()) {
            Ok(device) => device,
            Err(reason) => return Ok(Err(reason)),
        };
        // The first frame stores the splats.
        device.record(splats, &camera, &near)?;
        let (done, recording) = gpu.recorded(|| device.record(splats, &camera, &near));
        done?;
        let mut times = Vec::new();
        let mut seen = 0;
        for _ in 0..ORDERS {
            let begun = Instant::now();
            seen = splats.cameras(&camera, &places).0.len();
            times.push(begun.elapsed());
        }
        times.sort();
        let (height, width) = display.picture_size();
        let marking = mark_splats::Args::new(seen, height, width);
        let [bins, words, views] = [marking.bins, marking.words, places.len() as u32].map(f64::from);
        let tiles = (height.div_ceil(SIDE as usize) * width.div_ceil(SIDE as usize)) as f64;
        let entries = splats.entries(&camera, &places);
        let of_view = OF_BIN * bins * seen as f64 + OF_WORD * words * tiles + PROJECTED * seen as f64;
        let operations = views * of_view + AT_PIXEL * f64::from(SIDE * SIDE) * entries as f64;
        let host = times[ORDERS / 2];
        Ok(Ok(Self { views: places.len(), splats: seen, entries, recording, host, operations }))
    }

    /// Estimates the time of the device, without the host. Arithmetic is an upper bound, because closed pixels and
    /// those outside of a splat count.
    pub fn estimate(&self, device: &DeviceModel) -> Estimate {
        let arithmetic = Duration::from_secs_f64(self.operations / (REACHED * device.float_rate()));
        // Successive frames use other memory for their views, so the cache has nothing of the frame before.
        Estimate { arithmetic, ..device.estimate(&[&self.recording], 1) }
    }
}
