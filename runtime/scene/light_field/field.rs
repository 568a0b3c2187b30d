//! Represents a light field, which has views on a grid of pupil positions.

use crate::light_field::resize::{Fit, Resize};
use crate::{MadeViews, SceneError, ViewGrid};
use eyebox_optics::{Color, Display};
use rayon::prelude::*;

/// Views of a scene from a grid of positions in the pupil plane (OPTICS 3).
///
/// View (row r, column c) has the position `x = (c - (columns - 1)/2) * cell`, `y = (r - (rows - 1)/2) * cell`. Content
/// of disparity `delta` (pixels between neighboring views, positive towards the camera) is displaced in it. The
/// displacement is `-delta * (c - (columns - 1)/2)` columns and `-delta * (r - (rows - 1)/2)` rows from its place in
/// the central view. Its depth is `delta * f * p / cell`.
#[derive(Debug, Clone, PartialEq)]
pub struct LightField {
    /// Name of the source, for reports.
    pub name: String,
    /// Rows and columns of views.
    pub grid: [usize; 2],
    /// Pixel rows of each view.
    pub height: usize,
    /// Pixel columns of each view.
    pub width: usize,
    /// The loaded colors, in the order of `planes`.
    pub colors: Vec<Color>,
    /// `[color][view, row-major][pixel, row-major]` in linear light, finite, not negative, 1 = full scale.
    pub planes: Vec<Vec<Vec<f32>>>,
    /// Meters between neighboring views in the pupil plane, if they are stated. See [`cell`](Self::cell).
    pub view_pitch: Option<f64>,
    /// Smallest and largest disparity, in pixels between neighboring views at this resolution.
    pub disparity: Option<[f64; 2]>,
    /// Farthest and nearest depth in meters at this resolution, if the scene states it.
    pub depth: Option<[f64; 2]>,
    /// The method that made the views, if they are not the scene's own.
    pub made: Option<MadeViews>,
}

impl LightField {
    /// Refuses views whose shape or values do not match [`planes`](Self::planes).
    ///
    /// # Errors
    /// [`SceneError::Request`] with the first fault.
    pub fn check(&self) -> Result<(), SceneError> {
        self.check_shape()?;
        for (color, views) in self.colors.iter().zip(&self.planes) {
            let light = |v: &f32| v.is_finite() && *v >= 0.0;
            let found = views.par_iter().enumerate().find_map_first(|(v, view)| {
                let at = view.iter().position(|value| !light(value))?;
                let (row, column) = (at / self.width, at % self.width);
                Some(format!("{} in {color}, view {v}, row {row}, column {column}", view[at]))
            });
            if let Some(value) = found {
                let (what, must) = ("the linear light", "finite and not negative");
                return Err(SceneError::Request { what, value, must });
            }
        }
        Ok(())
    }

    pub(crate) fn check_shape(&self) -> Result<(), SceneError> {
        let wrong = |what, value: String, must| Err(SceneError::Request { what, value, must });
        let ([rows, columns], height, width) = (self.grid, self.height, self.width);
        if !(1..=64).contains(&rows) || !(1..=64).contains(&columns) {
            return wrong("the grid of views", format!("{rows} x {columns}"), "1 to 64 rows and columns");
        }
        if !(1..=65536).contains(&height) || !(1..=65536).contains(&width) {
            return wrong("a view's size", format!("{height} x {width}"), "1 to 65536 rows and columns");
        }
        let alike = |views: &Vec<Vec<f32>>| {
            views.len() == rows * columns && views.iter().all(|view| view.len() == height * width)
        };
        if self.colors.is_empty() || self.planes.len() != self.colors.len() || !self.planes.iter().all(alike) {
            let value = format!("{} planes for {} colors", self.planes.len(), self.colors.len());
            return wrong(
                "the light field",
                value,
                "one plane per color, each with a view for every place of the grid",
            );
        }
        match self.view_pitch.filter(|p| !(p.is_finite() && *p > 0.0)) {
            Some(pitch) => wrong("the view pitch (mm)", (pitch * 1e3).to_string(), "a positive, finite number"),
            None => Ok(()),
        }
    }

    /// Returns the light field at `height` x `width` pixels. Disparities and depths scale with the picture (a pixel of
    /// the display stays a pixel). If the scales of the axes differ, the range covers both.
    pub fn fit(&self, height: usize, width: usize, fit: Fit) -> Self {
        if (height, width) == (self.height, self.width) {
            return self.clone();
        }
        let resize = Resize::new([self.height, self.width], [height, width], fit);
        let planes = self.planes.iter().map(|views| views.par_iter().map(|view| resize.apply(view)).collect());
        Self {
            name: self.name.clone(),
            height,
            width,
            colors: self.colors.clone(),
            planes: planes.collect(),
            disparity: self.disparity.map(|d| resize.scale_range(d)),
            depth: self.depth.map(|d| resize.scale_range(d)),
            ..*self
        }
    }

    /// Returns the farthest and the nearest depth on `display` in meters. The scene states them, otherwise its
    /// disparities determine them (`z = delta f p / cell`), otherwise the result is `None`.
    pub fn depth_range(&self, display: &Display) -> Option<[f64; 2]> {
        let per_pixel = display.focal_length * display.picture_pixel() / self.cell(display);
        self.depth.or_else(|| self.disparity.map(|d| d.map(|delta| delta * per_pixel)))
    }

    /// Returns the same views in another order. `places` has, for each place of `grid` row by row, the index of its
    /// view.
    pub(crate) fn reordered(mut self, grid: [usize; 2], places: &[usize]) -> Self {
        for views in &mut self.planes {
            *views = places.iter().map(|&i| std::mem::take(&mut views[i])).collect();
        }
        Self { grid, ..self }
    }

    /// Removes the `outer` rows and columns of views on each side.
    pub(crate) fn inner(self, outer: [usize; 2]) -> Self {
        let [rows, columns] = self.grid;
        let stays = |v: &usize| {
            let at = [v / columns, v % columns];
            (0..2).all(|i| (outer[i]..self.grid[i] - outer[i]).contains(&at[i]))
        };
        let places: Vec<usize> = (0..rows * columns).filter(stays).collect();
        self.reordered([rows - 2 * outer[0], columns - 2 * outer[1]], &places)
    }

    /// Replaces the views and depths (meters) with new ones on `grid`.
    pub(crate) fn with_made(self, grid: ViewGrid, planes: Vec<Vec<Vec<f32>>>, depth: [f64; 2]) -> Self {
        let (places, view_pitch) = ([grid.rows, grid.columns], Some(grid.cell));
        Self { grid: places, planes, view_pitch, disparity: None, depth: Some(depth), ..self }
    }

    /// Returns rows and columns of the scene's own views, and their distance in the pupil plane of `display` in meters.
    pub fn own_views(&self, display: &Display) -> ([usize; 2], f64) {
        self.made.as_ref().map_or((self.grid, self.cell(display)), |made| (made.grid, made.cell))
    }

    /// Returns the side of a view's square cell in the pupil plane, in meters. It is the stated view pitch. Otherwise
    /// it is the eyebox that all colors of the display serve, divided by the number of views along the longer axis.
    pub fn cell(&self, display: &Display) -> f64 {
        self.view_pitch.unwrap_or_else(|| display.eyebox_min() / self.grid[0].max(self.grid[1]).max(1) as f64)
    }
}

/// Converts (place, color) to (color, place) for the first `colors` colors.
pub(crate) fn by_color(views: impl IntoIterator<Item = Vec<Vec<f32>>>, colors: usize) -> Vec<Vec<Vec<f32>>> {
    let mut planes: Vec<Vec<Vec<f32>>> = vec![Vec::new(); colors];
    for view in views {
        planes.iter_mut().zip(view).for_each(|(plane, view)| plane.push(view));
    }
    planes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fitting_scales_what_is_measured_in_pixels() {
        let field = LightField {
            name: "x".into(),
            grid: [1, 2],
            height: 4,
            width: 6,
            colors: vec![Color::Green],
            planes: vec![vec![vec![0.5; 24]; 2]],
            view_pitch: None,
            disparity: Some([-1.0, 2.0]),
            depth: None,
            made: None,
        };
        let twice = field.fit(8, 20, Fit::Contain);
        assert_eq!((twice.height, twice.width, twice.planes[0][1].len()), (8, 20, 160));
        assert_eq!(twice.disparity, Some([-2.0, 4.0]));
        let row = &twice.planes[0][0][20..40];
        assert!(row[..4].iter().chain(&row[16..]).all(|&v| v == 0.0), "letterbox {row:?}");
        assert!(row[4..16].iter().all(|&v| (v - 0.5).abs() < 1e-6), "content {row:?}");
        assert!(field.fit(8, 20, Fit::Cover).planes[0][0].iter().all(|&v| (v - 0.5).abs() < 1e-6));
        // Columns scale by 3 and rows by 1, and the range covers both.
        assert_eq!(field.fit(4, 18, Fit::Stretch).disparity, Some([-3.0, 6.0]));

        let display = Display::preset("small").unwrap();
        let cell = display.eyebox_min() / 2.0;
        assert_eq!(field.cell(&display), cell);
        let [far, near] = field.depth_range(&display).unwrap();
        assert!((near - 2.0 * 0.4 * 8e-6 / cell).abs() < 1e-12 && (far + near / 2.0).abs() < 1e-12);
        assert_eq!(LightField { view_pitch: Some(1e-3), ..field }.cell(&display), 1e-3);
    }
}
