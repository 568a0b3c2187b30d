//! Views that are decoded on the device of the engines. The host sees only sums of their light.

use crate::engine::EngineError;
use crate::engine::vulkan::{NoLight, StoredViews, ViewDecoder, ViewsLight};
use crate::gpu::Gpu;
use crate::optics::{Color, Display, Padding};
use crate::scene::{Pyramid, ViewGrid};
use crate::session::content::near_eye::{Exposures, USUAL_EXPOSURE};
use crate::session::frame_log::error::SessionError;
use crate::session::refinement::field::LiveColor;
use crate::solve::Problem;
use eyebox_base::error::Reason;
use std::sync::Arc;

/// Decodes views on a device until the device fails.
pub(crate) struct DecodedViews {
    pub decoder: ViewDecoder,
    newest: Option<(StoredViews, Vec<ViewsLight>)>,
    pub has_failed: bool,
}

/// The views of a color.
pub(crate) struct ColorViews {
    pyramid: Arc<Pyramid>,
    light: ViewsLight,
}

impl DecodedViews {
    /// Creates a decoder for frames of at most `views` views of a display's picture. Samples have `stored` colors, and
    /// `channels` holds the indices of the display's colors. Returns the reason in words if views of this display have to
    /// pass through the host.
    pub fn new(
        gpu: &Gpu,
        display: &Display,
        colors: &[Color],
        (stored, channels): (usize, &[usize]),
        views: usize,
    ) -> Result<Self, String> {
        let (height, width) = display.picture_size();
        if display.mask_factor() > 1 {
            return Err("the phase mask of the display requires larger views".into());
        }
        for color in colors {
            let wavelength = display.optics(*color).map_err(|e| e.to_string())?.wavelength;
            if display.picture_share(wavelength) < 1.0 {
                return Err(format!("the far field requires smaller views in {color}"));
            }
            if display.picture.map(*color, [height, width]).is_some() {
                return Err("the display model requires warped views".into());
            }
        }
        let bytes = (height * width * stored * views * size_of::<f32>()) as u64;
        let decoder = ViewDecoder::new(gpu, [height, width], stored, channels, bytes).map_err(|e| e.to_string())?;
        Ok(Self { decoder, newest: None, has_failed: false })
    }

    /// Measures the light of views whose samples are on the device. Returns `None` if the device fails.
    pub fn measured(&mut self, there: Result<StoredViews, EngineError>) -> Option<Result<(), NoLight>> {
        match there.and_then(|stored| Ok((stored, self.decoder.measure(&stored)?))) {
            Ok((stored, Ok(lights))) => {
                self.newest = Some((stored, lights));
                Some(Ok(()))
            }
            Ok((_, Err(no_light))) => Some(Err(no_light)),
            Err(error) => {
                self.fails(&error.to_string());
                None
            }
        }
    }

    /// Returns the views that were measured last, color by color.
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

    /// Reports a failure once, after which the host makes the views.
    pub fn fails(&mut self, reason: &str) {
        tracing::warn!("views are made on the host from now on: {reason}");
        self.has_failed = true;
    }
}

/// Returns the colors of a display with their exposures, whose views are on a grid around `center` (m).
///
/// # Errors
/// Returns [`SessionError::Setting`] if the display does not have a color.
pub(crate) fn live_colors(
    newest: Vec<ColorViews>,
    exposures: &Exposures,
    (display, colors): (&Display, &[Color]),
    (views, center): (ViewGrid, [f64; 2]),
) -> Result<Vec<LiveColor>, SessionError> {
    // The estimate equals the one of `BrightEnd` for a picture on the host.
    let end = |ColorViews { light, .. }: &ColorViews| match light.middle {
        [mean, square, cube] if square > 0.0 => [(cube / square).max(mean), mean],
        _ => [USUAL_EXPOSURE, 0.0],
    };
    let ends: Vec<[f64; 2]> = newest.iter().map(end).collect();
    let each = newest.into_iter().zip(colors).zip(exposures.of(display, colors, &ends));
    let one = |((ColorViews { pyramid, light }, color), exposure): ((ColorViews, &Color), f64)| {
        let outline = Problem::outline(display, *color, Padding::default(), views);
        let outline = outline.map_err(|e| SessionError::Setting(Reason::of(&e)))?;
        let problem = Problem { pyramid, mean: light.mean, center, ..outline };
        Ok(LiveColor { problem, phases: Vec::new(), exposure, laser: None })
    };
    each.map(one).collect()
}
