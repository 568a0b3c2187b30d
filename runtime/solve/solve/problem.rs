//! The problem that a solve receives, which is a scene on a display in one color.

use super::settings::Settings;
use crate::optics::{
    Color, Display, EyeboxRegion, Optics, OpticsError, Padding, SourceChoice, SourceMode, WindowFactor,
};
use crate::plan::{EyeTables, ModelTables, Planner, Storage, ViewLayout};
use crate::scene::{Bend, Fit, LightField, Pyramid, Resize, ViewGrid, shrink_to_share};
use rayon::prelude::*;
use std::borrow::Cow;
use std::sync::Arc;

/// Returns the sum of each view. Four views are summed side by side because each addition waits for the one before it.
fn sums(views: &[Vec<f32>]) -> Vec<f64> {
    let some = |views: &[Vec<f32>]| match views {
        [a, b, c, d] => {
            let mut sums = [0.0; 4];
            for (((a, b), c), d) in a.iter().zip(b).zip(c).zip(d) {
                let values = [a, b, c, d];
                sums.iter_mut().zip(values).for_each(|(sum, v)| *sum += f64::from(*v));
            }
            sums.to_vec()
        }
        _ => views.iter().map(|v| v.iter().map(|x| f64::from(*x)).sum()).collect(),
    };
    views.par_chunks(4).flat_map_iter(some).collect()
}

/// One color of a display, and the scene in that color.
#[derive(Debug, Clone)]
pub struct Problem {
    /// The optics over the SLM.
    pub optics: Optics,
    /// Zeros around the SLM. The views cover the padded grid.
    pub padding: Padding,
    /// Side of the eyebox in which pupils are drawn, in meters. All colors of the display serve this eyebox.
    pub eyebox: f64,
    /// The parts of the eyebox that the lit switchable sources of the display serve. The list is empty if they serve
    /// all of it.
    pub regions: Arc<[EyeboxRegion]>,
    /// The grid of the views around `center`.
    pub views: ViewGrid,
    /// Center (x, y) of the views in the pupil plane, in meters.
    pub center: [f64; 2],
    /// The views on the padded grid.
    pub pyramid: Arc<Pyramid>,
    /// Mean linear light of the scene over the image.
    pub mean: f64,
    /// Share of the image that the picture fills along each axis. It is less than 1 for the longer wavelengths of a far
    /// field.
    pub share: f64,
    /// The faults of the display (OPTICS 10), or `None` for an ideal display.
    pub model: Option<Arc<ModelTables>>,
    /// The eye of the viewer (OPTICS 11), or `None` for a perfect eye.
    pub eye: Option<Arc<EyeTables>>,
    /// The modes of the display's source (OPTICS 12). The list is empty for a laser on the axis.
    pub modes: Arc<[SourceMode]>,
    /// The choice of the lit switchable sources as the eye moves, if they follow the eye.
    pub choice: Option<SourceChoice>,
}

impl Problem {
    /// Prepares one color of the scene `field`, which has the size of the display.
    ///
    /// # Errors
    /// [`OpticsError::NoColor`] for a color that the display or the scene does not have.
    pub fn new(field: &LightField, color: Color, display: &Display, padding: Padding) -> Result<Self, OpticsError> {
        let missing = || OpticsError::NoColor {
            display: field.name.clone(),
            color,
            has: field.colors.iter().map(Color::to_string).collect::<Vec<_>>().join(", "),
        };
        let views = &field.planes[field.colors.iter().position(|c| *c == color).ok_or_else(missing)?];
        // The views are distorted so that the eye sees the scene correctly (OPTICS 10).
        let size = [field.height, field.width];
        let bend = display.picture.map(color, size).map(|map| Bend::to_display(&map, size));
        let bent: Option<Vec<_>> = bend.map(|bend| views.par_iter().map(|view| bend.apply(view)).collect());
        let views = bent.as_ref().unwrap_or(views);
        let grid = ViewGrid { rows: field.grid[0], columns: field.grid[1], cell: field.cell(display) };
        let outline = Self::outline(display, color, padding, grid)?;
        let (height, width) = (field.height, field.width);
        let grid = padding.grid(outline.optics);
        let share = outline.share;
        let pyramid = if share < 1.0 {
            let shrunk = |view: &Vec<f32>| shrink_to_share(view, height, width, share);
            Pyramid::new(&views.iter().map(shrunk).collect::<Vec<_>>(), height, width)
        } else if grid == outline.optics {
            Pyramid::new(views, height, width)
        } else {
            // Behind a mask the picture has the pixels of the mask.
            let finer = outline.optics.mask_factor;
            let larger =
                (finer > 1).then(|| Resize::new([height, width], [finer * height, finer * width], Fit::Stretch));
            let (height, width) = (finer * height, finer * width);
            let (top, left) = ((grid.height - height) / 2, (grid.width - width) / 2);
            let framed = |view: &Vec<f32>| {
                let view = larger.as_ref().map_or(Cow::Borrowed(view), |larger| Cow::Owned(larger.apply(view)));
                let mut out = vec![0.0; grid.height * grid.width];
                for (row, out) in view.chunks_exact(width).zip(out.chunks_exact_mut(grid.width).skip(top)) {
                    out[left..left + width].copy_from_slice(row);
                }
                out
            };
            Pyramid::new(&views.iter().map(framed).collect::<Vec<_>>(), grid.height, grid.width)
        };
        let pixels = (views.len() * height * width) as f64;
        let mean = sums(views).iter().sum::<f64>() / pixels;
        Ok(Self { pyramid: Arc::new(pyramid), mean: mean * share * share, ..outline })
    }

    /// Prepares positions and sizes of the views without their light, which is enough for plans and forecasts. The mean
    /// is NaN.
    ///
    /// # Errors
    /// [`OpticsError`] for a color that the display does not have.
    pub fn outline(display: &Display, color: Color, padding: Padding, views: ViewGrid) -> Result<Self, OpticsError> {
        let optics = display.optics(color)?;
        let grid = padding.grid(optics);
        let pyramid = Pyramid::outline(views.rows * views.columns, grid.height, grid.width);
        let (eyebox, center, share) = (display.eyebox_min(), [0.0; 2], display.picture_share(optics.wavelength));
        let (pyramid, model) = (Arc::new(pyramid), ModelTables::of(display, color, optics, grid));
        let model = model.map(|model| model.for_steps());
        let eye = EyeTables::new(display.prescription.as_ref());
        let modes = display.modes(color).into();
        let (regions, mean) = (display.regions(color).into(), f64::NAN);
        let choice = SourceChoice::new(display, color);
        Ok(Self { optics, padding, eyebox, regions, views, center, pyramid, mean, share, model, eye, modes, choice })
    }

    /// Returns true if a static mask is in front of the SLM.
    pub(crate) fn has_mask(&self) -> bool {
        self.model.as_ref().is_some_and(|model| model.parts().mask > 0)
    }

    /// Returns the side of a pixel of the picture, as its views have it, in radians.
    pub fn pixel(&self) -> f64 {
        let grid = self.padding.grid(self.optics);
        grid.field_of_view().1 / grid.width as f64 / grid.focal_length
    }

    /// Returns a power of two near the scene's brightest value, or 1 for ordinary values. Division by it keeps float32
    /// in range and changes no digit.
    pub fn unit(&self) -> f64 {
        let exponent = f64::from(self.pyramid.scale).log2().round();
        if exponent.abs() > 10.0 { exponent.exp2() } else { 1.0 }
    }

    /// Returns the planner for a solve of this problem with these settings.
    pub fn planner_of(&self, settings: &Settings) -> Planner {
        let plain = self.planner(settings.solved_frames(), settings.window);
        let (levels, storage) = (settings.levels.count(), settings.storage);
        let plain = Planner { levels, storage, binary_angles: storage == Storage::F16, ..plain };
        if settings.all_modes { plain } else { plain.with_fewer_modes(self.eyebox) }
    }

    /// Returns the planner for this problem with `frames` sub-frames.
    pub fn planner(&self, frames: usize, window: WindowFactor) -> Planner {
        let plain = Planner::new(self.optics, frames, window).with_padding(self.padding);
        let views = ViewLayout::new(self.views, &self.pyramid).centered_at(self.center);
        let (model, eye, modes) = (self.model.clone(), self.eye.clone(), Arc::clone(&self.modes));
        Planner { views: Some(views), share: self.share, model, eye, modes, ..plain }
    }
}
