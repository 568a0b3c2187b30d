//! Draws views of splats on the device of the engines. The views stay there.

use crate::engine::EngineError;
use crate::engine::vulkan::{DeviceSplats, ViewsLight};
use crate::gpu::Gpu;
use crate::optics::{Color, Display};
use crate::scene::{MovingSplats, SplatCamera};
use crate::session::content::decoded_views::{ColorViews, DecodedViews};
use crate::session::content::near_eye::NearViews;

/// Splats and their views on a device, until the device fails.
pub(crate) struct SplatsOnDevice {
    splats: DeviceSplats,
    pub views: DecodedViews,
    /// The most views that fit.
    most: usize,
    gpu: Gpu,
}

impl SplatsOnDevice {
    /// Creates room for `most` views of a display in these colors. Returns the reason in words if views of this display
    /// have to pass through the host.
    pub fn new(gpu: &Gpu, display: &Display, colors: &[Color], most: usize) -> Result<Self, String> {
        let channels: Vec<usize> = colors.iter().map(|color| color.channel()).collect();
        let views = DecodedViews::new(gpu, display, colors, (3, &channels), most)?;
        Ok(Self { splats: DeviceSplats::default(), views, most, gpu: gpu.clone() })
    }

    /// Draws the views of a camera, color by color. It is `None` if the device cannot, which is reported once.
    pub fn draw(
        &mut self,
        splats: &MovingSplats,
        camera: &SplatCamera,
        near: &NearViews,
        (display, colors): (&Display, &[Color]),
    ) -> Option<Vec<ColorViews>> {
        if self.views.has_failed {
            return None;
        }
        let places = near.pairs();
        if places.len() > self.most {
            match Self::new(&self.gpu, display, colors, places.len()) {
                Ok(larger) => (self.views, self.most) = (larger.views, larger.most),
                Err(reason) => {
                    self.views.fails(&reason);
                    return None;
                }
            }
        }
        let (order, cameras) = splats.cameras(camera, &places);
        let grid = [near.views as usize; 2];
        let drawn = self.views.decoder.draw(&mut self.splats, (splats.stored(), &order), &cameras, grid);
        match self.views.measured(drawn)? {
            Ok(()) => self.views.newest().ok(),
            Err(no_light) => {
                self.views.fails(&format!("a pixel of a view of splats has the value {}", no_light.found));
                None
            }
        }
    }

    /// Records the same on a device that only records.
    pub fn record(&mut self, splats: &MovingSplats, camera: &SplatCamera, near: &NearViews) -> Result<(), EngineError> {
        let (order, cameras) = splats.cameras(camera, &near.pairs());
        let (stored, grid) = (splats.stored(), [near.views as usize; 2]);
        let drawn = self.views.decoder.draw(&mut self.splats, (stored, &order), &cameras, grid)?;
        // The light is arbitrary, because the device drew nothing.
        drop(self.views.decoder.measure(&drawn)?);
        let light = ViewsLight { brightest: 1.0, mean: 0.2, middle: [0.2, 0.1, 0.05] };
        self.views.decoder.decode(&drawn, &vec![light; self.views.decoder.colors()]).map(drop)
    }
}
