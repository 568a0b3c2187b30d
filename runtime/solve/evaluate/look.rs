//! Computes the images that an eye sees, and their target images, on any engine.

use super::pool2;
use crate::engine::{Buffer, Engine, EngineError};
use crate::optics::{Geometry, PictureMap, Pupil, WindowFactor};
use crate::plan::{Comparison, Kernel, Planner, PupilPass, Step, Viewpoint};
use crate::scene::{Bend, crop_share, crop_share_adjoint};

/// Returns the time-averaged intensity through each pupil of the phases in `engine`. It is divided by the pupil's
/// share of the eyebox (OPTICS 2). Each image has the SLM's pixels, (height, width), row-major. In the far field it is
/// the square of [`Optics::image_size`](crate::optics::Optics::image_size). No exposure is applied.
///
/// The engine must have been loaded with the planner's shape.
///
/// # Errors
/// Returns the errors of the engine.
pub fn views(engine: &mut dyn Engine, planner: &Planner, pupils: &[Pupil]) -> Result<Vec<Vec<f32>>, EngineError> {
    let planner = Planner { views: None, ..planner.clone() };
    images(engine, &planner, &pupils.iter().map(|p| Viewpoint::Pupil(*p)).collect::<Vec<_>>())
}

/// Returns the same images as [`views`] for any viewpoints.
///
/// # Errors
/// Returns the errors of the engine.
pub fn images(
    engine: &mut dyn Engine,
    planner: &Planner,
    viewpoints: &[Viewpoint],
) -> Result<Vec<Vec<f32>>, EngineError> {
    let planner = Planner { factor: WindowFactor::Full, ..planner.clone() };
    let pupil_passes = viewpoints.iter().map(|s| planner.viewpoint(s, &Comparison::default())).collect();
    pass_by_pass(engine, planner.view_step(pupil_passes), |engine, _| {
        Ok(crop(&planner, engine.read(Buffer::Image(0))?))
    })
}

/// Runs the shared work of all pupil passes, then each pupil pass by itself, and collects the results of `take`.
pub(super) fn pass_by_pass<T>(
    engine: &mut dyn Engine,
    step: Step,
    take: impl Fn(&mut dyn Engine, &PupilPass) -> Result<T, EngineError>,
) -> Result<Vec<T>, EngineError> {
    let step = step.pass_by_pass();
    let shared = step.shared();
    engine.run_part(&step, 0..shared)?;
    let each = (step.list.len() - shared) / step.pupil_passes.len().max(1);
    let one = |(i, pupil_pass): (usize, &PupilPass)| {
        engine.run_part(&step, shared + i * each..shared + (i + 1) * each)?;
        take(engine, pupil_pass)
    };
    step.pupil_passes.iter().enumerate().map(one).collect()
}

/// Returns the target image of the engine's views through each pupil, on the SLM's pixels (OPTICS 3).
///
/// # Errors
/// Returns the errors of the engine.
pub fn photographs(engine: &mut dyn Engine, planner: &Planner, pupils: &[Pupil]) -> Result<Vec<Vec<f32>>, EngineError> {
    targets(engine, planner, &pupils.iter().map(|p| Viewpoint::Pupil(*p)).collect::<Vec<_>>())
}

/// Returns the same target images as [`photographs`] for any viewpoints.
///
/// # Errors
/// Returns the errors of the engine.
pub fn targets(
    engine: &mut dyn Engine,
    planner: &Planner,
    viewpoints: &[Viewpoint],
) -> Result<Vec<Vec<f32>>, EngineError> {
    let planner = Planner { factor: WindowFactor::Full, ..planner.clone() };
    viewpoints
        .iter()
        .map(|s| {
            let step = planner.photograph_step(vec![planner.viewpoint(s, &Comparison::default())]);
            debug_assert!(step.list.iter().all(|d| matches!(d.kernel, Kernel::Photograph | Kernel::Resample)));
            engine.run(&step)?;
            Ok(crop(&planner, engine.read(Buffer::Target(0))?))
        })
        .collect()
}

/// Returns the SLM's part of an image on the grid. In the far field it is the picture's part, with the axis in its
/// middle.
pub fn crop(planner: &Planner, image: Vec<f32>) -> Vec<f32> {
    if planner.grid.geometry == Geometry::FarField {
        let (height, width) = planner.grid.image_size();
        let image = centered(&image, height, width);
        return if planner.share < 1.0 { crop_share(&image, height, width, planner.share) } else { image };
    }
    let place = planner.place();
    if planner.grid == planner.slm {
        return image;
    }
    // Behind a mask, each pixel is the mean of its finer pixels.
    let finer = planner.slm.mask_factor;
    let (height, width) = (finer * place.height as usize, finer * place.width as usize);
    let rows = image.chunks_exact(place.grid_width as usize).skip(place.top as usize).take(height);
    let rows = rows.map(|row| &row[place.left as usize..][..width]);
    if finer == 1 {
        return rows.flatten().copied().collect();
    }
    let mut means = vec![0.0; (place.height * place.width) as usize];
    let share = 1.0 / (finer * finer) as f32;
    for (y, row) in rows.enumerate() {
        let means = &mut means[y / finer * place.width as usize..][..place.width as usize];
        means.iter_mut().zip(row.chunks_exact(finer)).for_each(|(mean, own)| *mean += share * own.iter().sum::<f32>());
    }
    means
}

/// Returns the gradient with respect to an image on the grid from the gradient with respect to `cropped`, which is the
/// image after [`crop`].
pub fn crop_adjoint(planner: &Planner, gradient: &[f32], cropped: &[f32]) -> Vec<f32> {
    if planner.grid.geometry == Geometry::FarField {
        let (height, width) = planner.grid.image_size();
        let gradient = match planner.share {
            share @ 0.0..1.0 => crop_share_adjoint(gradient, cropped, height, width, share),
            _ => gradient.to_vec(),
        };
        // The axis moves back to the first pixel.
        return rolled(&gradient, height, width, [height / 2, width / 2]);
    }
    let place = planner.place();
    if planner.grid == planner.slm {
        return gradient.to_vec();
    }
    let (finer, columns, grid_width) = (planner.slm.mask_factor, place.width as usize, place.grid_width as usize);
    let share = 1.0 / (finer * finer) as f32;
    let mut image = vec![0.0; place.grid_height as usize * grid_width];
    let rows = image.chunks_exact_mut(grid_width).skip(place.top as usize).take(finer * place.height as usize);
    for (y, row) in rows.enumerate() {
        let of_row = &gradient[y / finer * columns..][..columns];
        let pixels = row[place.left as usize..].chunks_exact_mut(finer).zip(of_row);
        pixels.for_each(|(pixels, value)| pixels.fill(share * value));
    }
    image
}

/// Moves the axis of an image (height, width) from the first pixel to the middle.
pub fn centered(image: &[f32], height: usize, width: usize) -> Vec<f32> {
    rolled(image, height, width, [height - height / 2, width - width / 2])
}

/// Returns the image (height, width) from this row and column on, with the rows and columns before them at its end.
fn rolled(image: &[f32], height: usize, width: usize, [top, left]: [usize; 2]) -> Vec<f32> {
    let rows = (0..height).map(|y| &image[(y + top) % height * width..][..width]);
    rows.flat_map(|row| row[left % width.max(1)..].iter().chain(&row[..left % width.max(1)])).copied().collect()
}

/// An image of linear light or intensity, (row, column).
#[derive(Debug, Clone, PartialEq)]
pub struct Plane {
    /// Number of rows of pixels.
    pub rows: usize,
    /// Number of columns of pixels.
    pub columns: usize,
    /// The values, row by row.
    pub values: Vec<f32>,
}

impl Plane {
    /// Returns the plane as an eye sees it through the distortion of the display's picture.
    pub fn as_seen(&self, map: &PictureMap) -> Self {
        Self { values: Bend::to_viewer(map, [self.rows, self.columns]).apply(&self.values), ..*self }
    }

    /// Returns the mean of every block of 2 x 2 pixels ([`pool2`]).
    pub(crate) fn pooled(&self) -> Self {
        let values = pool2(&self.values, self.rows, self.columns);
        if self.rows < 2 || self.columns < 2 {
            return Self { values, ..*self };
        }
        Self { rows: self.rows / 2, columns: self.columns / 2, values }
    }
}
