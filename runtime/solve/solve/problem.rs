//! What is to be solved: a scene on a display, in one colour.

use super::settings::Settings;
use crate::optics::{
    Color, Display, EyeboxRegion, Optics, OpticsError, Padding, SourceChoice, SourceMode, WindowFactor,
};
use crate::plan::{EyeTables, ModelTables, Planner, Storage, ViewLayout};
use crate::scene::{Bend, Fit, LightField, Pyramid, Resize, ViewGrid, shrink_to_share};
use rayon::prelude::*;
use std::borrow::Cow;
use std::sync::Arc;

/// Sum of each view. Four side by side, for each addition waits for the one before it.
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

/// One colour of a display, and the scene in that colour.
#[derive(Debug, Clone)]
pub struct Problem {
    /// Optics over the SLM.
    pub optics: Optics,
    /// Zeros around the SLM; the views cover the padded grid.
    pub padding: Padding,
    /// Side of the eyebox that pupils are drawn in, metres: what all colours of the display serve.
    pub eyebox: f64,
    /// The parts of it that the lit ones of the display's switchable sources serve; none for all of it.
    pub regions: Arc<[EyeboxRegion]>,
    /// Where the views stand,
    pub views: ViewGrid,
    /// around this place (x, y) of the pupil plane, metres.
    pub center: [f64; 2],
    /// The views on the padded grid.
    pub pyramid: Arc<Pyramid>,
    /// Mean of the scene's linear light over the image.
    pub mean: f64,
    /// Share of the image that the picture takes along each axis: less than 1 for the far field's longer wavelengths.
    pub share: f64,
    /// What the display does to the light beside showing phases (OPTICS 10); none for the ideal one.
    pub model: Option<Arc<ModelTables>>,
    /// The eye that looks (OPTICS 11); none for a perfect one.
    pub eye: Option<Arc<EyeTables>>,
    /// The modes of the display's source (OPTICS 12); none for a laser on the axis.
    pub modes: Arc<[SourceMode]>,
    /// Which of the display's switchable sources are lit as the eye moves, where they are steered.
    pub choice: Option<SourceChoice>,
}

impl Problem {
    /// The scene `field`, which has the display's size, in one of its colours.
    ///
    /// # Errors
    /// A colour that the display or the scene does not have.
    pub fn new(field: &LightField, color: Color, display: &Display, padding: Padding) -> Result<Self, OpticsError> {
        let missing = || OpticsError::NoColor {
            display: field.name.clone(),
            color,
            has: field.colors.iter().map(Color::to_string).collect::<Vec<_>>().join(", "),
        };
        let views = &field.planes[field.colors.iter().position(|c| *c == color).ok_or_else(missing)?];
        // Shown so that it is seen as the scene is (OPTICS 10).
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
            // Behind a mask the picture has the mask's pixels.
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

    /// What plans and forecasts need: the views' places and sizes, without their light. Its mean is NaN.
    ///
    /// # Errors
    /// A colour that the display does not have.
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

    /// Whether a static mask stands in front of the SLM.
    pub(crate) fn has_mask(&self) -> bool {
        self.model.as_ref().is_some_and(|model| model.parts().mask > 0)
    }

    /// Side of a pixel of the picture, as its views have it, radians.
    pub fn pixel(&self) -> f64 {
        let grid = self.padding.grid(self.optics);
        grid.field_of_view().1 / grid.width as f64 / grid.focal_length
    }

    /// A power of two near the scene's brightest value, or 1 where that is of ordinary size: dividing by it keeps
    /// float32 in range, and changes no digit.
    pub fn unit(&self) -> f64 {
        let exponent = f64::from(self.pyramid.scale).log2().round();
        if exponent.abs() > 10.0 { exponent.exp2() } else { 1.0 }
    }

    /// Plans for a solve of this problem by these settings.
    pub fn planner_of(&self, settings: &Settings) -> Planner {
        let plain = self.planner(settings.solved_frames(), settings.window);
        let (levels, storage) = (settings.levels.count(), settings.storage);
        let plain = Planner { levels, storage, binary_angles: storage == Storage::F16, ..plain };
        if settings.all_modes { plain } else { plain.with_fewer_modes(self.eyebox) }
    }

    /// Plans for this problem.
    pub fn planner(&self, frames: usize, window: WindowFactor) -> Planner {
        let plain = Planner::new(self.optics, frames, window).with_padding(self.padding);
        let views = ViewLayout::new(self.views, &self.pyramid).centered_at(self.center);
        let (model, eye, modes) = (self.model.clone(), self.eye.clone(), Arc::clone(&self.modes));
        Planner { views: Some(views), share: self.share, model, eye, modes, ..plain }
    }
}
